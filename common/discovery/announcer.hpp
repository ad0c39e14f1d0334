// Announcer: tells a network of a broker, again and again, for as long as it lives.
#pragma once

#include "common/base/log_line.hpp"
#include "common/base/result.hpp"
#include "common/discovery/beacon.hpp"
#include "common/discovery/beacon_sockets.hpp"
#include "common/net/waker.hpp"

#include <functional>
#include <string>
#include <thread>

namespace fraja::discovery {

struct Announcement {
    Beacon beacon;
    BeaconWays ways;
};

/// `bound`: where the broker listens. `advertised`: where others reach it, if not there; may be
/// empty. `farm`: its public key; null: it has none. Of `ways` those are left that lead to who can
/// reach it. Errors: invalid_argument, with what to do: nobody elsewhere can.
[[nodiscard]] Result<Announcement> announcement_of(const std::string& bound,
                                                   const std::string& advertised,
                                                   const net::PublicKey* farm, BeaconWays ways);
/// As people are told.
[[nodiscard]] std::string to_string(const BeaconWays& ways);

class Announcer {
public:
    using OnLog = std::function<void(const LogLine&)>;

    /// Begins at once. `on_log` is called from a thread of this object's, when there is no network
    /// to announce on, and when there is one again.
    Announcer(BeaconSender sender, const Beacon& beacon, OnLog on_log);
    ~Announcer();
    Announcer(const Announcer&) = delete;
    Announcer& operator=(const Announcer&) = delete;

private:
    net::Waker waker_;
    std::jthread thread_; // ends before what it uses
};

} // namespace fraja::discovery
