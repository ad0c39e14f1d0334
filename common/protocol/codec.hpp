// Messages to frames and back.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/result.hpp"
#include "common/protocol/messages.hpp"

#include <span>
#include <vector>

namespace fraja::protocol {

/// A message as frames: header, body (a msgpack array), then blobs. The envelope (a routing id, a
/// topic) is not part of it.
struct Packet {
    Bytes header;
    Bytes body;
    std::vector<Blob> blobs;
};

/// Asserts what the sender must keep: strings, blobs and frames within the limits.
[[nodiscard]] Packet encode(const Message& message);

/// Reads frames that anybody may have sent. Unknown trailing fields are ignored; everything else
/// that is not exactly as PROTOCOL.md says is an error: malformed_frame, or version_mismatch where
/// the header is ours but the version is not. Blobs are shared with `frames`, not copied. Memory
/// stays within a small multiple of the frames' own size.
[[nodiscard]] Result<Message> decode(std::span<const Blob> frames);

/// Reads the body of a message (`Packet::body`) that was kept, of whatever version of the protocol
/// it was: fields that it ends before, here or in a record within, are as in a new M, and those it
/// has beyond are ignored. So a field that comes to the end of a record must mean by its default
/// what was so before there was one. A message's blobs are none. M: SubmitJob or TileDone.
template <class M>
[[nodiscard]] Result<M> decode_kept(std::span<const std::byte> body);

} // namespace fraja::protocol
