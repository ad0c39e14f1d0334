// Link: a session that is alone, on its wire.
#pragma once

#include "common/base/instant.hpp"
#include "common/net/sockets.hpp"
#include "worker/pool.hpp"
#include "worker/session.hpp"
#include "worker/wire.hpp"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace fraja::worker {

/// Used by one thread, whose loop it never blocks.
class Link {
public:
    struct Who {
        SessionIndex index{};
        std::string title; ///< in the log
    };
    using OnLog = Wire::OnLog;

    /// `on_log`, which may be empty, and `pool` must outlive this.
    Link(Who who, const OnLog& on_log, Line line, Session session, Pool& pool);

    void step(const Event& event);
    /// As much as there is, but for a flood.
    void receive_some();
    void keep_time(Instant now);
    [[nodiscard]] Instant next_deadline() const;

    [[nodiscard]] std::optional<FinishReason> finished() const { return finished_; }
    /// Nothing is left to do, or it has taken too long.
    [[nodiscard]] bool over(Instant now) const { return finished_ && wire_.is_over(now); }
    [[nodiscard]] const net::Socket& socket() const { return wire_.socket(); }

private:
    void step_session(const Event& event);
    void perform(const Send& action) { wire_.post(action); }
    void perform(CompileScene action) { pool_.perform(index_, std::move(action)); }
    void perform(const StartTile& action) { pool_.perform(index_, action); }
    void perform(const StopTile& action) { pool_.perform(index_, action); }
    void perform(const ForgetScene& action) { pool_.perform(index_, action); }
    void perform(HangUp action) { wire_.hang_up(action); }
    void perform(Log action) { wire_.log(std::move(action)); }
    void perform(Finished action);

    SessionIndex index_;
    Wire wire_;
    Session session_;
    Pool& pool_;
    std::vector<Action> actions_;
    std::optional<FinishReason> finished_;
};

} // namespace fraja::worker
