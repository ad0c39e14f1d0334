// The worker's shell: sockets, threads and the clock around its crew of sessions.
#pragma once

#include "common/base/result.hpp"
#include "common/net/sockets.hpp"
#include "common/net/waker.hpp"
#include "worker/options.hpp"
#include "worker/session.hpp"

#include <atomic>

namespace fraja::worker {

/// How another thread asks a running worker to leave. Any thread, any time, also before it runs.
class Control {
public:
    /// Take nothing more, finish the tiles at hand, say Goodbye.
    void drain() { ask(1); }
    /// Hand back the tiles at hand, say Goodbye.
    void stop_now() { ask(2); }

    // For the worker.
    [[nodiscard]] bool drain_asked() const { return asked_ >= 1; }
    [[nodiscard]] bool stop_asked() const { return asked_ >= 2; }
    [[nodiscard]] const net::Waker& waker() const { return waker_; }

private:
    void ask(int level) {
        int known = asked_;
        while (known < level && !asked_.compare_exchange_weak(known, level)) {
        }
        waker_.wake();
    }
    std::atomic<int> asked_ = 0;
    net::Waker waker_;
};

/// Serves every broker of the options and those that these tell of, one session each over the same
/// render threads, or as many workers as are emulated, each with sessions of its own, until
/// `control` says otherwise or all brokers speak another protocol version. A lost broker is greeted
/// again for ever. Or listens, and serves whoever calls. Blocks, and knows no signals.
///
/// The value is why the last session ended. Errors, before anything has been sent:
/// invalid_argument for the options, invalid_argument or io for an endpoint, limit_exceeded where
/// this process may not have as many sockets.
[[nodiscard]] Result<FinishReason> run_worker(const net::Context& context,
                                              const WorkerOptions& options, Control& control,
                                              const Limits& limits = {});

} // namespace fraja::worker
