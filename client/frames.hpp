// The numbers of a film's frames: which of them are wanted, how many at a time, and the names of
// their files.
#pragma once

#include "common/base/result.hpp"
#include "common/protocol/settings.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace fraja::client {

/// Every `step`-th from `first` to `last`, counted from 1.
struct FrameRange {
    std::uint32_t first = 1, last = 1, step = 1;
    friend bool operator==(const FrameRange&, const FrameRange&) = default;
};

/// Reads A, A-B or A-BxS, with 1 <= A <= B and S >= 1; nothing else.
[[nodiscard]] std::optional<FrameRange> parse_frames(std::string_view text);

/// Whether the name of a file says once where the frame's number goes: %d, or %04d for four digits.
/// The error is the cure.
[[nodiscard]] Result<void> check_frame_pattern(std::string_view pattern);
/// Of a pattern that is good.
[[nodiscard]] std::string frame_file(std::string_view pattern, std::uint32_t frame);

/// "01.png ... 03.png, 05.png": the files of frames in their order, where an empty one is missing.
/// Of many runs the first few, and how many files the others have.
[[nodiscard]] std::string runs_of(std::span<const std::string> files);

inline constexpr std::uint32_t frames_at_a_time_max = 64;
/// Of the pictures that are held meanwhile.
inline constexpr std::uint64_t frames_bytes_max = std::uint64_t{1} << 30;

/// How many frames are submitted at a time, 1 at least.
[[nodiscard]] std::uint32_t frames_at_a_time(const protocol::PictureSettings& settings);

} // namespace fraja::client
