// Submission: hands a job to a broker and follows it to its end.
//
// The same words may be said twice without harm, because the client makes the job's id: so whenever
// no answer comes, or a broker comes back that does not know the job, it is submitted again.
#pragma once

#include "client/core.hpp"
#include "client/follower.hpp"
#include "client/session.hpp"

#include <optional>

namespace fraja::client {

struct SubmissionRequest {
    protocol::SubmitJob job; ///< `scene` and `scene_bytes` are those of `scene_text`
    Blob scene_text;
    SessionOptions session;
    bool detach = false;             ///< done as soon as the job is acknowledged
    std::optional<Duration> timeout; ///< from the start; the job goes on
    /// Of a job with a time limit: it is made shorter when the job is first sent, so as to end
    /// then.
    std::optional<Instant> ends_at = std::nullopt;
};

class Submission final : public Core {
public:
    Submission(SubmissionRequest request, Rng rng);

    void start(Instant now, std::vector<Action>& actions) override;
    void step(Instant now, const Event& event, std::vector<Action>& actions) override;
    [[nodiscard]] Instant next_deadline() const override;

    [[nodiscard]] bool is_accepted() const { return follower_.has_value(); }
    [[nodiscard]] const Follower* follower() const { return follower_ ? &*follower_ : nullptr; }
    [[nodiscard]] const Session& session() const { return session_; }

private:
    void submit(Instant now, std::vector<Action>& actions);
    void take(Instant now, const protocol::JobState& state, std::vector<Action>& actions);
    void take(Instant now, const protocol::NeedChunk& need, std::vector<Action>& actions);
    void take(const protocol::Refused& refused, std::vector<Action>& actions);
    void follow(Instant now, const Event& event, std::vector<Action>& actions);
    void finish(Outcome outcome, std::vector<Action>& actions);

    SubmissionRequest request_;
    Rng rng_;
    Session session_;
    std::optional<Follower> follower_;
    bool submitting_ = false; ///< SubmitJob is not acknowledged on this session
    bool accepted_ = false;   ///< it was, once
    bool finished_ = false;
    Instant submit_due_ = Instant::never();
    Instant times_out_ = Instant::never();
};

/// How a program that followed a job ends, when the job is over.
[[nodiscard]] Outcome outcome_of(const protocol::JobState& state);

} // namespace fraja::client
