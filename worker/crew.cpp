#include "worker/crew.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <span>
#include <tuple>
#include <type_traits>

namespace fraja::worker {
namespace {

using protocol::brokers_max;
using protocol::Member;

/// Of a circle: those of before stay for a while, as not all brokers learn at once who has come in
/// whose place.
constexpr std::size_t circle_max = 4 * brokers_max;
constexpr std::size_t shunned_max = 4 * brokers_max;
/// A session that is greeted anew is soon there again.
constexpr Duration alone_patience = std::chrono::seconds(15);

bool contains(std::span<const BrokerId> circle, const BrokerId& broker) {
    return std::ranges::find(circle, broker) != circle.end();
}

/// A list may be longer than anybody should tell.
std::span<const Member> sound_part(const std::vector<Member>& list) {
    return std::span(list).first(std::min<std::size_t>(list.size(), brokers_max));
}

} // namespace

std::uint32_t crew_sessions_max(std::size_t endpoint_count, bool is_called, bool is_looking) {
    return static_cast<std::uint32_t>(
        is_called ? 1 : endpoint_count + brokers_max + (is_looking ? brokers_found_max : 0));
}

Crew::Crew(CrewOptions options)
    : identity_(std::move(options.identity)), limits_(options.limits), first_(options.first),
      slots_max_(
          crew_sessions_max(options.endpoints.size(), identity_.is_called, options.is_looking)),
      is_looking_(options.is_looking) {
    FRAJA_ASSERT(!options.endpoints.empty() || is_looking_);
    FRAJA_ASSERT(!identity_.is_called || options.endpoints.size() == 1);
    for (std::string& endpoint : options.endpoints) {
        Slot& slot = slots_.emplace_back();
        slot.session = std::make_unique<Session>(identity_, limits_);
        slot.session->share_tickets(last_ticket_);
        slot.endpoint = std::move(endpoint);
        slot.is_given = true;
    }
}

void Crew::step(Instant now, const CrewEvent& event, std::vector<CrewAction>& actions) {
    Turn turn{now, actions};
    std::visit([&](const auto& e) { on(turn, e); }, event);
    settle(turn);
    let_go_of_vanished(turn);
    if (is_looking_ && (!is_alone() || shunned_until_ == Instant{}))
        shunned_until_ = now + alone_patience;
    end_if_nobody_is_left(turn);
}

Instant Crew::next_deadline() const {
    Instant deadline = Instant::never();
    for (const Slot& slot : slots_)
        if (slot.session)
            deadline = std::min(deadline, slot.session->next_deadline());
    return deadline;
}

std::vector<SessionIndex> Crew::sessions() const {
    std::vector<SessionIndex> indices;
    for (std::size_t i = 0; i < slots_.size(); ++i)
        if (slots_[i].session)
            indices.push_back(index_of(i));
    return indices;
}

bool Crew::is_alone() const {
    return std::ranges::none_of(slots_, [this](const Slot& slot) { return is_connected(slot); });
}

bool Crew::is_connected(SessionIndex session) const {
    return is_connected(slots_[slot_of(session)]);
}

// ------------------------------------------------------------------------------------------ events

void Crew::on(Turn& turn, const SessionEvent& event) {
    const std::size_t i = slot_of(event.session);
    Slot& slot = slots_[i];
    if (!slot.session) {
        if (const auto* compiled = std::get_if<SceneCompiled>(&event.event);
            compiled && slot.unwanted.erase(compiled->scene) > 0)
            turn.actions.push_back({event.session, ForgetScene{compiled->scene}});
        else if (const auto* failed = std::get_if<SceneFailed>(&event.event))
            slot.unwanted.erase(failed->scene);
        return;
    }
    const auto* received = std::get_if<Received>(&event.event);
    if (received)
        before(i, received->message);
    with_session(turn, i, [&](Session& session) { session.step(turn.now, event.event, buffer_); });
    if (received && slots_[i].session)
        after(turn, i, received->message);
}

void Crew::on(Turn& turn, const NotOpened& event) {
    const std::size_t i = slot_of(event.session);
    if (!slots_[i].session)
        return;
    shun(slots_[i]);
    close(turn, i, {});
}

/// Whoever was shunned is tried again where nobody was served for a while: it may be another broker
/// by now, or the only way to one that was served at another endpoint.
void Crew::on(Turn& turn, const BrokersFound& event) {
    if (leaving_)
        return;
    if (is_alone() && turn.now >= shunned_until_)
        shunned_.clear();
    found_[event.source] = event.endpoints;
    let_go_of_vanished(turn); // they make room
    for (const std::string& endpoint : event.endpoints)
        open(turn, endpoint, event.source);
}

void Crew::on(Turn& turn, const CrewTick& event) {
    for (const SessionProgress& progress : event.progress)
        if (const Slot& slot = slots_[slot_of(progress.session)]; slot.session)
            slot.session->note_progress(progress.tiles);
    for (std::size_t i = 0; i < slots_.size(); ++i)
        if (slots_[i].session && slots_[i].session->next_deadline() <= turn.now)
            with_session(turn, i,
                         [&](Session& session) { session.step(turn.now, Tick{}, buffer_); });
}

void Crew::on(Turn& turn, const Drain& event) {
    leaving_ = true;
    reason_ = FinishReason::drained;
    for (std::size_t i = 0; i < slots_.size(); ++i)
        with_session(turn, i, [&](Session& session) { session.step(turn.now, event, buffer_); });
}

void Crew::on(Turn& turn, const StopNow& event) {
    leaving_ = true;
    reason_ = FinishReason::stopped;
    for (std::size_t i = 0; i < slots_.size(); ++i)
        with_session(turn, i, [&](Session& session) {
            session.prepare_to_leave(turn.now, FinishReason::stopped, buffer_);
        });
    for (std::size_t i = 0; i < slots_.size(); ++i)
        with_session(turn, i, [&](Session& session) { session.step(turn.now, event, buffer_); });
}

// ------------------------------------------------------------------------------ what brokers say

/// Who stands for whom is known before the session heeds a term.
void Crew::before(std::size_t i, const protocol::Message& message) {
    Slot& slot = slots_[i];
    if (identity_.is_called)
        return;
    if (const auto* welcome = std::get_if<protocol::Welcome>(&message))
        note_list(slot, welcome->broker, welcome->brokers);
    else if (const auto* brokers = std::get_if<protocol::Brokers>(&message);
             brokers && is_connected(slot))
        note_list(slot, slot.broker, brokers->brokers);
}

void Crew::after(Turn& turn, std::size_t i, const protocol::Message& message) {
    const bool is_first = std::holds_alternative<protocol::Welcome>(message);
    if (const auto* cancelled = std::get_if<protocol::CancelTile>(&message)) {
        // Whoever has it; but what another leader has given since is that one's.
        if (is_connected(slots_[i]) && slots_[i].session->has_newest_term())
            for (std::size_t j = 0; j < slots_.size(); ++j)
                if (j != i && slots_[j].session && are_allies(slots_[i], slots_[j]))
                    with_session(turn, j, [&](Session& session) {
                        (void)session.cancel(turn.now, *cancelled, buffer_);
                    });
    } else if (const auto* refused = std::get_if<protocol::Refused>(&message)) {
        const bool other_is_there = std::ranges::any_of(
            slots_, [&](const Slot& s) { return &s != &slots_[i] && is_connected(s); });
        if (refused->code == protocol::RefusalCode::conflict && !is_connected(slots_[i]) &&
            other_is_there && slots_[i].session->tile_count() == 0) {
            shun(slots_[i]);
            close(turn, i, "its broker is served at another endpoint");
        }
    } else if (is_first || std::holds_alternative<protocol::Brokers>(message)) {
        if (is_first && is_connected(slots_[i]))
            look_for_alias(turn, i);
        heed_lists(turn, i);
    }
}

/// What its broker says of those that stand for each other. An empty list: it stands alone.
void Crew::note_list(Slot& slot, const BrokerId& broker, const std::vector<Member>& list) {
    const bool is_another = std::exchange(slot.broker, broker) != broker;
    slot.list.assign(sound_part(list).begin(), sound_part(list).end());
    const auto is_known = [&](const Member& m) {
        return m.broker != broker && contains(slot.circle, m.broker);
    };
    // Whoever names others, and nobody of before, belongs to another farm.
    if (list.empty() ||
        (is_another && slot.list.size() > 1 && std::ranges::none_of(slot.list, is_known)))
        slot.circle.clear();
    for (const Member& member : slot.list) {
        std::erase(slot.circle, member.broker);
        slot.circle.push_back(member.broker);
    }
    if (slot.circle.size() > circle_max)
        slot.circle.erase(slot.circle.begin(), slot.circle.end() - circle_max);
    regroup();
}

void Crew::heed_lists(Turn& turn, std::size_t teller) {
    if (leaving_ || !is_connected(slots_[teller]))
        return;
    const std::vector<Member> list = slots_[teller].list; // slots move when one is added
    for (const Member& member : list)
        if (!member.endpoint.empty() && !is_served(member))
            open(turn, teller, member);
    for (std::size_t i = 0; i < slots_.size(); ++i)
        if (is_omitted(i))
            close(turn, i, "no broker tells of it any more");
}

/// Two endpoints are one broker's. It knows one worker by the newer of its sessions, so one of them
/// goes: one that was told of before one that was found, that before one that was given, or the
/// later one.
void Crew::look_for_alias(Turn& turn, std::size_t i) {
    const BrokerId broker = slots_[i].broker;
    if (broker == BrokerId{})
        return;
    for (std::size_t j = 0; j < slots_.size(); ++j) {
        if (j == i || !is_connected(slots_[j]) || slots_[j].broker != broker)
            continue;
        const auto rank = [&](std::size_t s) {
            return std::tuple(!slots_[s].is_given, !slots_[s].is_found, s);
        };
        const std::size_t gone = rank(i) > rank(j) ? i : j, kept = gone == i ? j : i;
        shun(slots_[gone]);
        close(turn, gone, "it is the broker at " + slots_[kept].endpoint);
        if (kept == j)
            with_session(turn, j, [&](Session& session) { session.greet_anew(turn.now, buffer_); });
        return;
    }
}

// ---------------------------------------------------------------------------------------- sessions

/// All that is done with a session goes through here.
template <class F>
void Crew::with_session(Turn& turn, std::size_t i, F deed) {
    if (!slots_[i].session)
        return;
    Session& session = *slots_[i].session;
    buffer_.clear();
    deed(session);
    reception_ = std::max(reception_, session.reception());
    for (Action& action : buffer_)
        std::visit(
            [&](auto& a) {
                if constexpr (std::is_same_v<std::decay_t<decltype(a)>, Finished>) {
                    reason_ = a.reason;
                    shun(slots_[i]);
                } else
                    turn.actions.push_back({index_of(i), std::move(a)});
            },
            action);
    for (const protocol::Message& answer : session.take_answers_for_allies())
        for (std::size_t j = 0; j < slots_.size(); ++j)
            if (j != i && is_connected(slots_[j]) && are_allies(slots_[i], slots_[j]))
                turn.actions.push_back({index_of(j), Send{answer, slots_[j].session->spoken()}});
    if (session.is_over())
        retire(turn, i);
}

/// What becomes of one session may be what others wait for.
void Crew::settle(Turn& turn) {
    if (slots_.size() == 1)
        return;
    const auto state = [](const Session* s) {
        return s ? std::tuple(true, s->is_connected(), s->tile_count())
                 : std::tuple(false, false, std::size_t{0});
    };
    for (bool changed = true; changed;) {
        changed = false;
        for (std::size_t i = 0; i < slots_.size(); ++i) {
            const auto before = state(slots_[i].session.get());
            with_session(turn, i, [&](Session& session) { session.look_again(turn.now, buffer_); });
            changed = changed || state(slots_[i].session.get()) != before;
        }
    }
}

/// Brokers that were told of are greeted for as long as one that was given may come back or be
/// found, or one of them is there. Who is told to leave by the last one looks for no other.
void Crew::end_if_nobody_is_left(Turn& turn) {
    const bool may_find = is_looking_ && !leaving_ && reason_ != FinishReason::dismissed;
    if (finished_ || may_find || std::ranges::any_of(slots_, [&](const Slot& slot) {
            return (slot.session && slot.is_given) || is_connected(slot);
        }))
        return;
    for (std::size_t i = 0; i < slots_.size(); ++i)
        if (slots_[i].session)
            close(turn, i, {});
    finished_ = reason_;
}

void Crew::open(Turn& turn, std::size_t teller, const Member& member) {
    const auto i = free_slot();
    const auto told = std::ranges::count_if(
        slots_, [](const Slot& slot) { return slot.session && !slot.is_given && !slot.is_found; });
    if (!i || told >= static_cast<std::ptrdiff_t>(brokers_max))
        return;
    Slot& slot = begin_session(turn, *i, member.endpoint);
    slot.teller = teller;
    slot.broker = member.broker;
    log(turn, *i, "broker_told", "served as well: " + slots_[teller].endpoint + " tells of it");
    regroup();
}

/// Because a source has it.
void Crew::open(Turn& turn, const std::string& endpoint, const std::string& source) {
    const auto i = free_slot();
    const auto found = std::ranges::count_if(
        slots_, [](const Slot& slot) { return slot.session && slot.is_found; });
    const bool is_known =
        shunned_.contains(endpoint) || std::ranges::any_of(slots_, [&](const Slot& slot) {
            return slot.session && slot.endpoint == endpoint;
        });
    if (is_known || !i || found >= static_cast<std::ptrdiff_t>(brokers_found_max))
        return;
    begin_session(turn, *i, endpoint).is_found = true;
    log(turn, *i, "broker_found", "found by " + source);
    regroup();
}

Crew::Slot& Crew::begin_session(Turn& turn, std::size_t i, const std::string& endpoint) {
    if (i == slots_.size())
        slots_.emplace_back();
    Slot& slot = slots_[i];
    slot = {};
    slot.session = std::make_unique<Session>(identity_, limits_);
    slot.session->share_tickets(last_ticket_);
    slot.session->begin_after(last_incarnation_);
    slot.endpoint = endpoint;
    turn.actions.push_back({index_of(i), Open{endpoint}});
    return slot;
}

/// Brokers that were found, are not found any more, and are not there.
void Crew::let_go_of_vanished(Turn& turn) {
    for (std::size_t i = 0; i < slots_.size(); ++i)
        if (const Slot& slot = slots_[i]; slot.is_found && slot.session && !is_connected(slot) &&
                                          slot.session->tile_count() == 0 &&
                                          !is_found(slot.endpoint))
            close(turn, i, "it is not found any more");
}

void Crew::close(Turn& turn, std::size_t i, const std::string& why) {
    if (!why.empty())
        log(turn, i, "broker_let_go", "served no more: " + why);
    with_session(turn, i, [&](Session& session) { session.close(turn.now, buffer_); });
}

/// Its threads may still be at what it has asked for.
void Crew::retire(Turn& turn, std::size_t i) {
    Slot& slot = slots_[i];
    using Stage = SceneOnShelf::Stage;
    for (const ContentHash& scene : slot.session->scenes_at(Stage::ready))
        turn.actions.push_back({index_of(i), ForgetScene{scene}});
    const auto compiling = slot.session->scenes_at(Stage::compiling);
    slot.unwanted = {compiling.begin(), compiling.end()};
    last_incarnation_ = std::max(last_incarnation_, slot.session->incarnation());
    slot.session.reset();
    slot.list.clear();
    slot.circle.clear();
    turn.actions.push_back({index_of(i), Close{}});
    regroup();
}

/// Whoever tells of it does not have it opened again, until another broker has come in its place.
void Crew::shun(const Slot& slot) {
    if (shunned_.size() >= shunned_max)
        shunned_.clear();
    shunned_[slot.endpoint] = slot.broker;
}

void Crew::log(Turn& turn, std::size_t i, std::string_view kind, std::string text) {
    turn.actions.push_back({index_of(i), Log{LogLevel::info, kind, {}, std::move(text)}});
}

void Crew::regroup() {
    for (const Slot& slot : slots_) {
        if (!slot.session)
            continue;
        std::vector<const Session*> allies;
        for (const Slot& other : slots_)
            if (&other != &slot && other.session && are_allies(slot, other))
                allies.push_back(other.session.get());
        slot.session->set_allies(std::move(allies));
    }
}

// --------------------------------------------------------------------------------------- questions

std::size_t Crew::slot_of(SessionIndex session) const {
    const auto i = static_cast<std::size_t>(session) - static_cast<std::size_t>(first_);
    FRAJA_ASSERT(i < slots_.size());
    return i;
}

SessionIndex Crew::index_of(std::size_t slot) const {
    return SessionIndex{static_cast<std::uint32_t>(static_cast<std::size_t>(first_) + slot)};
}

/// One has named the other since it was last said to stand alone. Brokers that do not hear each
/// other any more are still allies: that is when a worker must know who leads.
bool Crew::are_allies(const Slot& a, const Slot& b) {
    return a.broker != BrokerId{} && b.broker != BrokerId{} && a.broker != b.broker &&
           (contains(a.circle, b.broker) || contains(b.circle, a.broker));
}

/// Or shall not be.
bool Crew::is_served(const Member& member) const {
    if (const auto shunned = shunned_.find(member.endpoint);
        shunned != shunned_.end() && shunned->second == member.broker)
        return true;
    return std::ranges::any_of(slots_, [&](const Slot& slot) {
        return slot.session && (slot.endpoint == member.endpoint ||
                                (slot.broker == member.broker && member.broker != BrokerId{}));
    });
}

/// It was told of, is not any more, and nothing is left to be done for it.
bool Crew::is_omitted(std::size_t i) const {
    const Slot& slot = slots_[i];
    if (!slot.session || slot.is_given || slot.is_found || slot.session->tile_count() > 0)
        return false;
    bool omitted = false;
    for (std::size_t j = 0; j < slots_.size(); ++j) {
        const Slot& other = slots_[j];
        if (!is_connected(other))
            continue;
        for (const Member& member : other.list)
            if (member.endpoint == slot.endpoint ||
                (member.broker == slot.broker && member.broker != BrokerId{}))
                return false;
        omitted = omitted ||
                  (j != i && !other.list.empty() && (slot.teller == j || are_allies(slot, other)));
    }
    return omitted;
}

bool Crew::is_found(const std::string& endpoint) const {
    return std::ranges::any_of(found_, [&](const auto& of_source) {
        return std::ranges::find(of_source.second, endpoint) != of_source.second.end();
    });
}

std::optional<std::size_t> Crew::free_slot() const {
    for (std::size_t i = 0; i < slots_.size(); ++i)
        if (!slots_[i].session && slots_[i].unwanted.empty())
            return i;
    if (slots_.size() < slots_max_)
        return slots_.size();
    return std::nullopt;
}

} // namespace fraja::worker
