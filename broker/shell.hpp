// The broker's shell: sockets and the clock around the dispatcher. It moves bytes and decides
// nothing.
#pragma once

#include "broker/events.hpp"
#include "broker/limits.hpp"
#include "broker/report.hpp"
#include "broker/upstream.hpp"
#include "common/base/instant.hpp"
#include "common/base/log_line.hpp"
#include "common/base/result.hpp"
#include "common/net/endpoint.hpp"
#include "common/net/signals.hpp"
#include "common/net/sockets.hpp"
#include "common/net/waker.hpp"

#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace fraja::broker {

/// How other threads talk to a running broker.
class Control {
public:
    void stop() {
        stop_ = true;
        waker_.wake();
    }
    [[nodiscard]] bool stopping() const { return stop_; }
    [[nodiscard]] const net::Waker& waker() const { return waker_; }

private:
    std::atomic<bool> stop_ = false;
    net::Waker waker_;
};

inline constexpr Duration report_interval = std::chrono::seconds(1);

struct Options {
    std::string bind = net::default_broker;    ///< workers and clients
    std::string publish = net::default_stream; ///< the stream
    bool insecure =
        false; ///< allow endpoints that other machines can reach, though nobody has keys
    std::vector<std::string> peers; ///< brokers that stand for this one, as endpoints
    std::string advertise; ///< where these and all others reach it; empty: where it is bound
    /// Whose keys may come in (net::AllowList), read at the start and again at HUP; then the
    /// context has keys. Empty: everybody.
    std::filesystem::path allow;
    std::vector<std::string> call; ///< workers that listen (fraja-worker --listen), as endpoints
    Limits limits;
    std::filesystem::path state; ///< where jobs are kept; empty: in memory alone
    UpstreamOptions upstream;    ///< whom this broker serves as a worker

    /// Called once, when both sockets are bound, with their real endpoints.
    std::function<void(const std::string& bound, const std::string& stream)> on_listening;
    std::function<void(const LogLine&)> on_log;
    /// Called from the loop, at its first turn and then every second: as long as it turns.
    std::function<void(const Report&)> on_report;
    /// Called from the loop at HUP: the limits from now on, as Dispatcher::change_limits() takes
    /// them; nothing: they stay.
    std::function<std::optional<Limits>()> on_hangup;
    std::function<void()> on_stopping; ///< called from the loop, when a signal ends it
    const net::SignalWatch* signals =
        nullptr; ///< INT and TERM stop it, HUP rereads, USR1 dumps the state to the log
};

/// Runs until it is told to stop. Errors: those of AllowList::read; invalid_argument for endpoints
/// that make no sense or demand keys; io when they cannot be bound; those of Store::open and
/// StoreReader::read; io when it stopped and not all could be written.
[[nodiscard]] Result<void> run_broker(const net::Context& context, const Options& options,
                                      const Control& control);

} // namespace fraja::broker
