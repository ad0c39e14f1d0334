#include "common/discovery/sightings.hpp"

#include "common/base/bytes.hpp"

#include <doctest/doctest.h>
#include <string>
#include <vector>

using namespace fraja;
using namespace fraja::discovery;
using namespace std::chrono_literals;
using Verdict = Sightings::Verdict;

namespace {

const Fingerprint own = fingerprint_of({std::string(40, 'a')});
const Fingerprint other = fingerprint_of({std::string(40, 'b')});

Bytes beacon(std::uint16_t port, std::optional<Fingerprint> farm = {}, std::string host = {}) {
    const auto bytes = encode_beacon({.port = port, .farm = farm, .host = std::move(host)});
    return Bytes(bytes.begin(), bytes.end());
}

constexpr Instant start{};

} // namespace

TEST_CASE("a broker is known from its first beacon until it has not been heard for a while") {
    Sightings sightings({});
    CHECK(sightings.next_deadline() == Instant::never());
    CHECK(sightings.hear(start, beacon(7), "10.0.0.1") == Verdict::taken);
    CHECK(sightings.hear(start + 1s, beacon(8), "10.0.0.2") == Verdict::taken);
    CHECK(sightings.hear(start + 2s, beacon(7), "10.0.0.1") == Verdict::taken);
    CHECK(sightings.endpoints() ==
          std::vector<std::string>{"tcp://10.0.0.1:7", "tcp://10.0.0.2:8"});
    CHECK(sightings.next_deadline() == start + 1s + sighting_lifetime);
    sightings.expire(start + 1s + sighting_lifetime);
    CHECK(sightings.endpoints() == std::vector<std::string>{"tcp://10.0.0.1:7"});
    sightings.expire(start + 2s + sighting_lifetime);
    CHECK(sightings.endpoints().empty());
}

TEST_CASE("who has keys sees the brokers of its farm alone, and who has none those without") {
    Sightings with_keys(own), without({});
    for (Sightings* s : {&with_keys, &without}) {
        s->hear(start, beacon(1, own), "10.0.0.1");
        s->hear(start, beacon(2, other), "10.0.0.1");
        s->hear(start, beacon(3), "10.0.0.1");
    }
    CHECK(with_keys.endpoints() == std::vector<std::string>{"tcp://10.0.0.1:1"});
    CHECK(with_keys.count(Verdict::other_farm) == 2);
    CHECK(without.endpoints() == std::vector<std::string>{"tcp://10.0.0.1:3"});
    CHECK(without.count(Verdict::other_farm) == 2);
}

TEST_CASE("rubbish and other versions are counted and change nothing") {
    Sightings sightings({});
    CHECK(sightings.hear(start, to_bytes("hello"), "10.0.0.9") == Verdict::malformed);
    Bytes newer = beacon(7);
    newer[4] = std::byte{9};
    CHECK(sightings.hear(start, newer, "10.0.0.9") == Verdict::other_version);
    CHECK(sightings.endpoints().empty());
    CHECK(sightings.count(Verdict::malformed) == 1);
    CHECK(sightings.count(Verdict::other_version) == 1);
    CHECK(sightings.count(Verdict::taken) == 0);
}

TEST_CASE("endless senders do not drive out the brokers that are known") {
    Sightings sightings({});
    sightings.hear(start, beacon(7), "10.0.0.1");
    for (unsigned i = 0; i < 100'000; ++i)
        sightings.hear(start, beacon(7),
                       "10." + std::to_string(i >> 16 & 255) + "." + std::to_string(i >> 8 & 255) +
                           "." + std::to_string(i & 255));
    const auto known = sightings.endpoints();
    CHECK(known.size() == sightings_max);
    CHECK(known.front() == "tcp://10.0.0.1:7");
    CHECK(sightings.count(Verdict::too_many) > 99'000);
    CHECK(sightings.hear(start + 1s, beacon(7), "10.0.0.1") == Verdict::taken);
}

TEST_CASE("one sender names a few brokers, and others have room beside it") {
    Sightings sightings({});
    for (unsigned i = 1; i <= 1000; ++i)
        sightings.hear(start, beacon(static_cast<std::uint16_t>(i), {}, "farm"), "10.0.0.9");
    CHECK(sightings.endpoints().size() == sightings_per_sender_max);
    CHECK(sightings.hear(start, beacon(7), "10.0.0.1") == Verdict::taken);
    // When they are gone there is room again.
    CHECK(sightings.hear(start + sighting_lifetime, beacon(9), "10.0.0.9") == Verdict::taken);
}
