#include "client/submission.hpp"

#include "common/protocol/limits.hpp"

#include <algorithm>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr protocol::Version checks_since = 12;
constexpr Duration submit_repeat = 2s;     // without a sign of an answer
constexpr Duration least_time_limit = 1ms; // where getting so far has used up all of it

} // namespace

Submission::Submission(SubmissionRequest request, Rng rng)
    : request_(std::move(request)), rng_(rng), session_(request_.session) {
    FRAJA_ASSERT(request_.scene_text.size() == request_.job.scene_bytes);
}

void Submission::start(Instant now, std::vector<Action>& actions) {
    if (request_.timeout)
        times_out_ = now + *request_.timeout;
    session_.start(now, actions);
}

void Submission::step(Instant now, const Event& event, std::vector<Action>& actions) {
    if (finished_)
        return;
    switch (session_.step(now, event, actions)) {
    case Session::Change::refused:
    case Session::Change::gave_up:
        return finish(session_.failure(), actions);
    case Session::Change::opened:
        if (follower_) {
            actions.push_back(OpenStream{session_.welcome().stream});
            follower_->start(now, actions);
        } else {
            submit(now, actions);
        }
        break;
    case Session::Change::heeded:
        return;
    case Session::Change::none:
        break;
    }
    if (const auto* from = std::get_if<FromBroker>(&event)) {
        if (const auto* state = std::get_if<protocol::JobState>(&from->message))
            take(now, *state, actions);
        else if (const auto* need = std::get_if<protocol::NeedChunk>(&from->message))
            take(now, *need, actions);
        else if (const auto* refused = std::get_if<protocol::Refused>(&from->message))
            take(*refused, actions);
    }
    if (!finished_ && follower_)
        follow(now, event, actions);
    if (finished_ || !std::holds_alternative<Tick>(event))
        return;
    if (now >= times_out_)
        return finish({ExitCode::timed_out, "the time is up; the job goes on"}, actions);
    if (submitting_ && session_.is_open() && now >= submit_due_)
        submit(now, actions);
}

Instant Submission::next_deadline() const {
    if (finished_)
        return Instant::never();
    return std::min(
        {session_.next_deadline(), times_out_,
         submitting_ && session_.is_open() ? submit_due_ : Instant::never(),
         follower_ && session_.is_open() ? follower_->next_deadline() : Instant::never()});
}

void Submission::submit(Instant now, std::vector<Action>& actions) {
    if (request_.job.wishes.verify > 0 && session_.spoken() < checks_since)
        return finish({ExitCode::refused, session_.broker() +
                                              ": the broker is too old to have tiles checked "
                                              "(--verify): it speaks protocol version " +
                                              std::to_string(session_.spoken()) +
                                              ", and must be updated"},
                      actions);
    submitting_ = true;
    submit_due_ = now + submit_repeat;
    // Once: a job that is sent again must be the same.
    if (const auto ends_at = std::exchange(request_.ends_at, std::nullopt))
        request_.job.settings.time_limit =
            std::clamp(*ends_at - now, least_time_limit, request_.job.settings.time_limit);
    actions.push_back(Send{request_.job});
}

void Submission::take(Instant now, const protocol::JobState& state, std::vector<Action>& actions) {
    const bool ours = state.job == request_.job.job || request_.job.resume;
    if (!submitting_ || !ours || state.scene != request_.job.scene ||
        state.settings != request_.job.settings || !Follower::is_sound(state))
        return;
    request_.job.job = state.job; // it may be one that is taken over
    submit_due_ = now + submit_repeat;
    if (state.phase == protocol::JobPhase::waiting_for_scene)
        return;
    submitting_ = false;
    accepted_ = true;
    actions.push_back(News(Accepted{state}));
    if (request_.detach)
        return finish({}, actions);
    session_.set_patient(true);
    follower_.emplace(state, rng_);
    (void)rng_.next(); // another follower makes other nonces
    actions.push_back(OpenStream{session_.welcome().stream});
    follower_->start(now, actions);
}

void Submission::take(Instant now, const protocol::NeedChunk& need, std::vector<Action>& actions) {
    const Blob& text = request_.scene_text;
    if (need.blob != request_.job.scene || need.offset_bytes % protocol::chunk_bytes != 0 ||
        (need.offset_bytes >= text.size() && need.offset_bytes != 0)) {
        actions.push_back(Send{protocol::Refused{protocol::RefusalCode::invalid, request_.job.job,
                                                 "the scene has no such chunk"}});
        return;
    }
    submit_due_ = now + submit_repeat;
    const auto size =
        std::min<std::uint64_t>(protocol::chunk_bytes, text.size() - need.offset_bytes);
    actions.push_back(Send{protocol::Chunk{
        need.blob, need.offset_bytes, text.size(), {text.part(need.offset_bytes, size)}}});
}

void Submission::take(const protocol::Refused& refused, std::vector<Action>& actions) {
    using enum protocol::RefusalCode;
    const bool ours = refused.job == request_.job.job || refused.job == JobId{};
    if (!submitting_ || !ours || refused.code == unknown_peer || refused.code == no_such_job)
        return;
    if (accepted_ && refused.code == limit_exceeded)
        return; // it was taken once, by a broker that stands for this one: it is asked again
    finish({ExitCode::usage, "the broker does not take the job: " + refused.reason}, actions);
}

void Submission::follow(Instant now, const Event& event, std::vector<Action>& actions) {
    // Its timers rest while there is no session; what the stream still brings is welcome.
    if (!session_.is_open() && std::holds_alternative<Tick>(event))
        return;
    follower_->step(now, event, actions);
    if (follower_->is_complete())
        return finish(outcome_of(follower_->state()), actions);
    // A broker without a memory restarted; it may have heard a late SubmitJob since.
    if (follower_->is_forgotten() ||
        follower_->state().phase == protocol::JobPhase::waiting_for_scene) {
        follower_.reset();
        submitting_ = true;
        submit_due_ = now + submit_repeat; // not at once: it must not become a loop
    }
}

void Submission::finish(Outcome outcome, std::vector<Action>& actions) {
    finished_ = true;
    actions.push_back(News(Finished{std::move(outcome)}));
}

Outcome outcome_of(const protocol::JobState& state) {
    switch (state.phase) {
    case protocol::JobPhase::failed:
        return {ExitCode::job_failed, state.reason.empty() ? "the job failed" : state.reason};
    case protocol::JobPhase::cancelled:
        return {ExitCode::cancelled, state.reason.empty() ? "the job was cancelled" : state.reason};
    default:
        return {};
    }
}

} // namespace fraja::client
