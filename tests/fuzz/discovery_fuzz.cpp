// What anybody on the network may send to who looks for a broker: a datagram, or the DNS's answer.
#include "common/base/assert.hpp"
#include "common/discovery/beacon.hpp"
#include "common/discovery/sightings.hpp"
#include "common/discovery/source.hpp"
#include "common/discovery/srv.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

using namespace fraja;
using namespace fraja::discovery;

namespace {

/// It goes into logs and on terminals.
void check_endpoint(const std::string& endpoint) {
    FRAJA_ASSERT(std::ranges::all_of(endpoint, [](char c) { return c > ' ' && c <= '~'; }));
    FRAJA_ASSERT(!is_source(endpoint));
}

void check_beacon(std::span<const std::byte> bytes) {
    const auto beacon = decode_beacon(bytes);
    if (!beacon)
        return;
    FRAJA_ASSERT(decode_beacon(encode_beacon(*beacon)).value() == *beacon);
    check_endpoint(endpoint_of(*beacon, "10.0.0.1"));
    Sightings sightings(beacon->farm);
    FRAJA_ASSERT(sightings.hear({}, bytes, "10.0.0.1") == Sightings::Verdict::taken);
    FRAJA_ASSERT(sightings.endpoints().size() == 1);
}

void check_srv_answer(std::span<const std::byte> bytes) {
    const auto records = parse_srv_answer(bytes);
    if (!records) {
        FRAJA_ASSERT(!records.error().message.empty());
        return;
    }
    Rng rng(1);
    const auto endpoints = endpoints_in_order(*records, rng);
    FRAJA_ASSERT(endpoints.size() <= std::min(srv_records_max, records->size()));
    std::ranges::for_each(endpoints, check_endpoint);
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const auto bytes = std::as_bytes(std::span(data, size));
    check_beacon(bytes);
    check_srv_answer(bytes);
    if (const auto word = broker_word({reinterpret_cast<const char*>(data), size}))
        FRAJA_ASSERT(broker_word(*word).value() == *word);
    return 0;
}
