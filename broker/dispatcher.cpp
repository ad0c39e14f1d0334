#include "broker/dispatcher.hpp"

#include "common/base/assert.hpp"
#include "common/base/text.hpp"

#include <algorithm>

namespace fraja::broker {

Dispatcher::Dispatcher(Identity identity, Limits limits)
    : identity_(std::move(identity)), limits_(limits),
      refusals_told_(limits.refusal_told_interval, limits.refusals_told_max),
      membership_(
          {identity_.unix_offset + (identity_.started_at - Instant{}), identity_.broker},
          {.patience = from_seconds(limits.peer_patience_beats * seconds(limits.heartbeat)),
           .patience_max = from_seconds(2 * limits.peer_patience_beats * seconds(limits.heartbeat)),
           .settling = 2 * limits.heartbeat / limits.peer_beats,
           .told_patience = from_seconds(limits.told_patience_beats * seconds(limits.heartbeat)),
           .told_margin = from_seconds(limits.peer_patience_beats / 2 * seconds(limits.heartbeat)),
           .workers_patience = limits.workers_patience_beats * limits.heartbeat,
           .workers_settling = 2 * limits.heartbeat,
           .counter_min = identity_.epoch,
           .rumours_apart = limits.rumour_beats * limits.heartbeat},
          identity_.peers.empty(), identity_.started_at),
      fetch_times_(limits.fetch_times_max), blobs_(limits.blob_bytes_max),
      now_(identity_.started_at) {}

void Dispatcher::step(Instant now, const Event& event, std::vector<Action>& actions) {
    actions_ = &actions;
    note_own_absence(now - now_);
    now_ = std::max(now_, now);
    look_who_leads();
    std::visit([this](const auto& e) { on(e); }, event);
    look_who_leads();
    heed_new_term();
    if (now_ >= next_company_ && !is_alone()) {
        next_company_ = now_ + limits_.heartbeat / limits_.peer_beats;
        keep_company();
    }
    if (now_ >= next_sweep_) {
        next_sweep_ = now_ + limits_.heartbeat / 2;
        drop_silent_peers();
        take_back_stuck_tiles();
        end_quarantines();
        end_jobs_that_are_through();
        give_up_scenes_that_do_not_come();
        give_up_tiles_that_do_not_come();
        forget_what_is_old();
        forget_absent_workers();
        add_up_capacity();
        if (!is_alone())
            look_what_is_drawn_elsewhere();
    }
    if (deals_out()) {
        end_jobs_whose_time_is_up();
        dispatch();
    } else {
        changed_workers_.clear(); // all of them are looked at when it is to give out tiles
    }
    tell_changes();
    if (now_ >= next_digest_) {
        next_digest_ = now_ + limits_.digest_interval;
        publish_digests();
    }
    if (now_ >= next_farm_state_) {
        next_farm_state_ = now_ + limits_.farm_interval;
        publish_farm_state();
    }
    actions_ = nullptr;
}

void Dispatcher::change_limits(const Limits& limits) {
    limits_.lease = limits.lease;
    limits_.attempts_max = limits.attempts_max;
    limits_.quarantine_failures = limits.quarantine_failures;
    limits_.quarantine_window = limits.quarantine_window;
    limits_.keep = limits.keep;
}

Instant Dispatcher::next_deadline() const {
    Instant deadline = next_sweep_;
    if (!is_alone())
        deadline = std::min({deadline, next_company_, membership_.next_deadline(now_),
                             gathers_until_.value_or(Instant::never())});
    if (!deadlines_.empty() && deals_out())
        deadline = std::min(deadline, deadlines_.begin()->first);
    if (deals_out() && !store_is_behind() && speed_.is_known() && somebody_is_idle() &&
        somebody_has_tiles())
        deadline = std::min(deadline, next_overbook_);
    if (deals_out() && !free_workers_.empty() && !store_is_behind())
        deadline = std::min(deadline, held_back_until_);
    const bool digests = std::ranges::any_of(subscribed_jobs_, [this](const JobId& id) {
        const auto found = jobs_.find(id);
        return found != jobs_.end() && wants_digest(found->second);
    });
    if (digests)
        deadline = std::min(deadline, next_digest_);
    if (farm_subscribed_)
        deadline = std::min(deadline, next_farm_state_);
    return deadline;
}

std::string Dispatcher::described_revisions(const Job& job) const {
    if (is_alone())
        return {};
    const auto words = [](const protocol::Revision& revision) {
        return std::to_string(revision.counter) + " of " + to_string(revision.broker).substr(0, 8);
    };
    return ", revision " + words(job.revision) +
           (job.awaited ? ", waits to follow " + words(job.awaited->revision) +
                              (job.leader_agrees ? "" : " once who leads has come to it")
                        : "");
}

std::vector<std::string> Dispatcher::describe(Instant now) const {
    std::vector<std::string> lines;
    lines.push_back(counted(workers_.size(), "worker") + ", " + counted(jobs_.size(), "job") +
                    ", " + counted(client_count(), "client"));
    for (const auto& [peer, worker] : workers_)
        lines.push_back(
            "worker " + worker.hello.worker_name + " " + to_string(worker.hello.worker) + ": " +
            std::to_string(worker.grants.size()) + " of " + counted(worker.credit, "tile") +
            " in flight, " + std::to_string(worker.tiles_done) + " done");
    for (const auto& [number, id] : job_by_number_) {
        const auto state = jobs_.at(id).state(term().counter, now);
        lines.push_back("job #" + std::to_string(number) + " " + state.job_name + " " +
                        to_string(id) + ": " + std::to_string(state.done_count) + " of " +
                        counted(state.cell_count, "cell") + ", " +
                        std::to_string(state.in_flight_count) + " in flight" +
                        (is_over(state.phase) ? ", over" : "") + described_revisions(jobs_.at(id)));
    }
    return lines;
}

/// A job that came from another broker has no client here: what would be for it is for nobody.
void Dispatcher::send(const PeerId& peer, protocol::Message message) {
    FRAJA_ASSERT(actions_ != nullptr);
    const protocol::Version spoken = version_of(peer);
    if (peer.empty() || !is_known_to(spoken, message)) // which an older peer does without
        return;
    actions_->push_back(Send{peer, std::move(message), spoken});
}

/// Whoever speaks is answered in the same version, a session goes on in that of its hello.
protocol::Version Dispatcher::version_of(const PeerId& peer) const {
    if (peer == speaker_.peer)
        return speaker_.version;
    const auto older = older_peers_.find(peer);
    return older == older_peers_.end() ? protocol::version : older->second;
}

bool Dispatcher::may_follow(const PeerId& peer, const Job& job) const {
    return !job.is_checked() || version_of(peer) >= checked_jobs_since;
}

void Dispatcher::log(Log line) {
    FRAJA_ASSERT(actions_ != nullptr);
    actions_->push_back(std::move(line));
}

Job* Dispatcher::job_of(const JobId& id) {
    const auto found = jobs_.find(id);
    return found == jobs_.end() ? nullptr : &found->second;
}

} // namespace fraja::broker
