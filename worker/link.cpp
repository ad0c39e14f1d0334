#include "worker/link.hpp"

#include "common/base/text.hpp"
#include "common/net/clock.hpp"
#include "common/protocol/codec.hpp"

#include <algorithm>
#include <utility>

namespace fraja::worker {
namespace {

using namespace std::chrono_literals;

constexpr Duration resend_pause_min = 2ms, resend_pause_max = 250ms;
constexpr Duration farewell_max = 1s;   ///< for the last answers and the Goodbye to leave
constexpr int messages_per_round = 256; ///< so that a flood does not keep the others waiting

} // namespace

Link::Link(Who who, const OnLog& on_log, Line line, Session session, Pool& pool)
    : who_(std::move(who)), on_log_(on_log), line_(std::move(line)), session_(std::move(session)),
      pool_(pool), caller_(line_.caller()), resend_pause_(resend_pause_min) {
    line_.set_linger(farewell_max);
}

void Link::step(const Event& event) {
    step_session(event);
    heed_caller();
}

void Link::receive_some() {
    for (int i = 0; i < messages_per_round; ++i) {
        const auto frames = line_.receive();
        heed_caller();
        if (!frames)
            return;
        auto message = protocol::decode(*frames);
        if (message)
            step(Received{std::move(*message)});
        else
            step(Undecodable{message.error()});
    }
}

void Link::keep_time(Instant now) {
    if (now >= resend_at_) {
        flush();
        if (std::string why = line_.refusal(); why != refusal_ && !why.empty())
            step(Undecodable{{ErrorCode::refused, refusal_ = std::move(why)}});
    }
    heed_caller();
    if (caller_ != 0 && now >= session_.next_deadline())
        step(Tick{pool_.progress(who_.index)});
}

Instant Link::next_deadline() const {
    // Without a caller there is nobody to greet.
    const Instant deadline =
        caller_ != 0 ? std::min(resend_at_, session_.next_deadline()) : Instant::never();
    return finished_ ? std::min(deadline, finished_at_ + farewell_max) : deadline;
}

bool Link::over(Instant now) const {
    return finished_ && (outbox_.empty() || now >= finished_at_ + farewell_max);
}

void Link::step_session(const Event& event) {
    actions_.clear();
    session_.step(net::now(), event, actions_);
    for (Action& action : actions_)
        std::visit([&](auto& a) { perform(std::move(a)); }, action);
    flush();
}

/// What was for another caller is for nobody; a new one is greeted.
void Link::heed_caller() {
    while (caller_ != line_.caller()) {
        outbox_.clear();
        resend_at_ = Instant::never();
        const bool one_has_gone = std::exchange(caller_, line_.caller()) != 0;
        if (one_has_gone)
            step_session(CallerGone{});
        if (caller_ != 0 && caller_ == line_.caller())
            step_session(Tick{});
    }
}

void Link::perform(Send action) {
    if (std::holds_alternative<protocol::WorkerHello>(action.message))
        outbox_.clear();
    outbox_.push_back(protocol::encode(action.message));
}

void Link::perform(Log action) {
    action.subject = who_.title;
    action.text = printable(who_.title + ": " + action.text); // a broker's own words may be in it
    if (on_log_)
        on_log_(action);
}

void Link::perform(Finished action) {
    finished_ = action.reason;
    finished_at_ = net::now();
}

/// What cannot leave (no connection yet, or a broker that does not read) is tried again soon, and
/// ever less often. It is never much: the answers that the credit allows, and the beats until the
/// silent broker is given up.
void Link::flush() {
    bool progress = false;
    while (!outbox_.empty() && line_.send(outbox_.front()) == net::SendStatus::sent) {
        outbox_.pop_front();
        progress = true;
    }
    if (outbox_.empty() || progress)
        resend_pause_ = resend_pause_min;
    else
        resend_pause_ = std::min(2 * resend_pause_, resend_pause_max);
    resend_at_ = outbox_.empty() ? Instant::never() : net::now() + resend_pause_;
}

} // namespace fraja::worker
