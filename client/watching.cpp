#include "client/watching.hpp"

#include "client/progress.hpp"
#include "client/submission.hpp"
#include "common/protocol/topics.hpp"

#include <algorithm>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration find_repeat = 2s; // unanswered
// A broker that restarted without a memory knows a job again when its client submits it again, some
// seconds later.
constexpr Duration forgotten_grace = 10s, forgotten_repeat = 1s;

} // namespace

JobWatching::JobWatching(WatchRequest request, Rng rng)
    : request_(std::move(request)), rng_(rng), session_(request_.session) {}

void JobWatching::start(Instant now, std::vector<Action>& actions) {
    session_.start(now, actions);
}

void JobWatching::step(Instant now, const Event& event, std::vector<Action>& actions) {
    if (finished_)
        return;
    switch (session_.step(now, event, actions)) {
    case Session::Change::refused:
    case Session::Change::gave_up:
        return finish(session_.failure(), actions);
    case Session::Change::opened:
        if (follower_) {
            actions.push_back(OpenStream{session_.welcome().stream});
            ask_again_ = Instant::never(); // it is asked now
            follower_->start(now, actions);
        } else {
            find(now, actions);
        }
        break;
    case Session::Change::heeded:
        return;
    case Session::Change::none:
        break;
    }
    if (!follower_) {
        const auto* from = std::get_if<FromBroker>(&event);
        const auto* state = from ? std::get_if<protocol::JobState>(&from->message) : nullptr;
        const auto* refused = from ? std::get_if<protocol::Refused>(&from->message) : nullptr;
        using enum protocol::RefusalCode;
        if (state && session_.is_open())
            take(now, *state, actions);
        else if (refused && refused->code == no_such_job)
            return finish({ExitCode::no_such_job, refused->reason}, actions);
        else if (refused && refused->code != unknown_peer)
            return finish({ExitCode::usage, refused->reason}, actions);
        else if (std::holds_alternative<Tick>(event) && session_.is_open() && now >= find_due_)
            find(now, actions);
    }
    if (!follower_ || (!session_.is_open() && std::holds_alternative<Tick>(event)))
        return;
    follower_->step(now, event, actions);
    if (follower_->is_forgotten())
        return wait_for_return(now, event, actions);
    look_whether_done(actions);
}

void JobWatching::wait_for_return(Instant now, const Event& event, std::vector<Action>& actions) {
    const bool restarted = session_.welcome().epoch != follower_->state().epoch;
    if (forgotten_at_ == Instant::never())
        forgotten_at_ = now;
    if (!restarted || now >= forgotten_at_ + forgotten_grace)
        return finish({ExitCode::no_such_job, "the broker does not know the job any more"},
                      actions);
    if (std::holds_alternative<FromBroker>(event))
        ask_again_ = std::min(ask_again_, now + forgotten_repeat);
    if (!std::holds_alternative<Tick>(event) || now < ask_again_)
        return;
    ask_again_ = Instant::never();
    follower_->start(now, actions);
}

Instant JobWatching::next_deadline() const {
    if (finished_)
        return Instant::never();
    if (!session_.is_open())
        return session_.next_deadline();
    return std::min(
        {session_.next_deadline(), follower_ ? follower_->next_deadline() : find_due_, ask_again_});
}

void JobWatching::find(Instant now, std::vector<Action>& actions) {
    find_due_ = now + find_repeat;
    actions.push_back(Send{protocol::FindJob{request_.job}});
}

void JobWatching::take(Instant now, const protocol::JobState& state, std::vector<Action>& actions) {
    if (!Follower::is_sound(state))
        return;
    session_.set_patient(true);
    actions.push_back(News(Accepted{state}));
    follower_.emplace(state, rng_);
    actions.push_back(OpenStream{session_.welcome().stream});
    follower_->start(now, actions);
}

void JobWatching::look_whether_done(std::vector<Action>& actions) {
    const Follower& f = *follower_;
    if (f.is_complete())
        return finish(outcome_of(f.state()), actions);
    const bool limited = f.state().settings.limited_in_time(); // tells no number of tiles
    const double share = limited ? share_done(f.state())
                                 : f.have_count() / static_cast<double>(f.state().cell_count);
    if (request_.until.share < 1 && f.have_count() > 0 && share >= request_.until.share)
        return finish({}, actions);
    if (request_.until.once && f.has_caught_up())
        return finish(outcome_of(f.state()), actions);
}

void JobWatching::finish(Outcome outcome, std::vector<Action>& actions) {
    finished_ = true;
    actions.push_back(News(Finished{std::move(outcome)}));
}

FarmWatching::FarmWatching(SessionOptions session) : session_(std::move(session)) {}

void FarmWatching::start(Instant now, std::vector<Action>& actions) {
    session_.start(now, actions);
}

void FarmWatching::step(Instant now, const Event& event, std::vector<Action>& actions) {
    if (finished_)
        return;
    switch (session_.step(now, event, actions)) {
    case Session::Change::refused:
    case Session::Change::gave_up:
        finished_ = true;
        actions.push_back(News(Finished{session_.failure()}));
        return;
    case Session::Change::opened:
        session_.set_patient(true);
        actions.push_back(OpenStream{session_.welcome().stream});
        actions.push_back(Subscribe{std::string(protocol::farm_topic)});
        break;
    case Session::Change::heeded:
        return;
    case Session::Change::none:
        break;
    }
    if (const auto* stream = std::get_if<FromStream>(&event))
        if (const auto* farm = std::get_if<protocol::FarmState>(&stream->message))
            actions.push_back(News(FarmChanged{*farm}));
}

Instant FarmWatching::next_deadline() const {
    return finished_ ? Instant::never() : session_.next_deadline();
}

} // namespace fraja::client
