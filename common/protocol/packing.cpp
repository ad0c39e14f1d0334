#include "common/protocol/packing.hpp"

#include "common/base/assert.hpp"

#include <bit>
#include <cstdint>
#include <cstring>
#include <utility>

namespace fraja::protocol {
namespace {

static_assert(std::endian::native == std::endian::little, "lengths travel little-endian");
static_assert(sizeof(std::uint32_t) == length_bytes);

template <class F>
void for_each_frame(const Packet& packet, F deed) {
    deed(std::span<const std::byte>(packet.header));
    deed(std::span<const std::byte>(packet.body));
    for (const Blob& blob : packet.blobs)
        deed(std::span<const std::byte>(blob));
}

} // namespace

std::size_t packed_size(const Packet& packet) {
    std::size_t size = 0;
    for_each_frame(packet,
                   [&](std::span<const std::byte> frame) { size += length_bytes + frame.size(); });
    return size;
}

void pack(const Packet& packet, std::span<std::byte> room) {
    FRAJA_ASSERT(room.size() == packed_size(packet));
    std::byte* to = room.data();
    for_each_frame(packet, [&](std::span<const std::byte> frame) {
        const auto length = static_cast<std::uint32_t>(frame.size());
        std::memcpy(to, &length, length_bytes);
        to += length_bytes;
        if (!frame.empty())
            std::memcpy(to, frame.data(), frame.size());
        to += frame.size();
    });
}

Blob packed(const Packet& packet) {
    Bytes bytes(packed_size(packet));
    pack(packet, bytes);
    return Blob(std::move(bytes));
}

std::vector<Blob> unpack(const Blob& packed) {
    std::vector<Blob> frames;
    frames.reserve(3); // header, body, and most often one blob
    std::size_t at = 0;
    while (at < packed.size() && frames.size() <= message_frames_max) {
        std::uint32_t length = 0;
        if (packed.size() - at < length_bytes)
            return {packed};
        std::memcpy(&length, packed.data() + at, length_bytes);
        at += length_bytes;
        if (packed.size() - at < length)
            return {packed};
        frames.push_back(packed.part(at, length));
        at += length;
    }
    if (frames.empty())
        return {packed};
    return frames;
}

} // namespace fraja::protocol
