#include "worker/crew_wires.hpp"

#include "common/base/text.hpp"
#include "common/net/clock.hpp"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <variant>

namespace fraja::worker {

CrewWires::CrewWires(CrewOptions options, std::string title, const OnLog& on_log, Pool& pool,
                     Host& host)
    : first_(options.first), title_(std::move(title)), crew_(std::move(options)), on_log_(on_log),
      pool_(pool), host_(host) {}

SessionIndex CrewWires::session_of(std::size_t slot) const {
    return SessionIndex{static_cast<std::uint32_t>(static_cast<std::size_t>(first_) + slot)};
}

std::size_t CrewWires::slot_of(SessionIndex session) const {
    return static_cast<std::size_t>(session) - static_cast<std::size_t>(first_);
}

// ------------------------------------------------------------------------------------------ wires

void CrewWires::add_line(std::size_t slot, Line line, const std::string& endpoint) {
    if (wires_.size() <= slot)
        wires_.resize(slot + 1);
    wires_[slot] = std::make_unique<Wire>(title_.empty() ? endpoint : endpoint + ": " + title_,
                                          on_log_, std::move(line));
    host_.opened(slot, wires_[slot]->socket());
}

void CrewWires::open(std::size_t slot, const std::string& endpoint, std::deque<CrewEvent>& events) {
    if (auto socket = host_.connect(endpoint))
        return add_line(slot, std::move(*socket), endpoint);
    else if (on_log_)
        on_log_({LogLevel::warning, "broker_unserved", endpoint,
                 printable(endpoint + ": cannot be served: " + socket.error().message)});
    events.push_back(NotOpened{session_of(slot)});
}

void CrewWires::close(std::size_t slot) {
    if (!wire(slot))
        return; // it could not be opened
    host_.closed(slot);
    leaving_.push_back(std::move(wires_[slot]));
    leaving_.back()->flush();
    leaving_.back()->begin_farewell(net::now());
}

std::vector<const net::Socket*> CrewWires::sockets() const {
    std::vector<const net::Socket*> sockets;
    for (const auto& wire : wires_)
        if (wire)
            sockets.push_back(&wire->socket());
    return sockets;
}

// ----------------------------------------------------------------------------------------- events

void CrewWires::step(CrewEvent event) {
    std::deque<CrewEvent> events; // and what follows from it
    events.push_back(std::move(event));
    while (!events.empty()) {
        actions_.clear();
        touched_.clear();
        if (const auto* of_session = std::get_if<SessionEvent>(&events.front()))
            touched_.insert(slot_of(of_session->session));
        crew_.step(net::now(), events.front(), actions_);
        events.pop_front();
        for (CrewAction& action : actions_)
            perform(std::move(action), events);
        for (const std::size_t slot : touched_)
            flush(slot, events);
    }
    drop_those_that_left(net::now());
}

void CrewWires::flush(std::size_t slot, std::deque<CrewEvent>& events) {
    Wire* const wire = this->wire(slot);
    if (!wire)
        return;
    wire->flush();
    host_.used(slot);
    while (auto event = wire->heed_line())
        events.push_back(SessionEvent{session_of(slot), std::move(*event)});
}

template <class D>
void CrewWires::hand_to_pool(SessionIndex session, D deed) {
    if constexpr (requires { pool_.perform(session, std::move(deed)); })
        pool_.perform(session, std::move(deed));
}

void CrewWires::perform(CrewAction action, std::deque<CrewEvent>& events) {
    const std::size_t slot = slot_of(action.session);
    Wire* const wire = this->wire(slot);
    if (auto* send = std::get_if<Send>(&action.deed)) {
        wire->post(*send);
        touched_.insert(slot);
    } else if (auto* line = std::get_if<Log>(&action.deed)) {
        if (wire)
            wire->log(std::move(*line));
    } else if (const auto* hang_up = std::get_if<HangUp>(&action.deed)) {
        wire->hang_up(*hang_up);
    } else if (const auto* told = std::get_if<Open>(&action.deed)) {
        open(slot, told->endpoint, events);
    } else if (std::holds_alternative<Close>(action.deed)) {
        close(slot);
    } else {
        std::visit([&](auto& deed) { hand_to_pool(action.session, std::move(deed)); }, action.deed);
    }
}

void CrewWires::receive_some(std::size_t slot) {
    for (int i = 0; i < wire_events_per_round; ++i) {
        Wire* const wire = this->wire(slot);
        if (!wire)
            return;
        auto event = wire->receive();
        host_.used(slot);
        if (!event)
            return;
        step(SessionEvent{session_of(slot), std::move(*event)});
    }
}

// ------------------------------------------------------------------------------------------- time

/// A worker that is called has nobody until then.
bool CrewWires::has_somebody_to_greet() const {
    return std::ranges::any_of(wires_, [](const auto& wire) { return wire && wire->has_caller(); });
}

Instant CrewWires::next_deadline() const {
    Instant deadline = has_somebody_to_greet() ? crew_.next_deadline() : Instant::never();
    for (const auto& wire : wires_)
        if (wire)
            deadline = std::min(deadline, wire->next_deadline());
    for (const auto& wire : leaving_)
        deadline = std::min({deadline, wire->next_deadline(), wire->farewell_deadline()});
    return deadline;
}

void CrewWires::keep_time(Instant now) {
    for (std::size_t slot = 0; slot < wires_.size(); ++slot)
        receive_some(slot);
    send_again(now);
    if (has_somebody_to_greet() && now >= crew_.next_deadline())
        step(tick());
    drop_those_that_left(now);
}

void CrewWires::send_again(Instant now) {
    for (std::size_t slot = 0; slot < wires_.size(); ++slot) {
        Wire* const wire = this->wire(slot);
        if (!wire)
            continue;
        wire->flush_if_due(now);
        while (auto event = wire->heed_line())
            step(SessionEvent{session_of(slot), std::move(*event)});
    }
    for (const auto& wire : leaving_)
        wire->flush_if_due(now);
}

void CrewWires::drop_those_that_left(Instant now) {
    if (const auto count = std::erase_if(
            leaving_, [now](const std::unique_ptr<Wire>& wire) { return wire->is_over(now); }))
        host_.gone(count);
}

CrewTick CrewWires::tick() const {
    CrewTick tick;
    for (const SessionIndex session : crew_.sessions())
        tick.progress.push_back({session, pool_.progress(session)});
    return tick;
}

} // namespace fraja::worker
