// The limits of the wire, in one place. PROTOCOL.md repeats them and a test compares the two.
#pragma once

#include "common/base/instant.hpp"

#include <chrono>
#include <cstddef>
#include <cstdint>

namespace fraja::protocol {

inline constexpr std::size_t frame_bytes_max = std::size_t{1} << 20; ///< header, body or blob
inline constexpr std::size_t message_frames_max = 64; ///< header, body and blobs together
inline constexpr std::size_t string_bytes_max = 4096; ///< any string of a message
inline constexpr std::size_t name_bytes_max = 200;    ///< names of jobs and workers
inline constexpr double speed_rays_per_s_max = 1e15;  ///< that a worker may say of itself
inline constexpr std::size_t tags_max = 64;           ///< tags of one worker
inline constexpr std::size_t credit_max = 4096;       ///< tiles in flight at one worker
inline constexpr std::size_t nesting_max = 8;         ///< arrays within arrays of a body
inline constexpr std::size_t brokers_max = 16;        ///< that stand for each other
inline constexpr std::size_t distrusted_max = 64;     ///< workers that a job names as such

inline constexpr std::size_t chunk_bytes = std::size_t{1}
                                           << 19; ///< a piece of a scene or of a tile's pixels

inline constexpr std::uint64_t scene_bytes_max = std::uint64_t{1} << 30;
inline constexpr std::uint32_t picture_side_max = 65'536;                   ///< pixels
inline constexpr std::uint64_t picture_pixels_max = std::uint64_t{1} << 28; ///< 3 GiB of floats
inline constexpr std::uint32_t tile_side_max = 1024;                        ///< pixels
inline constexpr std::uint32_t cells_per_job_max = std::uint32_t{1} << 22;
inline constexpr std::uint64_t probe_squares_max = 4096; ///< of one probe
inline constexpr std::uint32_t depth_max = 1'000'000;
inline constexpr std::uint32_t aa_max = 256;
inline constexpr std::uint32_t samples_min = 4; ///< of the ceiling for error: each pixel has them
inline constexpr std::uint32_t samples_max = 65'536; ///< per pixel
inline constexpr double error_max = 255;             ///< levels
inline constexpr Duration time_limit_max = std::chrono::hours(24'000);

} // namespace fraja::protocol
