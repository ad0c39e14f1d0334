// Shell: carries a core's words to a broker and back. One loop, one thread, no decisions.
#pragma once

#include "client/core.hpp"
#include "client/submission.hpp"
#include "common/net/signals.hpp"
#include "common/net/sockets.hpp"

#include <cstdint>
#include <memory>
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

/// A core's conversation as one of several that a loop holds side by side.
class Conversation {
public:
    /// What is said of a broker that was not reached, after a look at what keeps it from being so.
    enum class Advice : std::uint8_t {
        none, ///< and nothing is looked at, as that would keep the others waiting
        broker,
        broker_or_local, ///< the job could be drawn here
    };
    /// Begins it. All of these must outlive this.
    Conversation(const net::Context& context, Core& core, Listener& listener, Advice advice);
    ~Conversation();
    Conversation(const Conversation&) = delete;
    Conversation& operator=(const Conversation&) = delete;

    /// Reads what there is, and answers. False: more is there, so do not wait.
    bool turn();
    /// The core's last word, or its listener's; nothing as long as it goes on.
    [[nodiscard]] const std::optional<Outcome>& outcome() const;
    /// Appends what the next turn is to wait for.
    void wait_also(std::vector<net::Waitable>& all) const;
    /// When it is due at the latest.
    [[nodiscard]] Instant due() const;
    /// After the last turn.
    void take_leave();

private:
    class Port;
    class State;
    std::unique_ptr<State> state_;
};

/// Submits a job, and follows it unless it is detached.
[[nodiscard]] Outcome run_submission(const net::Context& context, SubmissionRequest request,
                                     Listener& listener, const net::SignalWatch* signals);

} // namespace fraja::client
