#include "worker/link.hpp"

#include "common/net/clock.hpp"

#include <algorithm>
#include <utility>

namespace fraja::worker {

Link::Link(Who who, const OnLog& on_log, Line line, Session session, Pool& pool)
    : index_(who.index), wire_(std::move(who.title), on_log, std::move(line)),
      session_(std::move(session)), pool_(pool) {}

void Link::step(const Event& event) {
    step_session(event);
    while (const auto of_line = wire_.heed_line())
        step_session(*of_line);
}

void Link::receive_some() {
    for (int i = 0; i < wire_events_per_round; ++i) {
        const auto event = wire_.receive();
        if (!event)
            return;
        step(*event);
    }
}

void Link::keep_time(Instant now) {
    wire_.flush_if_due(now);
    while (const auto of_line = wire_.heed_line())
        step_session(*of_line);
    if (wire_.has_caller() && now >= session_.next_deadline())
        step(Tick{pool_.progress(index_)});
}

Instant Link::next_deadline() const {
    // Without a caller there is nobody to greet.
    const Instant session = wire_.has_caller() ? session_.next_deadline() : Instant::never();
    return std::min({session, wire_.next_deadline(), wire_.farewell_deadline()});
}

void Link::step_session(const Event& event) {
    actions_.clear();
    session_.step(net::now(), event, actions_);
    for (Action& action : actions_)
        std::visit([&](auto& a) { perform(std::move(a)); }, action);
    wire_.flush();
}

void Link::perform(Finished action) {
    finished_ = action.reason;
    wire_.begin_farewell(net::now());
}

} // namespace fraja::worker
