#include "common/protocol/packing.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::protocol;

namespace {

Packet packet_of(std::size_t blob_count, std::size_t blob_bytes = 5) {
    Packet packet{to_bytes("header"), to_bytes("body"), {}};
    packet.blobs.assign(blob_count, Blob(Bytes(blob_bytes, std::byte{7})));
    return packet;
}

} // namespace

TEST_CASE("frames are packed behind their lengths") {
    Packet packet{to_bytes("ab"), {}, {Blob(to_bytes("c"))}};
    CHECK(packed(packet) == Blob(to_bytes(std::string_view("\2\0\0\0ab\0\0\0\0\1\0\0\0c", 15))));
}

TEST_CASE("what is packed is unpacked, and not copied") {
    const Packet packet{to_bytes("header"), {}, {Blob(), Blob(to_bytes("pixels")), Blob()}};
    const Blob one = packed(packet);
    const auto frames = unpack(one);
    REQUIRE(frames.size() == 5);
    CHECK(as_text(frames[0]) == "header");
    CHECK(frames[1].empty());
    CHECK(std::vector(frames.begin() + 2, frames.end()) == packet.blobs);
    CHECK(frames[0].data() == one.data() + length_bytes);
}

TEST_CASE("bytes that are no frames are one, and no message") {
    const Blob whole = packed(packet_of(2));
    for (std::size_t size = 0; size <= whole.size(); ++size) {
        const std::size_t first = length_bytes + 6, second = first + length_bytes + 4,
                          third = second + length_bytes + 5;
        const bool ends_with_a_frame =
            size == first || size == second || size == third || size == whole.size();
        const auto frames = unpack(whole.part(0, size));
        CHECK((frames.size() == 1 && frames[0].size() == size) == !ends_with_a_frame);
        CHECK_FALSE(decode(frames).has_value());
    }
    const Blob too_long(to_bytes(std::string_view("\xff\xff\xff\xff rest", 9)));
    CHECK(unpack(too_long) == std::vector{too_long});
}

TEST_CASE("of too many frames one too many is unpacked") {
    CHECK(unpack(packed(packet_of(message_frames_max - 2))).size() == message_frames_max);
    CHECK(unpack(packed(packet_of(1'000))).size() == message_frames_max + 1);
    CHECK(unpack(packed(packet_of(100'000, 0))).size() == message_frames_max + 1);
}

TEST_CASE("the largest message fits") {
    CHECK(packed_size({Bytes(frame_bytes_max), Bytes(frame_bytes_max),
                       std::vector(message_frames_max - 2, Blob(Bytes(frame_bytes_max)))}) ==
          packed_bytes_max);
}
