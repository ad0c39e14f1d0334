// fraja-submit --travel: a film, each frame a job of its own; many at a time, so that every machine
// has one.
#pragma once

#include "client/submit_options.hpp"
#include "common/net/signals.hpp"

#include <cstdint>

namespace fraja::client {

inline constexpr std::uint32_t frames_at_a_time_max = 64;
/// Of the pictures that are held meanwhile.
inline constexpr std::uint64_t frames_bytes_max = std::uint64_t{1} << 30;

/// How many frames are submitted at a time, 1 at least.
[[nodiscard]] std::uint32_t frames_at_a_time(const protocol::PictureSettings& settings);

/// Returns the exit code. `signals` may be null.
[[nodiscard]] int run_submit_film(const SubmitOptions& options, const net::SignalWatch* signals);

} // namespace fraja::client
