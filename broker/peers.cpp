// Dispatcher: the other brokers that stand for this one. Each dials all others; what one has to say
// goes by the connection that it dialled, answers come back by the same.
#include "broker/dispatcher.hpp"

#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <functional>
#include <utility>

namespace fraja::broker {

using namespace protocol;

namespace {

constexpr int missed_beats = 10; ///< heartbeats after which it is said of a peer

std::string of_one_version(Version theirs) {
    return "brokers that stand for each other speak one version of the protocol, and it speaks " +
           std::to_string(theirs) + ", this one " + std::to_string(protocol::version);
}

} // namespace

// ------------------------------------------------------------------------------------ connections

void Dispatcher::dial(const std::string& endpoint, bool is_configured) {
    Line& line = lines_[endpoint];
    line.is_configured = line.is_configured || is_configured;
    line.told_at = line.dialled_at = now_;
    actions_->push_back(Dial{endpoint});
    say_hello(endpoint, line);
}

/// Who is told of, and cannot be reached by any connection that there is.
void Dispatcher::consider_dialling(const Member& member) {
    const auto line = lines_.find(member.endpoint);
    const bool is_reached = std::ranges::any_of(lines_, [&](const auto& entry) {
        return entry.second.broker == member.broker && entry.first != member.endpoint;
    });
    if (line != lines_.end()) {
        line->second.told_of = member.broker;
        if (!is_reached) // or one that nobody answers is let go
            line->second.told_at = now_;
        return;
    }
    const bool is_known = member.endpoint.empty() || member.broker == identity_.broker ||
                          member.endpoint == identity_.endpoint || // in an earlier life
                          own_endpoints_.contains(member.endpoint) || is_reached;
    if (is_known || lines_.size() >= brokers_max)
        return;
    dial(member.endpoint, false);
    lines_.at(member.endpoint).told_of = member.broker;
}

/// What a broker says of where it is may be wrong, or lead there from elsewhere only.
bool Dispatcher::is_to_nobody_known(const Line& line) const {
    const bool is_known =
        line.told_of && (line.told_of == identity_.broker || membership_.knows(*line.told_of));
    return !line.broker && !is_known;
}

BrokerHello Dispatcher::own_hello() const {
    return {.broker = identity_.broker,
            .started_at = membership_.own().started_at,
            .endpoint = identity_.endpoint,
            .program_version = std::string(fraja::version),
            .keeps = identity_.keeps};
}

BrokerBeat Dispatcher::own_beat() const {
    return {.broker = identity_.broker,
            .term = term(),
            .is_synced = membership_.is_synced(),
            .brokers = members(),
            .digest = digest(),
            .leads = membership_.leads(),
            .has_workers = membership_.has_workers(),
            .leader_silence = membership_.leader_silence(now_)};
}

void Dispatcher::say_hello(const std::string& endpoint, Line& line) {
    line.hello_at = now_;
    actions_->push_back(Tell{endpoint, own_hello()});
}

void Dispatcher::answer(const Route& route, Message message) {
    if (route.is_dialled)
        actions_->push_back(Tell{route.name, std::move(message)});
    else
        send(route.name, std::move(message));
}

std::optional<Dispatcher::Route> Dispatcher::route_to(const BrokerId& broker) const {
    for (const auto& [endpoint, line] : lines_)
        if (line.broker == broker)
            return Route{true, endpoint};
    const auto colleague = colleagues_.find(broker);
    if (colleague != colleagues_.end() && colleague->second.peer)
        return Route{false, *colleague->second.peer};
    return std::nullopt;
}

void Dispatcher::tell(const BrokerId& broker, Message message) {
    if (const auto route = route_to(broker))
        answer(*route, std::move(message));
}

void Dispatcher::tell_all(const Message& message) {
    for (const BrokerId& broker : membership_.here(now_))
        tell(broker, message);
}

// --------------------------------------------------------------------------------- who says what

/// Those that are gone, the one first that has been so for longest, give way to one that is here.
bool Dispatcher::make_room_for(const BrokerId& broker) {
    const auto& peers = membership_.peers();
    if (membership_.knows(broker) || peers.size() + 1 < brokers_max)
        return true;
    const auto longest = std::ranges::min_element(
        peers, {}, [](const auto& entry) { return entry.second.heard_at; });
    if (membership_.is_here(longest->first, now_))
        return false;
    forget_broker(BrokerId(longest->first));
    return true;
}

/// Somebody has dialled this broker, perhaps itself: it hears so by the answer.
void Dispatcher::meet_broker(const PeerId& peer, Version spoken, const BrokerHello& hello) {
    if (spoken != protocol::version) {
        note_no_company(hello.endpoint, of_one_version(spoken));
        return refuse(peer, RefusalCode::version_mismatch, of_one_version(spoken));
    }
    if (identity_.is_branch)
        return turn_away(peer, RefusalCode::not_allowed,
                         "it serves another broker, and brokers that stand for each other serve no "
                         "other one");
    if (const auto worker = workers_.find(peer); worker != workers_.end())
        end_worker(worker, Departure::replaced, "its connection says to be a broker");
    end_client(peer, Departure::replaced);
    if (hello.broker != identity_.broker) {
        forget_predecessors(hello);
        if (!make_room_for(hello.broker))
            return turn_away(peer, RefusalCode::limit_exceeded,
                             "at most " + std::to_string(brokers_max) +
                                 " brokers stand for each other");
        membership_.meet(now_, hello);
        Colleague& colleague = colleagues_[hello.broker];
        if (colleague.peer && *colleague.peer != peer)
            brokers_by_peer_.erase(*colleague.peer);
        colleague.peer = peer;
        brokers_by_peer_[peer] = hello.broker;
        consider_dialling({hello.broker, hello.endpoint});
    }
    send(peer, own_hello());
    send(peer, own_beat());
}

/// Told in the log once in a while, as both go on asking.
void Dispatcher::note_no_company(const std::string& endpoint, const std::string& why) {
    if (refusals_told_.is_new(now_, endpoint + why))
        log({.level = LogLevel::warning,
             .kind = "no_company",
             .subject = endpoint,
             .text = "broker " + endpoint + " does not stand for this one: " + why});
}

void Dispatcher::on(const BrokerSaid& event) {
    const auto found = lines_.find(event.endpoint);
    if (found == lines_.end())
        return;
    Line& line = found->second;
    const auto* refused = std::get_if<Refused>(&event.message);
    if (event.version != protocol::version)
        return note_no_company(event.endpoint, of_one_version(event.version));
    if (refused && (refused->code == RefusalCode::version_mismatch ||
                    refused->code == RefusalCode::not_allowed))
        return note_no_company(event.endpoint, refused->reason);
    if (refused && refused->code == RefusalCode::unknown_peer) {
        line.broker.reset();
        if (now_ - line.hello_at >= limits_.heartbeat / limits_.peer_beats)
            say_hello(event.endpoint, line);
        return;
    }
    if (const auto* hello = std::get_if<BrokerHello>(&event.message)) {
        if (hello->broker == identity_.broker) { // it was this broker that it dialled
            own_endpoints_.insert(event.endpoint);
            if (line.is_configured)
                log({.level = LogLevel::warning,
                     .kind = "peer_is_self",
                     .subject = event.endpoint,
                     .text = "--peer " + event.endpoint + " is this broker itself"});
            actions_->push_back(HangUp{event.endpoint});
            lines_.erase(found);
            return;
        }
        forget_predecessors(*hello);
        if (!make_room_for(hello->broker))
            return;
        line.was_answered = true;
        line.broker = hello->broker;
        const auto before = std::exchange(line.last, hello->broker);
        membership_.meet(now_, *hello);
        colleagues_.try_emplace(hello->broker);
        if (before && before != hello->broker)
            note_replaced(*before);
        return;
    }
    if (line.broker && membership_.knows(*line.broker))
        from_broker(BrokerId(*line.broker), {true, event.endpoint}, event.message);
}

/// Where one was found another one answers now: it was started anew, and says no place of its own
/// by which forget_predecessors would know. Or more than one can be found there, and it is still
/// here.
void Dispatcher::note_replaced(const BrokerId& broker) {
    const auto found = colleagues_.find(broker);
    if (found != colleagues_.end() && route_to(broker) && membership_.is_here(broker, now_))
        found->second.is_replaced = true;
    else
        forget_broker(BrokerId(broker));
}

void Dispatcher::from_broker(const BrokerId& broker, const Route& route, const Message& message) {
    membership_.hear(now_, broker);
    if (const auto* beat = std::get_if<BrokerBeat>(&message)) {
        membership_.hear(now_, *beat);
        for (const Member& member : beat->brokers)
            consider_dialling(member);
    } else if (std::holds_alternative<CompareJobs>(message)) {
        answer(route, job_digests());
    } else if (const auto* theirs = std::get_if<JobDigests>(&message)) {
        compare(broker, *theirs);
    } else if (const auto* want = std::get_if<WantJob>(&message)) {
        if (const Job* job = job_of(want->job); job && job->phase != JobPhase::waiting_for_scene)
            answer(route, record_of(*job));
        else if (forgotten_.contains(want->job))
            answer(route, JobForgotten{want->job});
    } else if (const auto* record = std::get_if<JobRecord>(&message)) {
        take_record(broker, *record);
    } else if (const auto* kept = std::get_if<JobKept>(&message)) {
        note_copy(broker, kept->job);
    } else if (const auto* gone = std::get_if<JobForgotten>(&message)) {
        const Following following(follows_);
        if (job_of(gone->job))
            forget(gone->job);
        bury(gone->job);
    } else if (const auto* need = std::get_if<NeedChunk>(&message)) {
        if (auto chunk = blobs_.chunk(need->blob, need->offset_bytes))
            answer(route, std::move(*chunk));
    } else if (const auto* chunk = std::get_if<Chunk>(&message)) {
        take_scene_chunk(broker, *chunk);
    } else if (const auto* wish = std::get_if<Repair>(&message)) {
        if (!route.is_dialled)
            repair(route.name, *wish, now_ - limits_.copy_lag);
    } else if (const auto* tile = std::get_if<TileDone>(&message)) {
        take_tile(broker, *tile);
    } else if (const auto* done = std::get_if<RepairDone>(&message)) {
        repair_done(broker, *done);
    } else if (const auto* job = std::get_if<ControlJob>(&message);
               job && job->deed == JobDeed::retry) {
        control_job({}, *job);
    } else if (const auto* control = std::get_if<ControlWorker>(&message)) {
        const Following following(follows_);
        control_worker({}, *control);
    } else if (!std::holds_alternative<Refused>(message)) {
        ++counters_.unexpected;
    }
}

// -------------------------------------------------------------------------------- all the time

std::uint64_t Dispatcher::rumour_counter_max() const {
    const Duration since_1970 = identity_.unix_offset + (now_ - Instant{});
    const Duration latest = since_1970 + limits_.rumour_ahead_max;
    return static_cast<std::uint64_t>(
        std::chrono::duration_cast<std::chrono::microseconds>(latest).count());
}

/// One that is not heard here may be heard by workers. What half of those say counts that know that
/// leader: one that lies cannot keep a dead one's place, nor one that is cut off end its lead.
void Dispatcher::hear_workers_of_leader() {
    const BrokerId& leader = term().leader;
    const auto peer = membership_.peers().find(leader);
    if (leader == identity_.broker ||
        (peer != membership_.peers().end() && now_ - peer->second.heard_at <= limits_.heartbeat))
        return;
    std::map<std::string_view, Instant> heard; // a voter's latest
    for (const auto& [id, worker] : workers_)
        if (worker.heard_leader == leader && worker.distrusted.empty()) {
            Instant& at = heard[worker.voter];
            at = std::max(at, worker.leader_heard_at);
        }
    if (heard.empty())
        return;
    std::vector<Instant> times;
    for (const auto& [voter, at] : heard)
        times.push_back(at);
    const auto middle = times.begin() + static_cast<std::ptrdiff_t>((times.size() - 1) / 2);
    std::ranges::nth_element(times, middle, std::greater<>());
    membership_.hear_of_leader(now_, term(), now_ - *middle);
}

void Dispatcher::keep_company() {
    for (const std::string& endpoint : identity_.peers)
        if (!lines_.contains(endpoint) && !own_endpoints_.contains(endpoint))
            dial(endpoint, true);
    const Duration beat = limits_.heartbeat / limits_.peer_beats;
    for (auto& [endpoint, line] : lines_)
        if (!(line.broker && membership_.is_here(*line.broker, now_)) &&
            now_ - line.hello_at >= 2 * beat)
            say_hello(endpoint, line);
    membership_.note_workers(now_, !workers_.empty());
    hear_workers_of_leader();
    const BrokerBeat beat_now = own_beat();
    const std::uint64_t own_digest = beat_now.digest;
    for (const auto& [id, colleague] : colleagues_)
        tell(id, beat_now);

    bool all_compared = true;
    for (const BrokerId& id : membership_.here(now_)) {
        Colleague& colleague = colleagues_[id];
        std::erase_if(colleague.repairs, [&](const auto& asked) {
            return now_ - asked.second.at > 2 * limits_.heartbeat;
        });
        if (membership_.peers().at(id).digest == own_digest) {
            colleague.is_compared = true;
            if (std::exchange(colleague.same_as, own_digest) != own_digest)
                note_copies_of_all(id);
            if (id == term().leader)
                for (auto& [job_id, job] : jobs_)
                    if (job.phase == JobPhase::done)
                        note_done_at_leader(job);
        } else if (now_ >= colleague.compare_at) {
            colleague.compare_at = now_ + (colleague.is_compared ? limits_.compare_interval : beat);
            tell(id, CompareJobs{});
        }
        all_compared = all_compared && colleague.is_compared;
    }
    if (!membership_.is_synced() && all_compared && membership_.has_looked_around(now_)) {
        membership_.set_synced(now_);
        log({.level = LogLevel::info,
             .kind = "synced",
             .subject = {},
             .text = (colleagues_.empty() ? "has heard no other broker, and goes on alone: "
                                          : "has all that the other brokers have: ") +
                     counted(jobs_.size(), "job")});
    }
    fetch_scenes_anew();
    for (auto& [id, job] : jobs_) {
        acknowledge_if_safe(job);
        settle(job); // what it waits for may have come about by itself
    }
    settle_numbers();
    wait_no_longer_for_silent_workers();
    note_who_is_here();
    note_who_never_was();
    note_who_leads();
    forget_brokers_that_are_gone();
    if (members() != told_members_)
        tell_of_brokers();
}

void Dispatcher::note_who_is_here() {
    for (auto& [id, colleague] : colleagues_) {
        const bool is_here = membership_.is_here(id, now_);
        if (std::exchange(colleague.was_here, is_here) == is_here)
            continue;
        const std::size_t here = membership_.here(now_).size();
        log({.level = is_here ? LogLevel::info : LogLevel::warning,
             .kind = is_here ? "broker_here" : "broker_gone",
             .subject = to_string(id),
             .text = "broker " + named(id) + (is_here ? " is here" : " is gone") + ": " +
                     counted(here, "other broker") + " of " + std::to_string(colleagues_.size()) +
                     (here == 0 ? "; what is submitted now is kept by this one alone" : "")});
        if (!is_here) {
            forget_copies(id);
            colleague.is_compared = false;
            colleague.same_as.reset();
            colleague.repairs.clear();
            colleague.repaired.clear();
        }
    }
}

/// Whoever reads one broker's log knows then where to read on.
void Dispatcher::note_who_leads() {
    const BrokerId& leader = term().leader;
    if (leader == told_leader_ ||
        (leader != identity_.broker && !membership_.is_here(leader, now_)))
        return;
    told_leader_ = leader;
    if (leader != identity_.broker)
        log({.level = LogLevel::info,
             .kind = "led_by",
             .subject = to_string(leader),
             .text = "broker " + named(leader) + " leads (term " + std::to_string(term().counter) +
                     ")"});
}

/// A name may be wrong.
void Dispatcher::note_who_never_was() {
    for (auto& [endpoint, line] : lines_)
        if (line.is_configured && !line.was_answered && !line.is_missed &&
            now_ - line.dialled_at >= limits_.heartbeat * missed_beats) {
            line.is_missed = true;
            log({.level = LogLevel::warning,
                 .kind = "peer_missed",
                 .subject = endpoint,
                 .text = "--peer " + endpoint +
                         ": no broker has answered there yet (is it started, "
                         "and is that where it listens?); asking on"});
        }
}

void Dispatcher::forget_brokers_that_are_gone() {
    std::vector<BrokerId> gone;
    for (const auto& [id, peer] : membership_.peers()) {
        const auto colleague = colleagues_.find(id);
        const bool is_replaced = colleague != colleagues_.end() && colleague->second.is_replaced;
        if (now_ - peer.heard_at > limits_.absence_max ||
            (is_replaced && !membership_.is_here(id, now_)))
            gone.push_back(id);
    }
    for (const BrokerId& id : gone)
        forget_broker(id);
    // Who has forgotten it a moment later has told of it once more.
    std::erase_if(lines_, [&](const auto& entry) {
        const Line& line = entry.second;
        if (line.is_configured || line.broker ||
            now_ - line.told_at <= limits_.heartbeat * limits_.liveness)
            return false;
        actions_->push_back(HangUp{entry.first});
        return true;
    });
}

/// Where it was found goes, too, unless that was configured.
void Dispatcher::forget_broker(const BrokerId& id) {
    forget_copies(id);
    membership_.forget(id);
    std::erase_if(brokers_by_peer_, [&](const auto& entry) { return entry.second == id; });
    colleagues_.erase(id);
    for (auto entry = lines_.begin(); entry != lines_.end();) {
        Line& line = entry->second;
        if (line.broker == id && !line.is_configured) {
            actions_->push_back(HangUp{entry->first});
            entry = lines_.erase(entry);
            continue;
        }
        if (line.broker == id)
            line.broker.reset();
        ++entry;
    }
}

/// One that says hello is whoever was there before it no more.
void Dispatcher::forget_predecessors(const BrokerHello& hello) {
    std::vector<BrokerId> earlier;
    for (const auto& [id, peer] : membership_.peers()) {
        if (id == hello.broker || hello.endpoint.empty() || peer.endpoint != hello.endpoint)
            continue;
        if (peer.rank.started_at <= hello.started_at)
            earlier.push_back(id);
        else if (membership_.is_here(id, now_) &&
                 refusals_told_.is_new(now_, "place " + hello.endpoint))
            log({.level = LogLevel::warning,
                 .kind = "one_place_twice",
                 .subject = hello.endpoint,
                 .text = "two brokers say to be at " + hello.endpoint +
                         ", and are not told apart: each needs an --advertise of its own"});
    }
    for (const BrokerId& id : earlier) {
        for (auto& [endpoint, line] : lines_) // where it is, is known
            if (line.broker == id)
                line.broker = line.last = hello.broker;
        forget_broker(id);
    }
}

// -------------------------------------------------------------------------------- who is told of

/// As it says itself, or where it was found.
std::string Dispatcher::endpoint_of(const BrokerId& broker) const {
    const auto peer = membership_.peers().find(broker);
    if (peer != membership_.peers().end() && !peer->second.endpoint.empty())
        return peer->second.endpoint;
    for (const auto& [endpoint, line] : lines_)
        if (line.broker == broker)
            return endpoint;
    return {};
}

/// For people. Of one that was not dialled nobody may know where it is.
std::string Dispatcher::named(const BrokerId& broker) const {
    const std::string endpoint = endpoint_of(broker);
    return endpoint.empty() ? to_string(broker) : endpoint;
}

std::vector<Member> Dispatcher::members() const {
    if (is_alone())
        return {};
    std::vector<Member> all{{identity_.broker, identity_.endpoint}};
    for (const auto& [id, peer] : membership_.peers())
        all.push_back({id, endpoint_of(id)});
    return all;
}

std::vector<PeerState> Dispatcher::peer_states() const {
    if (is_alone())
        return {};
    std::vector<PeerState> all{{.broker = identity_.broker,
                                .endpoint = identity_.endpoint,
                                .program_version = std::string(fraja::version),
                                .is_here = true,
                                .is_synced = membership_.is_synced(),
                                .leads = membership_.leads()}};
    for (const auto& [id, peer] : membership_.peers())
        all.push_back({.broker = id,
                       .endpoint = endpoint_of(id),
                       .program_version = peer.program_version,
                       .is_here = membership_.is_here(id, now_),
                       .is_synced = peer.is_synced,
                       .leads = term().leader == id});
    for (const auto& [endpoint, line] : lines_)
        if (is_to_nobody_known(line))
            all.push_back({.broker = {}, .endpoint = endpoint, .program_version = {}});
    return all;
}

void Dispatcher::tell_of_brokers() {
    told_members_ = members();
    const Brokers brokers{term(), told_members_};
    for (const auto& [peer, worker] : workers_)
        send(peer, brokers);
    for (const auto& [peer, client] : clients_)
        send(peer, brokers);
}

} // namespace fraja::broker
