// Messages to frames and back.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/result.hpp"
#include "common/protocol/messages.hpp"

#include <optional>
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

/// For whoever speaks that version, and all newer ones that are spoken: values that it does not
/// know are said in its words. Asserts what the sender must keep: that version is spoken and knows
/// the message, and strings, blobs and frames are within the limits.
[[nodiscard]] Packet encode(const Message& message, Version spoken = version);

/// Reads frames that anybody may have sent, of any version that is spoken. Fields that came with a
/// later version than the header's may be missing: they are as in a new message. Unknown trailing
/// fields are ignored; everything else that is not exactly as PROTOCOL.md says is an error:
/// malformed_frame, or version_mismatch where the header is ours but the version is not. Blobs are
/// shared with `frames`, not copied. Memory stays within a small multiple of the frames' own size.
[[nodiscard]] Result<Message> decode(std::span<const Blob> frames);

/// What the header says, also of a version that is not spoken. Nothing: there is no header of ours.
[[nodiscard]] std::optional<Version> version_of(std::span<const Blob> frames);

/// Reads the body of a message (`Packet::body`) that was kept, of whatever version of the protocol
/// it was: fields that it ends before, here or in a record within, are as in a new M, and those it
/// has beyond are ignored. So a field that comes to the end of a record must mean by its default
/// what was so before there was one. A message's blobs are none. M: SubmitJob or TileDone.
template <class M>
[[nodiscard]] Result<M> decode_kept(std::span<const std::byte> body);

} // namespace fraja::protocol
