#include "common/discovery/announcer.hpp"

#include "common/discovery/sightings.hpp"
#include "common/net/endpoint.hpp"

#include <chrono>
#include <poll.h>
#include <utility>

namespace fraja::discovery {
namespace {

constexpr int beacon_interval_ms = static_cast<int>(
    std::chrono::duration_cast<std::chrono::milliseconds>(beacon_interval).count());

void announce(const BeaconSender& sender, const Beacon& beacon, const Announcer::OnLog& on_log,
              const net::Waker& waker, const std::stop_token& stop) {
    const auto bytes = encode_beacon(beacon);
    const auto say = [&](LogLevel level, const char* text) {
        on_log({level, "announcing", {}, text});
    };
    bool was_heard = true;
    while (!stop.stop_requested()) {
        const bool is_heard = sender.send(bytes) > 0;
        if (!is_heard && was_heard)
            say(LogLevel::warning, "there is no network to announce this broker on; it is tried "
                                   "again every second");
        else if (is_heard && !was_heard)
            say(LogLevel::info, "this broker is announced again");
        was_heard = is_heard;
        pollfd woken{waker.fd(), POLLIN, 0};
        ::poll(&woken, 1, beacon_interval_ms);
    }
}

/// Who listens there hears connections to any address.
bool is_any(const std::string& host) {
    return host == "*" || host == "0.0.0.0" || host == "[::]";
}

} // namespace

Result<Announcement> announcement_of(const std::string& bound, const std::string& advertised,
                                     const net::PublicKey* farm, BeaconWays ways) {
    const bool is_advertised = !advertised.empty();
    const auto endpoint = net::parse_endpoint(is_advertised ? advertised : bound, net::broker_port);
    if (!endpoint)
        return endpoint.error();
    if (net::is_loopback(*endpoint))
        return Error{ErrorCode::invalid_argument,
                     "--announce: no other machine reaches " + net::to_string(*endpoint) +
                         "; --bind 'tcp://*:50057' or another address of this machine lets them"};
    Announcement announcement{{.port = endpoint->port}, ways};
    if (farm)
        announcement.beacon.farm = fingerprint_of(*farm);
    if (is_any(endpoint->host))
        announcement.ways.ipv6 = ways.ipv6 && endpoint->host != "0.0.0.0"; // the others hear both
    else
        announcement.beacon.host = endpoint->host;
    if (announcement.beacon.host.size() > beacon_host_bytes_max)
        return Error{ErrorCode::invalid_argument,
                     "--announce: " + announcement.beacon.host + " is longer than " +
                         std::to_string(beacon_host_bytes_max) +
                         " bytes; --advertise says where else others reach this broker"};
    return announcement;
}

std::string to_string(const BeaconWays& ways) {
    return ways.broadcast && ways.multicast ? "broadcast and multicast"
           : ways.broadcast                 ? "broadcast"
                                            : "multicast";
}

Announcer::Announcer(BeaconSender sender, const Beacon& beacon, OnLog on_log)
    : thread_([this, sender = std::move(sender), beacon,
               on_log = std::move(on_log)](const std::stop_token& stop) {
          announce(sender, beacon, on_log, waker_, stop);
      }) {}

Announcer::~Announcer() {
    thread_.request_stop();
    waker_.wake();
}

} // namespace fraja::discovery
