#include "common/discovery/finder.hpp"

#include "common/base/ids.hpp"
#include "common/base/text.hpp"
#include "common/discovery/beacon_sockets.hpp"
#include "common/discovery/sightings.hpp"
#include "common/discovery/source.hpp"
#include "common/net/clock.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <mutex>
#include <poll.h>
#include <system_error>
#include <thread>
#include <utility>

namespace fraja::discovery {
namespace {

/// Between two looks for interfaces that have come.
constexpr Duration join_interval = std::chrono::seconds(10);
/// So many datagrams are read in a turn; whoever sends more costs no more than that.
constexpr int datagrams_per_turn_max = 256;
constexpr Duration turn = std::chrono::milliseconds(100);

int milliseconds_until(Instant then) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(
        std::clamp<Duration>(then - net::now(), Duration::zero(), std::chrono::hours(1)));
    return static_cast<int>(left.count());
}

} // namespace

/// What the threads of all sources meet at.
struct Finder::State {
    explicit State(FinderOptions options_) : options(std::move(options_)) {}

    const FinderOptions options;
    net::Waker changed;
    std::mutex mutex;
    bool wanted = true;                     // under the mutex, as what follows
    std::map<std::string, Findings> untold; // by source
    std::vector<std::unique_ptr<Search>> searches;

    void tell(Findings findings) {
        {
            const std::lock_guard lock(mutex);
            untold[findings.source] = std::move(findings);
        }
        changed.wake();
    }
    [[nodiscard]] bool is_wanted() {
        const std::lock_guard lock(mutex);
        return wanted;
    }
};

/// A source's thread.
struct Finder::Search {
    Search(State& state, std::string source) : state_(state), source_(std::move(source)) {
        try {
            thread_ = std::jthread([this](const std::stop_token& stop) {
                source_ == beacon_source ? hear_beacons(stop) : ask_dns(stop);
            });
        } catch (const std::system_error& e) {
            tell({}, std::string("no thread can be had for it: ") + e.what());
        }
    }
    ~Search() {
        thread_.request_stop();
        waker_.wake();
    }
    Search(const Search&) = delete;
    Search& operator=(const Search&) = delete;

    void wake() const { waker_.wake(); }

private:
    /// What is known already is not told again.
    void tell(std::vector<std::string> endpoints, std::string trouble) {
        Findings findings{source_, std::move(endpoints), std::move(trouble)};
        if (told_ != findings)
            state_.tell(*(told_ = std::move(findings)));
    }

    /// Until one of these is readable, or then.
    void wait(std::array<int, 2> fds, Instant then) const {
        std::array<pollfd, 3> entries = {
            {{waker_.fd(), POLLIN, 0}, {fds[0], POLLIN, 0}, {fds[1], POLLIN, 0}}};
        (void)::poll(entries.data(), entries.size(), milliseconds_until(then));
        if (entries[0].revents != 0)
            waker_.drain();
    }
    void sleep_until(Instant then, const std::stop_token& stop) const {
        while (!stop.stop_requested() && net::now() < then)
            wait({-1, -1}, then);
    }

    void hear_beacons(const std::stop_token& stop) {
        while (!stop.stop_requested()) {
            if (const auto receiver = BeaconReceiver::open()) {
                hear_beacons(*receiver, stop);
            } else {
                tell({}, "announcements cannot be heard: " + receiver.error().message);
                sleep_until(net::now() + join_interval, stop);
            }
        }
    }

    void hear_beacons(const BeaconReceiver& receiver, const std::stop_token& stop) {
        Sightings sightings(state_.options.farm);
        Instant join_due = net::now() + join_interval;
        while (!stop.stop_requested()) {
            int count = 0;
            for (; count < datagrams_per_turn_max; ++count) {
                const auto datagram = receiver.receive();
                if (!datagram)
                    break;
                sightings.hear(net::now(), datagram->bytes, datagram->sender);
            }
            sightings.expire(net::now());
            tell(sightings.endpoints(), trouble_of(sightings));
            if (count == datagrams_per_turn_max)
                sleep_until(net::now() + turn, stop);
            else
                wait({receiver.fd(), receiver.fd6()},
                     std::min(join_due, sightings.next_deadline()));
            if (net::now() >= join_due) {
                receiver.join_groups();
                join_due = net::now() + join_interval;
            }
        }
    }

    /// Numbers would change all the time.
    [[nodiscard]] std::string trouble_of(const Sightings& sightings) const {
        if (!sightings.endpoints().empty())
            return {};
        if (sightings.count(Sightings::Verdict::other_farm) > 0)
            return state_.options.farm
                       ? "only brokers of other farms, or without keys, announce themselves here"
                       : "only brokers with keys announce themselves here, and there are none "
                         "(--key-file)";
        if (sightings.count(Sightings::Verdict::other_version) > 0)
            return "only brokers of another release announce themselves here";
        return {};
    }

    void ask_dns(const std::stop_token& stop) {
        Rng rng = fresh_rng();
        Duration pause = state_.options.pause_first;
        while (!stop.stop_requested()) {
            auto records = look_up_srv(srv_name(source_), state_.options.dns, {stop, &waker_});
            if (stop.stop_requested())
                return;
            if (records) {
                found_ = endpoints_in_order(*std::move(records), rng);
                tell(found_,
                     found_.empty() ? "its SRV records name no host that can be reached" : "");
            } else if (records.error().code == ErrorCode::not_found) {
                found_.clear();
                tell({}, records.error().message);
            } else { // what was known may still hold
                tell(found_, records.error().message);
            }
            // Many that have lost one broker do not all ask at once.
            const double jitter = rng.between(0.75, 1.25);
            const Instant soonest =
                net::now() + from_seconds(seconds(state_.options.pause_first) * jitter);
            Instant next = net::now() + from_seconds(seconds(pause) * jitter);
            pause = std::min(2 * pause, state_.options.pause_max);
            for (bool wanted = true; !stop.stop_requested(); wanted = state_.is_wanted()) {
                if (!wanted) { // whoever begins to want one waits no longer than at first
                    pause = state_.options.pause_first;
                    next = soonest;
                } else if (net::now() >= next) {
                    break;
                }
                wait({-1, -1}, wanted ? next : Instant::never());
            }
        }
    }

    State& state_;
    const std::string source_;
    net::Waker waker_;
    std::optional<Findings> told_;
    std::vector<std::string> found_; // by name, the last time
    std::jthread thread_;            // ends before what it uses
};

Finder::Finder(const std::vector<std::string>& sources, FinderOptions options)
    : state_(std::make_unique<State>(std::move(options))) {
    for (const std::string& source : sources)
        state_->searches.push_back(std::make_unique<Search>(*state_, source));
}

Finder::~Finder() {
    state_->searches.clear(); // before what they tell
}

void Finder::set_wanted(bool wanted) {
    {
        const std::lock_guard lock(state_->mutex);
        if (std::exchange(state_->wanted, wanted) == wanted)
            return;
    }
    for (const auto& search : state_->searches)
        search->wake();
}

int Finder::fd() const {
    return state_->changed.fd();
}

std::vector<Findings> Finder::take() {
    state_->changed.drain();
    const std::lock_guard lock(state_->mutex);
    std::vector<Findings> all;
    for (auto& [source, findings] : std::exchange(state_->untold, {}))
        all.push_back(std::move(findings));
    return all;
}

FinderOptions finder_options(const net::PublicKey* farm) {
    FinderOptions options;
    if (farm)
        options.farm = fingerprint_of(*farm);
    return options;
}

Findings find_now(const std::string& source, const FinderOptions& options, Duration timeout) {
    const Instant end = net::now() + timeout;
    Finder finder({source}, options);
    Findings last{source, {}, {}};
    while (last.endpoints.empty() && net::now() < end) {
        pollfd readable{finder.fd(), POLLIN, 0};
        (void)::poll(&readable, 1, milliseconds_until(end));
        for (Findings& findings : finder.take())
            last = std::move(findings);
        if (source != beacon_source && !last.trouble.empty())
            break;
    }
    if (last.endpoints.empty() && last.trouble.empty())
        last.trouble = source == beacon_source ? nobody_announced : "the DNS does not answer yet";
    return last;
}

} // namespace fraja::discovery
