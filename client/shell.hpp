// Shell: carries a core's words to a broker and back. One loop, one thread, no decisions.
#pragma once

#include "client/core.hpp"
#include "client/submission.hpp"
#include "common/net/signals.hpp"
#include "common/net/sockets.hpp"

#include <optional>
#include <vector>

namespace fraja::client {

/// What a program does with the news of its core.
class Listener {
public:
    virtual ~Listener() = default;
    virtual void hear(Instant now, const News& news) = 0;
    /// Called every time the loop has read what there was. Returns when it wants to be called next
    /// at the latest.
    virtual Instant tick(Instant now) {
        (void)now;
        return Instant::never();
    }
    /// Appends what else is to be waited for: a tick is due when one of these can be read or
    /// written.
    virtual void wait_also(std::vector<net::Waitable>& all) const { (void)all; }
    /// Asked after every tick: whether the program has had enough, and how it then ends.
    virtual std::optional<Outcome> wants_to_leave() { return std::nullopt; }
};

/// How a program ends that was told to by SIGINT or SIGTERM.
[[nodiscard]] Outcome outcome_of(int signal);

/// Holds the core's conversation over `context` until it is over, and returns its last word; when a
/// signal comes, `interrupted` or `terminated`. Takes leave of the broker in any case. Endpoints
/// may be tcp, ipc or inproc. `signals` may be null.
[[nodiscard]] Outcome converse(const net::Context& context, Core& core, Listener& listener,
                               const net::SignalWatch* signals);

/// Submits a job, and follows it unless it is detached.
[[nodiscard]] Outcome run_submission(const net::Context& context, SubmissionRequest request,
                                     Listener& listener, const net::SignalWatch* signals);

} // namespace fraja::client
