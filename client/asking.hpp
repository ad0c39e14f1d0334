// Asking: one question to the broker, and its answer. What fraja-ctl is made of.
#pragma once

#include "client/core.hpp"
#include "client/session.hpp"

#include <string>

namespace fraja::client {

/// Finds a job; and cancels it, where that is asked. Tells the state by StateChanged, then is over.
struct JobQuestion {
    std::string job; ///< as FindJob takes it
    bool cancel = false;
};

class Asking final : public Core {
public:
    Asking(JobQuestion question, SessionOptions session);

    void start(Instant now, std::vector<Action>& actions) override;
    void step(Instant now, const Event& event, std::vector<Action>& actions) override;
    [[nodiscard]] Instant next_deadline() const override;

private:
    void ask(Instant now, std::vector<Action>& actions);
    void take(Instant now, const protocol::JobState& state, std::vector<Action>& actions);
    void finish(Outcome outcome, std::vector<Action>& actions);

    JobQuestion question_;
    Session session_;
    bool found_ = false;
    JobId job_; ///< once found
    bool finished_ = false;
    Instant ask_due_ = Instant::never();
};

} // namespace fraja::client
