// Dispatcher: who is there.
#include "broker/dispatcher.hpp"

#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>

namespace fraja::broker {

using namespace protocol;

namespace {

std::string by_version(Version spoken) {
    return spoken < protocol::version ? ", by protocol version " + std::to_string(spoken) : "";
}

} // namespace

void Dispatcher::refuse(const PeerId& peer, RefusalCode code, const std::string& reason,
                        JobId job) {
    // A reason may quote what came, and has room for less than all of it.
    send(peer, Refused{code, job, std::string(clipped(reason, string_bytes_max))});
}

/// Of who has just said hello, for as long as its session is open.
void Dispatcher::note_version(const PeerId& peer) {
    if (const Version spoken = version_of(peer); spoken < protocol::version)
        older_peers_[peer] = spoken;
    else
        older_peers_.erase(peer);
}

/// Somebody who has said hello.
void Dispatcher::turn_away(const PeerId& peer, RefusalCode code, const std::string& reason) {
    ++counters_.peers_refused;
    log({.level = LogLevel::warning,
         .kind = "peer_refused",
         .subject = {},
         .text = "refused a hello: " + reason});
    refuse(peer, code, reason);
}

void Dispatcher::on(const PeerSpokeRubbish& event) {
    speaker_ = {event.peer, is_spoken(event.version) ? event.version : protocol::version};
    if (event.error.code == ErrorCode::version_mismatch)
        return refuse_version(event);
    ++counters_.rubbish;
    log({.level = LogLevel::warning,
         .kind = "rubbish",
         .subject = {},
         .text = "refused a malformed message: " + event.error.message});
    refuse(event.peer, RefusalCode::malformed, event.error.message);
}

/// Told in the log once in a while, as such a peer may come back for ever. One of the next version
/// hears by the answer which one is spoken here, and says hello again in that.
void Dispatcher::refuse_version(const PeerSpokeRubbish& event) {
    const bool is_next = event.version == protocol::version + 1;
    counters_.wrong_version += !is_next;
    if (!is_next && refusals_told_.is_new(now_, event.error.message))
        log({.level = LogLevel::warning,
             .kind = "wrong_version",
             .subject = {},
             .text = "refused a message of another version: " + event.error.message});
    refuse(event.peer, RefusalCode::version_mismatch, event.error.message);
}

void Dispatcher::on(const PeerUnreachable& event) {
    if (const auto worker = workers_.find(event.peer); worker != workers_.end())
        end_worker(worker, Departure::lost, "its connection is gone or full");
    end_client(event.peer, Departure::lost);
    if (const auto broker = brokers_by_peer_.find(event.peer); broker != brokers_by_peer_.end()) {
        colleagues_.at(broker->second).peer.reset();
        brokers_by_peer_.erase(broker);
    }
}

void Dispatcher::on(const PeerSaid& event) {
    const PeerId& peer = event.peer;
    speaker_ = {peer, event.version};
    if (!may_say(event))
        return;
    if (const auto* hello = std::get_if<WorkerHello>(&event.message))
        return welcome_worker(peer, *hello, event.holder);
    if (const auto* hello = std::get_if<ClientHello>(&event.message))
        return welcome_client(peer, *hello, event.holder);
    if (const auto* hello = std::get_if<BrokerHello>(&event.message))
        return meet_broker(peer, event.version, *hello);
    if (const auto broker = brokers_by_peer_.find(peer); broker != brokers_by_peer_.end())
        return from_broker(BrokerId(broker->second), {false, peer}, event.message);
    if (const auto worker = workers_.find(peer); worker != workers_.end()) {
        worker->second.heard_at = now_;
        if (std::holds_alternative<Goodbye>(event.message))
            return end_worker(worker, Departure::said_goodbye, "it said goodbye");
        return from_worker(peer, worker->second, event.message);
    }
    if (const auto client = clients_.find(peer); client != clients_.end()) {
        client->second.heard_at = now_;
        return from_client(peer, event.message);
    }
    // Two brokers that have come to speak to each other would go on refusing each other's refusals.
    if (!std::holds_alternative<Goodbye>(event.message) &&
        !std::holds_alternative<Refused>(event.message))
        refuse(peer, RefusalCode::unknown_peer, "say hello first");
}

/// `incarnation`: of the hello, if it was a worker's.
Welcome Dispatcher::welcome(std::uint64_t incarnation) const {
    return {.broker = identity_.broker,
            .epoch = term().counter,
            .heartbeat = limits_.heartbeat,
            .liveness = limits_.liveness,
            .stream = identity_.stream,
            .program_version = std::string(fraja::version),
            .incarnation = incarnation,
            .term = term(),
            .brokers = members()};
}

void Dispatcher::welcome_worker(const PeerId& peer, const WorkerHello& hello,
                                const Holder& holder) {
    const auto too_long = [](const std::string& name) { return name.size() > name_bytes_max; };
    if (hello.threads == 0 || hello.credit > credit_max || too_long(hello.worker_name) ||
        !(hello.speed_rays_per_s <= speed_rays_per_s_max) || hello.tags.size() > tags_max ||
        std::ranges::any_of(hello.tags, too_long))
        return turn_away(peer, RefusalCode::limit_exceeded,
                         "a WorkerHello beyond the limits of the protocol");
    if (const auto known = peer_of_worker_.find(hello.worker); known != peer_of_worker_.end()) {
        const auto old = workers_.find(known->second);
        if (const Holder& its = old->second.holder; its && holder && its->key != holder->key)
            return turn_away(peer, RefusalCode::conflict,
                             "a worker of this id is here with another key");
        if (known->second == peer && hello.incarnation == old->second.hello.incarnation)
            return; // the same hello has come twice
        if (hello.incarnation < old->second.hello.incarnation)
            return turn_away(peer, RefusalCode::conflict,
                             "a newer incarnation of this worker is here");
        end_worker(old, Departure::replaced, "it said hello again");
    }
    if (const auto same_peer = workers_.find(peer); same_peer != workers_.end())
        end_worker(same_peer, Departure::replaced, "its connection says to be another worker");
    end_client(peer, Departure::replaced);
    if (workers_.size() >= limits_.workers_max)
        return turn_away(peer, RefusalCode::limit_exceeded,
                         "this broker takes " + counted(limits_.workers_max, "worker"));
    WorkerSession& worker = workers_[peer];
    worker.hello = hello;
    worker.holder = holder;
    worker.drawer = drawer_of(hello.worker, holder);
    worker.voter = voter_of(worker.drawer, hello.worker_name);
    worker.heard_at = now_;
    worker.credit = 0;
    recall(worker);
    recall_distrust(worker);
    if (hello.speed_rays_per_s > 0)
        worker.speed.add(hello.speed_rays_per_s / hello.threads, std::chrono::seconds(1));
    if (!is_alone())
        worker.tells_by = now_ + gathering_time();
    worker.has_told = is_alone();
    set_credit(peer, worker, hello.credit);
    peer_of_worker_[hello.worker] = peer;
    note_version(peer);
    ++counters_.workers_welcomed;
    log({.level = LogLevel::info,
         .kind = "worker_here",
         .subject = hello.worker_name,
         .text = "worker " + hello.worker_name + " is here: " + counted(hello.threads, "thread") +
                 ", credit " + std::to_string(hello.credit) + ", version " + hello.program_version +
                 by_version(version_of(peer))});
    send(peer, welcome(hello.incarnation));
    if (!is_alone())
        send(peer, Brokers{term(), members()}); // it answers with what it has in hand
}

/// One that does not know yet what the others have lets its clients go to these.
void Dispatcher::welcome_client(const PeerId& peer, const ClientHello& hello,
                                const Holder& holder) {
    if (!membership_.is_synced())
        return;
    if (const auto worker = workers_.find(peer); worker != workers_.end())
        end_worker(worker, Departure::replaced, "its connection says to be a client");
    if (!clients_.contains(peer) && clients_.size() >= limits_.clients_max)
        return turn_away(peer, RefusalCode::limit_exceeded,
                         "this broker takes " + std::to_string(limits_.clients_max) + " clients");
    clients_[peer] = ClientSession{hello.client_name, now_, holder};
    note_version(peer);
    send(peer, welcome(0));
}

void Dispatcher::from_worker(const PeerId& peer, WorkerSession& worker, const Message& message) {
    if (const auto* rendered = std::get_if<TileRendered>(&message))
        return tile_rendered(peer, worker, *rendered);
    if (const auto* failed = std::get_if<TileFailed>(&message))
        return tile_failed(peer, worker, *failed);
    if (const auto* worker_beat = std::get_if<WorkerBeat>(&message))
        return beat(peer, worker, *worker_beat);
    if (const auto* need = std::get_if<NeedChunk>(&message))
        return give_chunk(peer, worker, *need);
    ++counters_.unexpected;
    refuse(peer, RefusalCode::unexpected,
           "a worker does not send " + std::string(name_of(message)));
}

void Dispatcher::from_client(const PeerId& peer, const Message& message) {
    if (const auto* submission = std::get_if<SubmitJob>(&message))
        return submit(peer, *submission);
    if (const auto* chunk = std::get_if<Chunk>(&message))
        return take_chunk(peer, *chunk);
    if (const auto* find = std::get_if<FindJob>(&message))
        return find_job(peer, *find);
    if (const auto* control = std::get_if<ControlJob>(&message))
        return control_job(peer, *control);
    if (const auto* control = std::get_if<ControlWorker>(&message))
        return control_worker(peer, *control);
    if (const auto* wish = std::get_if<Repair>(&message))
        return repair(peer, *wish);
    if (std::holds_alternative<Beat>(message))
        return send(peer, Beat{});
    if (std::holds_alternative<Goodbye>(message))
        return end_client(peer, Departure::said_goodbye);
    ++counters_.unexpected;
    refuse(peer, RefusalCode::unexpected,
           "a client does not send " + std::string(name_of(message)));
}

void Dispatcher::beat(const PeerId& peer, WorkerSession& worker, const WorkerBeat& beat) {
    const auto credit = static_cast<std::uint32_t>(std::min<std::size_t>(beat.credit, credit_max));
    if (credit == 0 && worker.credit > 0)
        log({.level = LogLevel::info,
             .kind = "worker_drains",
             .subject = worker.hello.worker_name,
             .text = "worker " + worker.hello.worker_name + " drains"});
    if (credit != worker.credit)
        set_credit(peer, worker, credit);

    if (!is_alone()) {
        membership_.learn_of_worker(now_, beat.term, rumour_counter_max());
        const bool has_heard =
            beat.leader_silence >= Duration{} && beat.leader_silence <= now_ - Instant{};
        worker.heard_leader = beat.term.leader;
        worker.leader_heard_at = has_heard ? now_ - beat.leader_silence : Instant{};
        note_in_hand(peer, worker, beat);
    }
    std::set<GrantKey> listed;
    std::uint64_t last_moved = 0;
    for (const TileInFlight& tile : beat.in_flight) {
        const GrantKey key{tile.job, tile.tile, tile.attempt};
        listed.insert(key);
        const auto grant = worker.grants.find(key);
        if (grant != worker.grants.end() && tile.rays > grant->second.rays) {
            grant->second.rays = tile.rays;
            grant->second.progress_at = worker.moved_at = now_;
            last_moved = std::max(last_moved, grant->second.number);
        }
    }
    note_overtaken(worker, last_moved);
    // What it has received and does not name any more, though its answer has not come, was lost.
    std::vector<GrantKey> lost;
    for (const auto& [key, grant] : worker.grants)
        if (!listed.contains(key) && (grant.adopted || grant.number < beat.tiles_received))
            lost.push_back(key);
    for (const GrantKey& key : lost)
        (void)take_back(key, *end_grant(peer, worker, key), false, worker,
                        "the worker has it no more");
    send(peer, Beat{.leads = membership_.leads()});
}

void Dispatcher::end_worker(Workers::iterator worker, Departure departure, const std::string& why) {
    const PeerId peer = worker->first;
    set_credit(peer, worker->second, 0);
    WorkerSession session = std::move(worker->second);
    peer_of_worker_.erase(session.hello.worker);
    workers_.erase(worker);
    older_peers_.erase(peer);
    const bool lost = departure == Departure::lost;
    counters_.workers_lost += lost;
    log({.level = lost ? LogLevel::warning : LogLevel::info,
         .kind = lost ? "worker_lost" : "worker_gone",
         .subject = session.hello.worker_name,
         .text = "worker " + session.hello.worker_name + " is gone (" + why + "); " +
                 counted(session.grants.size(), "tile") + " requeued"});
    // A tile that was being rendered when its worker died may be what killed it: that counts as a
    // failure.
    std::vector<std::pair<Instant, GrantKey>> by_age;
    for (const auto& [key, grant] : session.grants)
        by_age.emplace_back(grant.granted_at, key);
    std::ranges::sort(by_age);
    Blames blamed;
    // The newest go back first, so that the oldest ends up at the front of the queue.
    for (std::size_t i = by_age.size(); i-- > 0;) {
        const GrantKey& key = by_age[i].second;
        const bool counts = lost && (i < session.hello.threads || session.grants.at(key).rays > 0);
        count_grant_of_order(key.job, false);
        if (take_back(key, session.grants.at(key), counts, session, "the worker was lost"))
            blamed.emplace_back(key.job, session.grants.at(key).id);
    }
    if (departure != Departure::said_goodbye)
        remember(std::move(session), std::move(blamed));
}

/// A process that is cut off for a while comes back by another connection: what was said of it and
/// what it did still count then.
void Dispatcher::remember(WorkerSession session, Blames blamed) {
    if (!session.drained && session.failures.empty() && session.distrusted.empty() &&
        session.in_hand.empty() && session.had_in_hand.empty() && blamed.empty())
        return;
    if (absent_.size() >= limits_.workers_max)
        absent_.erase(std::ranges::min_element(
            absent_, {}, [](const auto& entry) { return entry.second.left_at; }));
    session.grants.clear();
    session.credit = session.hello.credit;
    const WorkerId id = session.hello.worker;
    absent_[id] = {now_, std::move(session), std::move(blamed)};
}

/// It lives, so no tile has killed it.
void Dispatcher::recall(WorkerSession& worker) {
    const auto found = absent_.find(worker.hello.worker);
    if (found == absent_.end() ||
        found->second.session.drawer != worker.drawer) // that id was another key's
        return;
    worker.drained = found->second.session.drained;
    worker.failures = std::move(found->second.session.failures);
    worker.quarantined_until = found->second.session.quarantined_until;
    worker.distrusted = found->second.session.distrusted;
    WorkerSession& before = found->second.session;
    worker.moved_at = before.moved_at;
    worker.had_in_hand = std::move(before.in_hand.empty() ? before.had_in_hand : before.in_hand);
    for (const auto& [id, tile] : found->second.blamed)
        if (Job* job = job_of(id))
            job->forgive(tile, worker.hello.worker);
    absent_.erase(found);
}

void Dispatcher::forget_absent_workers() {
    std::erase_if(absent_, [this](const auto& entry) {
        return now_ - entry.second.left_at > limits_.absence_max;
    });
}

/// The scenes that it was sending: whoever is lost may come back by another connection.
void Dispatcher::end_client(const PeerId& peer, Departure departure) {
    if (clients_.erase(peer) == 0)
        return;
    older_peers_.erase(peer);
    std::vector<JobId> orphans;
    for (const auto& [id, job] : jobs_)
        if (job.phase == JobPhase::waiting_for_scene && !job.is_being_kept && job.client() == peer)
            orphans.push_back(id);
    for (const JobId& id : orphans)
        if (departure == Departure::lost)
            ask_others_for_scene(jobs_.at(id).submission().scene);
        else
            give_up_scene(jobs_.at(id), "the client left before it had sent the scene");
}

/// A broker that was stopped, or waited long for its disk, has heard nobody meanwhile: that while
/// counts as nobody's silence.
void Dispatcher::note_own_absence(Duration since_last_step) {
    if (since_last_step <= limits_.heartbeat ||
        (workers_.empty() && clients_.empty() && is_alone()))
        return;
    log({.level = LogLevel::warning,
         .kind = "stood_still",
         .subject = {},
         .text = "this broker did nothing for " + format_duration(since_last_step) +
                 ", and heard nobody"});
    for (auto& [peer, worker] : workers_) {
        worker.heard_at = worker.heard_at + since_last_step;
        worker.moved_at = worker.moved_at + since_last_step;
        for (auto* held : {&worker.in_hand, &worker.had_in_hand})
            for (auto& [key, tile] : *held)
                tile.progress_at = tile.progress_at + since_last_step;
        for (auto& [key, grant] : worker.grants)
            grant.progress_at = grant.progress_at + since_last_step;
    }
    for (auto& [peer, client] : clients_)
        client.heard_at = client.heard_at + since_last_step;
    for (auto& [id, job] : jobs_)
        job.scene_came_on_at = job.scene_came_on_at + since_last_step;
    membership_.forgive(since_last_step);
}

void Dispatcher::drop_silent_peers() {
    const Duration patience = limits_.heartbeat * limits_.liveness;
    std::vector<PeerId> silent_workers, silent_clients;
    Instant first_heard_at = now_;
    const auto is_silent = [&](Instant heard_at) {
        if (now_ - heard_at > patience)
            return true;
        first_heard_at = std::min(first_heard_at, heard_at);
        return false;
    };
    for (const auto& [peer, worker] : workers_)
        if (is_silent(worker.heard_at))
            silent_workers.push_back(peer);
    for (const auto& [peer, client] : clients_)
        if (is_silent(client.heard_at))
            silent_clients.push_back(peer);
    // Of those who will be silent for too long before the next sweep the first one brings it
    // forward: its tiles wait for that.
    next_sweep_ = std::clamp(first_heard_at + patience + Duration(1), now_ + limits_.heartbeat / 32,
                             next_sweep_);
    for (const PeerId& peer : silent_workers)
        end_worker(workers_.find(peer), Departure::lost,
                   "silent for " + std::to_string(limits_.liveness) + " beats");
    for (const PeerId& peer : silent_clients)
        end_client(peer, Departure::lost);
}

} // namespace fraja::broker
