#include "client/asking.hpp"

#include <algorithm>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration ask_repeat = 2s; // unanswered

/// Whether that has been done with the job, by whomever.
bool shows(const protocol::JobState& state, const JobQuestion& question) {
    using enum protocol::JobPhase;
    const protocol::JobPhase phase = state.phase;
    switch (*question.deed) {
    case protocol::JobDeed::cancel:
        return protocol::is_over(phase);
    case protocol::JobDeed::pause:
        return phase == paused;
    case protocol::JobDeed::resume:
        return phase == queued || phase == running;
    case protocol::JobDeed::retry:
        return phase != failed && phase != cancelled;
    case protocol::JobDeed::set_priority:
        return state.priority == question.priority;
    }
    return true;
}

} // namespace

Asking::Asking(Question question, SessionOptions session)
    : question_(std::move(question)), session_(std::move(session)) {}

void Asking::start(Instant now, std::vector<Action>& actions) {
    session_.start(now, actions);
}

void Asking::step(Instant now, const Event& event, std::vector<Action>& actions) {
    using enum protocol::RefusalCode;
    if (finished_)
        return;
    switch (session_.step(now, event, actions)) {
    case Session::Change::refused:
    case Session::Change::gave_up:
        return finish(session_.failure(), actions);
    case Session::Change::opened:
        return ask(now, actions);
    case Session::Change::heeded:
        return;
    case Session::Change::none:
        break;
    }
    if (!session_.is_open())
        return;
    if (const auto* from = std::get_if<FromBroker>(&event)) {
        if (const auto* state = std::get_if<protocol::JobState>(&from->message))
            take(now, *state, actions);
        else if (const auto* farm = std::get_if<protocol::FarmState>(&from->message)) {
            actions.push_back(News(FarmChanged{*farm}));
            finish({}, actions);
        } else if (const auto* refused = std::get_if<protocol::Refused>(&from->message)) {
            const bool unknown = refused->code == no_such_job || refused->code == no_such_worker;
            finish({unknown ? ExitCode::no_such_job : ExitCode::usage, refused->reason}, actions);
        }
    } else if (std::holds_alternative<Tick>(event) && now >= ask_due_) {
        ask(now, actions);
    }
}

Instant Asking::next_deadline() const {
    if (finished_)
        return Instant::never();
    return std::min(session_.next_deadline(), session_.is_open() ? ask_due_ : Instant::never());
}

void Asking::ask(Instant now, std::vector<Action>& actions) {
    ask_due_ = now + ask_repeat;
    if (const auto* worker = std::get_if<WorkerQuestion>(&question_))
        return actions.emplace_back(Send{protocol::ControlWorker{worker->worker, worker->deed}}),
               void();
    const auto& question = std::get<JobQuestion>(question_);
    if (job_)
        actions.emplace_back(Send{protocol::ControlJob{*job_, *question.deed, question.priority}});
    else
        actions.emplace_back(Send{protocol::FindJob{question.job}});
}

void Asking::take(Instant now, const protocol::JobState& state, std::vector<Action>& actions) {
    const auto* question = std::get_if<JobQuestion>(&question_);
    if (!question || (job_ && state.job != *job_))
        return;
    if (!job_ && question->deed) {
        job_ = state.job;
        return ask(now, actions);
    }
    // The answer to a FindJob may come again, and says nothing of what was asked for since.
    if (question->deed && !shows(state, *question))
        return;
    actions.push_back(News(StateChanged{state}));
    finish({}, actions);
}

void Asking::finish(Outcome outcome, std::vector<Action>& actions) {
    finished_ = true;
    actions.push_back(News(Finished{std::move(outcome)}));
}

} // namespace fraja::client
