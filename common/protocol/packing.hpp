// Packing: how the frames of a message travel on a session.
#pragma once

#include "common/protocol/codec.hpp"
#include "common/protocol/limits.hpp"

#include <cstddef>
#include <span>
#include <vector>

namespace fraja::protocol {

// In one ZeroMQ frame, each behind its length: libzmq 4.3.4 aborts when a DEALER's connection ends
// while it is between two frames of a message.
inline constexpr std::size_t length_bytes = 4; ///< unsigned, little-endian
inline constexpr std::size_t packed_bytes_max =
    message_frames_max * (length_bytes + frame_bytes_max);

[[nodiscard]] std::size_t packed_size(const Packet& packet);

/// Fills `room`, which has packed_size(packet) bytes (asserted).
void pack(const Packet& packet, std::span<std::byte> room);
[[nodiscard]] Blob packed(const Packet& packet);

/// The frames, shared with `packed`, not copied; for decode(), which says what is wrong with them:
/// of too many one too many, and bytes that are no frames are a single one.
[[nodiscard]] std::vector<Blob> unpack(const Blob& packed);

} // namespace fraja::protocol
