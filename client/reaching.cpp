#include "client/reaching.hpp"

#include "common/discovery/beacon.hpp"
#include "common/discovery/source.hpp"
#include "common/discovery/srv_lookup.hpp"
#include "common/net/reach.hpp"

#include <system_error>
#include <utility>

namespace fraja::client {
namespace {

std::string why_unreached(const std::string& broker, const net::Interrupt& interrupt) {
    if (broker == discovery::beacon_source)
        return "announcements on this network, UDP port " + std::to_string(discovery::beacon_port);
    if (!discovery::is_source(broker))
        return net::why_unreached(broker, interrupt);
    const auto records = discovery::look_up_srv(discovery::srv_name(broker), {}, interrupt);
    return records ? std::string() : records.error().message;
}

} // namespace

Reaching::Reaching(const std::vector<std::string>& endpoints) {
    try {
        thread_ = std::jthread([this, all = endpoints](const std::stop_token& stop) {
            std::vector<std::string> hindrances;
            for (const std::string& endpoint : all)
                if (!stop.stop_requested())
                    hindrances.push_back(why_unreached(endpoint, {stop, &waker_}));
            const std::lock_guard lock(mutex_);
            hindrances_ = std::move(hindrances);
        });
    } catch (const std::system_error&) { // no thread to spare: then there is no telling
        hindrances_.emplace(endpoints.size());
    }
}

Reaching::~Reaching() {
    thread_.request_stop();
    waker_.wake();
}

std::optional<std::vector<std::string>> Reaching::hindrances() const {
    const std::lock_guard lock(mutex_);
    return hindrances_;
}

} // namespace fraja::client
