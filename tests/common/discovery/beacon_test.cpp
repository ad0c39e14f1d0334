#include "common/discovery/beacon.hpp"

#include "common/base/bytes.hpp"
#include "tests/support/seeds.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <string>
#include <vector>

using namespace fraja;
using namespace fraja::discovery;

namespace {

const net::PublicKey farm_key{std::string(40, 'a')}, other_key{std::string(40, 'b')};

Bytes bytes_of(const Beacon& beacon) {
    const auto bytes = encode_beacon(beacon);
    return Bytes(bytes.begin(), bytes.end());
}

Bytes changed(Bytes bytes, std::size_t at, int value) {
    bytes.at(at) = static_cast<std::byte>(value);
    return bytes;
}

} // namespace

TEST_CASE("a beacon says the same when it is read again") {
    for (const Beacon& beacon :
         {Beacon{.port = 50057}, Beacon{.port = 1, .farm = fingerprint_of(farm_key)},
          Beacon{.port = 65535, .host = "farm.example"}, Beacon{.port = 7, .host = "[fd77::1]"},
          Beacon{.port = 7, .host = std::string(beacon_host_bytes_max, 'h')}}) {
        CAPTURE(beacon.host);
        const auto read = decode_beacon(encode_beacon(beacon));
        REQUIRE(read);
        CHECK(*read == beacon);
    }
}

TEST_CASE("a beacon's bytes are those that beacon.hpp lists") {
    const Fingerprint farm = fingerprint_of(farm_key);
    Bytes want = to_bytes("FRAJ");
    for (const int byte : {1, 1, 0xc3, 0x89})
        want.push_back(static_cast<std::byte>(byte));
    want.insert(want.end(), farm.begin(), farm.end());
    const Bytes host = to_bytes("h");
    want.insert(want.end(), host.begin(), host.end());
    want.resize(88);
    CHECK(bytes_of({.port = 50057, .farm = farm, .host = "h"}) == want);
}

TEST_CASE("a farm's fingerprint is its own, and does not give away the key") {
    CHECK(fingerprint_of(farm_key) == fingerprint_of(farm_key));
    CHECK(fingerprint_of(farm_key) != fingerprint_of(other_key));
    const Bytes bytes = bytes_of({.port = 1, .farm = fingerprint_of(farm_key)});
    CHECK(as_text(bytes).find("aaaa") == std::string_view::npos);
}

TEST_CASE("endpoint_of takes the sender's address where the beacon names no host") {
    CHECK(endpoint_of({.port = 7}, "10.0.0.1") == "tcp://10.0.0.1:7");
    CHECK(endpoint_of({.port = 7}, "[fe80::1%eth0]") == "tcp://[fe80::1%eth0]:7");
    CHECK(endpoint_of({.port = 7, .host = "farm"}, "10.0.0.1") == "tcp://farm:7");
}

TEST_CASE("decode_beacon refuses what is no beacon") {
    const Bytes good = bytes_of({.port = 50057, .host = "farm"});
    REQUIRE(decode_beacon(good));
    Bytes longer = good, shorter = good;
    longer.push_back(std::byte{0});
    shorter.pop_back();
    struct Row {
        const char* what;
        Bytes bytes;
        ErrorCode want = ErrorCode::malformed_frame;
    };
    for (const Row& row : std::vector<Row>{
             {"nothing", {}},
             {"four bytes", to_bytes("FRAJ")},
             {"too long", longer},
             {"too short", shorter},
             {"another magic", changed(good, 0, 'f')},
             {"another version", changed(good, 4, 2), ErrorCode::version_mismatch},
             {"another version and length", to_bytes("FRAJ\2"), ErrorCode::version_mismatch},
             {"port 0", changed(changed(good, 6, 0), 7, 0)},
             {"a fingerprint without keys", changed(good, 8, 1)},
             {"a host after a zero", changed(good, 40, 'x')},
             {"a control character", changed(good, 25, '\n')},
             {"an escape", changed(good, 25, 27)},
             {"a space", changed(good, 25, ' ')},
             {"a host that is all",
              changed(changed(changed(changed(good, 24, '*'), 25, 0), 26, 0), 27, 0)},
             {"a port in the host", changed(good, 25, ':')},
             {"a path", changed(good, 25, '/')},
             {"bytes that are no text", changed(good, 25, 0xff)},
         }) {
        CAPTURE(row.what);
        const auto read = decode_beacon(row.bytes);
        REQUIRE_FALSE(read);
        CHECK(read.error().code == row.want);
    }
    CHECK(decode_beacon(changed(good, 5, 0x80))); // a flag to come
}

TEST_CASE("decode_beacon takes any bytes, and what it takes can be told again") {
    const Bytes good = bytes_of({.port = 50057, .farm = fingerprint_of(farm_key), .host = "farm"});
    for_each_seed(2'000, [&](Rng& rng) {
        Bytes bytes = good;
        if (rng.below(4) == 0)
            bytes.resize(rng.below(200));
        for (std::uint64_t i = rng.below(8); i > 0 && !bytes.empty(); --i)
            bytes[rng.below(bytes.size())] = static_cast<std::byte>(rng.below(256));
        const auto read = decode_beacon(bytes);
        if (!read)
            return;
        const std::string endpoint = endpoint_of(*read, "10.0.0.1");
        CHECK(std::ranges::all_of(endpoint, [](char c) { return c > ' ' && c <= '~'; }));
        CHECK(decode_beacon(encode_beacon(*read)).value() == *read);
    });
}
