#include "common/discovery/srv.hpp"

#include "common/net/endpoint.hpp"

#include <algorithm>
#include <ares.h>
#include <iterator>
#include <limits>
#include <memory>
#include <utility>

namespace fraja::discovery {
namespace {

/// One of those that have the same priority, and takes it out. Those without weight stand first, so
/// that they have a small chance (RFC 2782).
SrvRecord draw(std::vector<SrvRecord>& equals, Rng& rng) {
    std::ranges::stable_partition(equals, [](const SrvRecord& r) { return r.weight == 0; });
    std::uint64_t sum = 0;
    for (const SrvRecord& record : equals)
        sum += record.weight;
    const std::uint64_t chosen = rng.below(sum + 1);
    std::uint64_t running = 0;
    auto at = equals.begin();
    while ((running += at->weight) < chosen)
        ++at;
    SrvRecord drawn = std::move(*at);
    equals.erase(at);
    return drawn;
}

} // namespace

Result<std::vector<SrvRecord>> parse_srv_answer(std::span<const std::byte> answer) {
    if (answer.size() > std::numeric_limits<std::uint16_t>::max())
        return Error{ErrorCode::malformed_frame, "its answer is too long"};
    ares_srv_reply* list = nullptr;
    const int status = ares_parse_srv_reply(reinterpret_cast<const unsigned char*>(answer.data()),
                                            static_cast<int>(answer.size()), &list);
    const std::unique_ptr<ares_srv_reply, decltype(&ares_free_data)> owner(list, ares_free_data);
    if (status != ARES_SUCCESS && status != ARES_ENODATA)
        return Error{ErrorCode::malformed_frame, "its answer cannot be read"};
    std::vector<SrvRecord> records;
    for (const ares_srv_reply* at = list; at; at = at->next)
        records.push_back({at->priority, at->weight, at->port, at->host});
    if (records.empty())
        return Error{ErrorCode::not_found, "the name has no SRV records"};
    if (records.size() == 1 && (records[0].target.empty() || records[0].target == "."))
        return Error{ErrorCode::not_found, "the DNS says that there is no such service"};
    return records;
}

std::vector<std::string> endpoints_in_order(std::vector<SrvRecord> records, Rng& rng) {
    std::ranges::stable_sort(records, {}, &SrvRecord::priority);
    std::vector<std::string> endpoints;
    for (auto first = records.begin(); first != records.end();) {
        const auto last = std::find_if(first, records.end(), [&](const SrvRecord& r) {
            return r.priority != first->priority;
        });
        std::vector<SrvRecord> equals(std::make_move_iterator(first),
                                      std::make_move_iterator(last));
        first = last;
        while (!equals.empty() && endpoints.size() < srv_records_max) {
            const SrvRecord record = draw(equals, rng);
            const auto endpoint =
                net::endpoint_to_connect(record.target + ":" + std::to_string(record.port), 0);
            if (endpoint && std::ranges::find(endpoints, *endpoint) == endpoints.end())
                endpoints.push_back(*endpoint);
        }
    }
    return endpoints;
}

} // namespace fraja::discovery
