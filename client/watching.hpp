// Watching: finds a job and follows it; or the farm's state as it comes.
#pragma once

#include "client/core.hpp"
#include "client/follower.hpp"
#include "client/session.hpp"

#include <optional>
#include <string>

namespace fraja::client {

/// When a watcher leaves by itself.
struct WatchUntil {
    /// Leave when this share of the tiles is here, in 0..1, at least one tile. 1: when the job is
    /// over, with the job's exit code; below 1 the watcher's wish is fulfilled, and that is 0.
    double share = 1;
    /// Leave when everything that was finished at the time is here.
    bool once = false;
};

struct WatchRequest {
    std::string job; ///< as FindJob takes it
    SessionOptions session;
    WatchUntil until;
};

class JobWatching final : public Core {
public:
    JobWatching(WatchRequest request, Rng rng);

    void start(Instant now, std::vector<Action>& actions) override;
    void step(Instant now, const Event& event, std::vector<Action>& actions) override;
    [[nodiscard]] Instant next_deadline() const override;

    [[nodiscard]] const Follower* follower() const { return follower_ ? &*follower_ : nullptr; }

private:
    void find(Instant now, std::vector<Action>& actions);
    void take(Instant now, const protocol::JobState& state, std::vector<Action>& actions);
    void wait_for_return(Instant now, const Event& event, std::vector<Action>& actions);
    void look_whether_done(std::vector<Action>& actions);
    void finish(Outcome outcome, std::vector<Action>& actions);

    WatchRequest request_;
    Rng rng_;
    Session session_;
    std::optional<Follower> follower_;
    bool finished_ = false;
    Instant find_due_ = Instant::never();     ///< while the job is being looked for
    Instant forgotten_at_ = Instant::never(); ///< by a broker that had restarted
    Instant ask_again_ = Instant::never();    ///< whether it knows the job by now
};

class FarmWatching final : public Core {
public:
    explicit FarmWatching(SessionOptions session);

    void start(Instant now, std::vector<Action>& actions) override;
    void step(Instant now, const Event& event, std::vector<Action>& actions) override;
    [[nodiscard]] Instant next_deadline() const override;

private:
    Session session_;
    bool finished_ = false;
};

} // namespace fraja::client
