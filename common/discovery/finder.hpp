// Finder: listens for beacons and asks the DNS, each source in a thread of its own, so that
// whoever looks for a broker waits for nothing but a descriptor.
#pragma once

#include "common/base/instant.hpp"
#include "common/discovery/beacon.hpp"
#include "common/discovery/srv_lookup.hpp"
#include "common/net/waker.hpp"

#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace fraja::discovery {

/// What is known of a source from now on.
struct Findings {
    std::string source;
    std::vector<std::string> endpoints; ///< as sockets connect to them; in the order to be tried in
    std::string trouble;                ///< why there are none, where that is known; for people
    friend bool operator==(const Findings&, const Findings&) = default;
};

struct FinderOptions {
    std::optional<Fingerprint> farm = {}; ///< whose brokers alone; nothing: those without keys
    DnsOptions dns = {};
    /// Between two questions for a name, as long as somebody wants a broker: first, and doubled
    /// each time up to the longest.
    Duration pause_first = std::chrono::seconds(1), pause_max = std::chrono::seconds(60);
};

/// For the brokers of that farm; null: for those without keys.
[[nodiscard]] FinderOptions finder_options(const net::PublicKey* farm);

class Finder {
public:
    /// Looks at once, at each of these sources.
    Finder(const std::vector<std::string>& sources, FinderOptions options);
    ~Finder();
    Finder(const Finder&) = delete;
    Finder& operator=(const Finder&) = delete;

    /// Whether somebody is without a broker, as at the beginning: names are asked for again and
    /// again as long as that is so, and soon when it begins to be. Beacons are heard always.
    void set_wanted(bool wanted);
    /// Readable when take() may return something. The waker's.
    [[nodiscard]] int fd() const;
    /// What has changed since the last call, each source once.
    [[nodiscard]] std::vector<Findings> take();

private:
    struct Search;
    struct State;
    std::unique_ptr<State> state_;
};

/// What that source tells first: endpoints, or why there are none; at most `timeout` later.
[[nodiscard]] Findings find_now(const std::string& source, const FinderOptions& options,
                                Duration timeout);

} // namespace fraja::discovery
