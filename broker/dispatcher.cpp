#include "broker/dispatcher.hpp"

#include "common/base/assert.hpp"
#include "common/base/text.hpp"

#include <algorithm>

namespace fraja::broker {

Dispatcher::Dispatcher(Identity identity, Limits limits)
    : identity_(std::move(identity)), limits_(limits),
      refusals_told_(limits.refusal_told_interval, limits.refusals_told_max),
      fetch_times_(limits.fetch_times_max), blobs_(limits.blob_bytes_max) {}

void Dispatcher::step(Instant now, const Event& event, std::vector<Action>& actions) {
    actions_ = &actions;
    note_own_absence(now - now_);
    now_ = std::max(now_, now);
    std::visit([this](const auto& e) { on(e); }, event);
    if (now_ >= next_sweep_) {
        next_sweep_ = now_ + limits_.heartbeat / 2;
        drop_silent_peers();
        take_back_stuck_tiles();
        end_quarantines();
        give_up_scenes_that_do_not_come();
        forget_what_is_old();
        forget_absent_workers();
        add_up_capacity();
    }
    end_jobs_whose_time_is_up();
    dispatch();
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
    if (!deadlines_.empty())
        deadline = std::min(deadline, deadlines_.begin()->first);
    if (!store_is_behind() && speed_.is_known() && somebody_is_idle() && somebody_has_tiles())
        deadline = std::min(deadline, next_overbook_);
    if (!free_workers_.empty() && !store_is_behind())
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
        const auto state = jobs_.at(id).state(identity_.epoch, now);
        lines.push_back("job #" + std::to_string(number) + " " + state.job_name + " " +
                        to_string(id) + ": " + std::to_string(state.done_count) + " of " +
                        counted(state.cell_count, "cell") + ", " +
                        std::to_string(state.in_flight_count) + " in flight");
    }
    return lines;
}

void Dispatcher::send(const PeerId& peer, protocol::Message message) {
    FRAJA_ASSERT(actions_ != nullptr);
    actions_->push_back(Send{peer, std::move(message)});
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
