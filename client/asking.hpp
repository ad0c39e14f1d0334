// Asking: one question or wish to the broker, and its answer. What fraja-ctl is made of.
#pragma once

#include "client/core.hpp"
#include "client/session.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <variant>

namespace fraja::client {

/// Finds a job, and does something with it, where that is asked. Tells the state that shows it by
/// StateChanged, then is over.
struct JobQuestion {
    std::string job; ///< as FindJob takes it
    std::optional<protocol::JobDeed> deed{};
    std::int32_t priority = 0; ///< to set
};
/// Does something with a worker. Tells its state by FarmChanged, then is over.
struct WorkerQuestion {
    std::string worker; ///< as ControlWorker takes it
    protocol::WorkerDeed deed{};
};
using Question = std::variant<JobQuestion, WorkerQuestion>;

class Asking final : public Core {
public:
    Asking(Question question, SessionOptions session);

    void start(Instant now, std::vector<Action>& actions) override;
    void step(Instant now, const Event& event, std::vector<Action>& actions) override;
    [[nodiscard]] Instant next_deadline() const override;

private:
    void ask(Instant now, std::vector<Action>& actions);
    void take(Instant now, const protocol::JobState& state, std::vector<Action>& actions);
    void finish(Outcome outcome, std::vector<Action>& actions);

    Question question_;
    Session session_;
    std::optional<JobId> job_; ///< once it is found
    bool finished_ = false;
    Instant ask_due_ = Instant::never();
};

} // namespace fraja::client
