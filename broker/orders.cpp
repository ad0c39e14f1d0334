// Dispatcher: tiles that another broker wants of this one. Each is a job that nobody sees, keeps or
// follows: whoever wants it has all that, and asks again if this broker dies.
#include "broker/dispatcher.hpp"

#include "common/protocol/probe.hpp"

#include <algorithm>
#include <utility>

namespace fraja::broker {

using namespace protocol;

namespace {

constexpr std::uint32_t pass_tile_side = 8; // so that many workers may share a pass's tile

} // namespace

void Dispatcher::on(const Ordered& event) {
    const Order& order = event.order;
    const auto acquired = blobs_.acquire(order.scene, order.scene_text.size());
    if (!acquired)
        return actions_->push_back(
            OrderFailed{order.id, FailureCode::machine, acquired.error().message});
    bring_scene(order.scene, order.scene_text);

    SubmitJob submission{.job = order.id,
                         .job_name = "an order",
                         .scene = order.scene,
                         .scene_bytes = order.scene_text.size(),
                         .settings = order.settings,
                         .wishes = {}};
    submission.settings.crop = order.rect;
    if (order.settings.limited_in_time())
        submission.tile_side = pass_tile_side;
    Job& job = jobs_.emplace(order.id, Job(std::move(submission), ++last_order_, {})).first->second;
    if (order.settings.limited_in_time())
        job.set_only_pass(order.pass);
    if (order.probe_side > 0) {
        (void)job.drop_unfinished(); // the probe is all
        job.probe = Job::Probe::wanted;
    }
    job.holds_scene = true;
    job.phase = JobPhase::running;
    job.submitted_at = now_;
    job.acknowledged_at = now_;
    job.join(orders_party_);
    orders_[order.id] = {
        .scene = order.scene, .crop = order.settings.crop, .probe_side = order.probe_side};
    look_ready(job);
}

void Dispatcher::on(const OrderWithdrawn& event) {
    if (Job* job = job_of(event.id); job && is_order(*job))
        end_job(*job, JobPhase::cancelled, "");
}

void Dispatcher::fill_probe(Job& job, const TileRendered& answer) {
    job.probe = Job::Probe::over;
    actions_->push_back(OrderFilled{job.id(), {}, answer.blobs, answer.rays, answer.elapsed});
    end_job(job, JobPhase::cancelled, "");
}

/// Tells whoever ordered it, unless it was cancelled, and forgets it.
void Dispatcher::end_order(Job& job, JobPhase phase, FailureCode fault) {
    if (phase == JobPhase::done) {
        OrderFilled filled{job.id(), {}, {}, job.rays(), job.render_time()};
        for (const Job::Result& result : job.results())
            if (!result.is_void)
                filled.parts.push_back(result.pixels);
        actions_->push_back(std::move(filled));
    } else if (phase == JobPhase::failed) {
        actions_->push_back(OrderFailed{job.id(), fault, job.reason});
    }
    const auto order = orders_.find(job.id());
    order->second.over = true;
    jobs_.erase(order->first);
    let_order_go_if_over(order);
}

/// Whoever has a tile of it may be about to ask for its scene, though the tile is not wanted.
void Dispatcher::let_order_go_if_over(Orders::iterator order) {
    if (!order->second.over || order->second.grants > 0)
        return;
    blobs_.release(order->second.scene);
    orders_.erase(order);
}

void Dispatcher::count_grant_of_order(const JobId& job, bool begins) {
    const auto order = orders_.find(job);
    if (order == orders_.end())
        return;
    order->second.grants += begins ? 1 : -1u;
    let_order_go_if_over(order);
}

std::vector<OrderProgress> Dispatcher::order_progress() const {
    std::vector<OrderProgress> progress;
    for (const auto& [id, order] : orders_)
        if (!order.over)
            progress.push_back({id, jobs_.at(id).rays().total()});
    if (progress.empty())
        return progress;
    for (const auto& [peer, worker] : workers_)
        for (const auto& [key, grant] : worker.grants) {
            const auto of = std::ranges::lower_bound(progress, key.job, {}, &OrderProgress::id);
            if (of != progress.end() && of->id == key.job)
                of->rays += grant.rays;
        }
    return progress;
}

} // namespace fraja::broker
