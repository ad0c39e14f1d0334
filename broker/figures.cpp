// Dispatcher: in numbers.
#include "broker/dispatcher.hpp"

namespace fraja::broker {

using namespace protocol;

Figures Dispatcher::figures() const {
    Figures all{.clients = clients_.size(),
                .jobs_watched = subscribed_jobs_.size(),
                .scene_bytes = blobs_.bytes(),
                .unstored_bytes = unstored_bytes_,
                .store_is_behind = store_is_behind(),
                .store_trouble = store_trouble_,
                .counters = counters_};
    count_brokers(all);
    count_jobs(all);
    count_workers(all);
    return all;
}

void Dispatcher::count_brokers(Figures& all) const {
    const std::size_t others_here = membership_.here(now_).size();
    all.leads = membership_.leads();
    all.term = term().counter;
    all.brokers_here = 1 + others_here;
    all.brokers_gone = copies_wanted() - others_here;
}

void Dispatcher::count_jobs(Figures& all) const {
    double rays_left = 0;
    const std::size_t wanted = copies_wanted();
    for (const auto& [id, job] : jobs_) {
        ++all.jobs[static_cast<std::size_t>(job.phase)];
        all.jobs_lacking_copies += !is_over(job.phase) && job.copies.size() < wanted ? 1u : 0u;
        if (job.phase != JobPhase::queued && job.phase != JobPhase::running)
            continue;
        all.cells_left += job.cells_left();
        rays_left += job.costs().left();
    }
    all.jobs_ready = ready_.size();
    if (speed_.is_known())
        all.work_left_s = rays_left / speed_.rays_per_s();
}

void Dispatcher::count_workers(Figures& all) const {
    for (const auto& [peer, worker] : workers_) {
        const bool is_draining = worker.drained || worker.credit == 0;
        ++(!worker.distrusted.empty() ? all.workers_distrusted
           : worker.quarantined_until ? all.workers_quarantined
           : is_draining              ? all.workers_draining
           : worker.held() == 0       ? all.workers_idle
                                      : all.workers_busy);
        all.credit += worker.room();
        all.tiles_in_flight += worker.held();
    }
    all.threads = threads_with_credit_;
}

} // namespace fraja::broker
