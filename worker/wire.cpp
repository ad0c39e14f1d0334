#include "worker/wire.hpp"

#include "common/base/text.hpp"
#include "common/net/clock.hpp"

#include <algorithm>
#include <chrono>

namespace fraja::worker {
namespace {

using namespace std::chrono_literals;

constexpr Duration resend_pause_min = 2ms, resend_pause_max = 250ms;

} // namespace

Wire::Wire(std::string title, const OnLog& on_log, Line line)
    : title_(std::move(title)), on_log_(on_log), line_(std::move(line)), caller_(line_.caller()),
      resend_pause_(resend_pause_min) {
    line_.set_linger(farewell_max);
}

std::optional<Event> Wire::receive() {
    if (!received_)
        received_ = line_.receive();
    if (auto event = heed_line())
        return event; // and then what that one has said
    if (!received_)
        return std::nullopt;
    const net::Frames frames = *std::exchange(received_, std::nullopt);
    auto message = protocol::decode(frames);
    if (!message)
        return Undecodable{message.error()};
    return Received{std::move(*message), *protocol::version_of(frames)};
}

std::optional<Event> Wire::heed_line() {
    look_at_line();
    if (of_line_.empty())
        return std::nullopt;
    Event event = std::move(of_line_.front());
    of_line_.pop_front();
    return event;
}

/// What was for another caller is for nobody.
void Wire::look_at_line() {
    if (const std::string& why = line_.refusal(); why != refusal_ && !why.empty())
        of_line_.emplace_back(Undecodable{{ErrorCode::refused, refusal_ = why}});
    if (caller_ == line_.caller())
        return;
    outbox_.clear();
    resend_at_ = Instant::never();
    std::erase_if(of_line_, [](const Event& event) { return std::holds_alternative<Tick>(event); });
    if (std::exchange(caller_, line_.caller()) != 0)
        of_line_.emplace_back(CallerGone{});
    if (caller_ != 0)
        of_line_.emplace_back(Tick{});
}

/// A WorkerHello begins anew.
void Wire::post(const Send& send) {
    if (std::holds_alternative<protocol::WorkerHello>(send.message))
        outbox_.clear();
    outbox_.push_back(protocol::encode(send.message, send.version));
}

/// What cannot leave (no connection yet, or a broker that does not read) is tried again soon, and
/// ever less often. It is never much: the answers that the credit allows, and the beats until the
/// silent broker is given up.
void Wire::flush() {
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

void Wire::flush_if_due(Instant now) {
    if (now >= resend_at_)
        flush();
}

void Wire::log(Log line) {
    line.subject = title_;
    line.text = printable(title_ + ": " + line.text); // a broker's own words may be in it
    if (on_log_)
        on_log_(line);
}

} // namespace fraja::worker
