// Small farms with every kind of accident, as a seed will have them.
#include "common/base/rng.hpp"
#include "tests/sim/scenario.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <limits>

namespace fraja::sim {
namespace {

using namespace std::chrono_literals;

Duration between(Rng& rng, Duration low, Duration high) {
    return from_seconds(rng.between(seconds(low), seconds(high)));
}

Duration sometimes(Rng& rng, Duration low, Duration high) {
    return rng.below(3) == 0 ? Duration::zero() : between(rng, low, high);
}

/// Mostly nothing, else little or much.
double random_share(Rng& rng) {
    constexpr double shares[] = {0, 0, 0, 0.01, 0.1, 0.5};
    return rng.unit() * shares[rng.below(6)];
}

Faults random_faults(Rng& rng) {
    Faults f;
    f.heals_at = 5min;
    f.delay_max = sometimes(rng, 1ms, 2s) + 100us;
    f.breaks_every = sometimes(rng, 2s, 2min);
    f.partitions_every = sometimes(rng, 5s, 2min);
    f.partition_max = sometimes(rng, 1s, 60s);
    f.worker_crashes_every = sometimes(rng, 5s, 2min);
    f.broker_crashes_every = sometimes(rng, 20s, 3min);
    f.restart_max = sometimes(rng, 1s, 20s) + 20ms;
    f.hangs_every = sometimes(rng, 5s, 2min);
    f.hang_max = sometimes(rng, 1s, 30s);
    f.stream_drop = rng.below(2) == 0 ? 0 : rng.unit();
    f.hung_tiles = rng.below(4) == 0 ? rng.unit() * 0.05 : 0;
    f.machine_crashes = rng.below(2) == 0 ? 0 : rng.unit();
    f.disk_errors_every = sometimes(rng, 20s, 3min);
    f.disk_error_max = sometimes(rng, 1s, 60s);
    f.clock_jumps_every = sometimes(rng, 20s, 3min);
    f.controls_every = sometimes(rng, 5s, 1min);
    f.duplicates = random_share(rng);
    f.duplicate_lag_max = sometimes(rng, 10ms, 10s);
    return f;
}

broker::Limits random_limits(Rng& rng) {
    broker::Limits limits;
    limits.attempts_max = 1'000; // a tile's workers may crash as often as they like
    limits.scene_patience = 1h;  // and its client may be cut off
    constexpr Duration beats[] = {1s, 1s, 2s, 4s};
    limits.heartbeat = beats[rng.below(4)];
    constexpr Duration digests[] = {100ms, 1s, 2s, 5s};
    limits.digest_interval = digests[rng.below(4)];
    constexpr Duration helps[] = {50ms, 250ms, 1s};
    limits.overbook_interval = helps[rng.below(3)];
    return limits;
}

WorkerPlan random_worker(Rng& rng, bool first) {
    WorkerPlan worker;
    worker.threads = 1 + static_cast<std::uint32_t>(rng.below(4));
    worker.rays_per_s = 1e6 * rng.between(0.5, 4);
    if (!first && rng.below(4) == 0)
        worker.rays_per_s = rng.below(2) == 0 ? 5e4 : 1e4;
    if (first || rng.below(2) == 0)
        worker.tags = {"gpu", "os=linux"};
    return worker;
}

/// Uneven: a few squares of 8 x 8 cost a hundred times what most do.
WorkMap random_work(Rng& rng, Extent size, double rays_per_pixel) {
    constexpr std::uint32_t side = 8;
    std::vector<double> rays;
    for (std::uint32_t y = 0; y < size.height; y += side)
        for (std::uint32_t x = 0; x < size.width; x += side) {
            const double pixels = std::min(side, size.width - x) * std::min(side, size.height - y);
            rays.push_back(pixels *
                           std::max(1.0, rays_per_pixel * std::pow(10, rng.between(-1, 1))));
        }
    return {size, side, rays};
}

protocol::Wishes random_wishes(Rng& rng) {
    protocol::Wishes wishes;
    if (rng.below(4) == 0)
        wishes.workers_max = 1 + static_cast<std::uint32_t>(rng.below(3));
    if (rng.below(4) == 0)
        wishes.tags = {rng.below(2) == 0 ? "gpu" : "os"};
    if (rng.below(3) == 0)
        wishes.schedule = protocol::Schedule(rng.below(4));
    return wishes;
}

JobPlan random_job(Rng& rng, std::size_t index) {
    JobPlan job;
    job.at = between(rng, 0s, rng.below(4) == 0 ? 240s : 60s);
    job.settings.size = {8 + static_cast<std::uint32_t>(rng.below(90)),
                         8 + static_cast<std::uint32_t>(rng.below(60))};
    job.settings.crop = {0, 0, job.settings.size.width, job.settings.size.height};
    if (rng.below(4) == 0)
        job.settings.crop = {3, 1, job.settings.size.width - 5, job.settings.size.height - 4};
    job.settings.depth = 1 + static_cast<std::uint32_t>(index);
    job.priority = static_cast<std::int32_t>(rng.below(3));
    job.scene_bytes = rng.below(40) == 0 ? 600'000 : 100 + rng.below(1000);
    job.wishes = random_wishes(rng);
    job.work = random_work(rng, job.settings.size, std::pow(10, rng.between(0, 3)));
    switch (rng.below(6)) {
    case 0: // fixed
        job.tile_side = 4 + static_cast<std::uint32_t>(rng.below(20));
        break;
    case 1:
        job.settings.time_limit = between(rng, 5s, 120s);
        job.settings.max_samples = 4u << rng.below(6);
        job.wishes.schedule = protocol::Schedule::demand;
        break;
    case 2:
        job.settings.error = 1;
        break;
    default:
        break;
    }
    job.order = protocol::TileOrder(rng.below(3) == 0 ? rng.below(4) : 0);
    return job;
}

/// Frames of one film, all as the last job there is.
void add_film(Rng& rng, Scenario& s) {
    JobPlan frame = s.jobs.back();
    frame.settings.time_limit = {};
    frame.wishes.schedule = protocol::Schedule::demand;
    frame.wishes.film.bytes[0] = 1;
    if (std::ranges::any_of(s.workers, [](const WorkerPlan& w) { return w.rays_per_s < 1e5; }))
        frame.wishes.workers_max = 0; // one of these would keep the only place for hours
    const std::size_t frames = 2 + rng.below(8);
    for (std::size_t i = 0; i < frames; ++i) {
        frame.at += between(rng, 0s, 2s);
        frame.settings.depth = 1 + static_cast<std::uint32_t>(s.jobs.size());
        frame.wishes.frame = static_cast<std::uint32_t>(frames - i); // the last comes first
        frame.work = random_work(rng, frame.settings.size, std::pow(10, rng.between(0, 3)));
        s.jobs.push_back(frame);
    }
}

/// One of at least four workers, of whom the others are honest. Broker above broker is left out: to
/// the upper one all below the other are one worker.
void add_liar(Rng& rng, Scenario& s) {
    s.branches.clear();
    for (WorkerPlan& worker : s.workers)
        worker.branch = 0;
    while (s.workers.size() < 3)
        s.workers.push_back(random_worker(rng, false));
    s.workers.push_back(random_worker(rng, true));
    s.workers.back().lies = rng.below(2) == 0 ? 1 : rng.between(0.05, 1);
    for (JobPlan& job : s.jobs) {
        if (job.wishes.workers_max == 1)
            job.wishes.workers_max = 2;
        job.wishes.tags.clear(); // or there may be no third worker who can tell who is right
        job.wishes.verify = job.settings.limited_in_time() ? 0 : 1;
    }
    s.ends_at += 30min;
}

/// Jobs that few workers may draw: what these take at worst, one after the other.
Duration alone_on_slowest(const Scenario& s) {
    double rays_per_s = std::numeric_limits<double>::infinity(), rays = 0;
    for (const WorkerPlan& worker : s.workers)
        rays_per_s = std::min(rays_per_s, worker.threads * worker.rays_per_s);
    for (const JobPlan& job : s.jobs)
        if (job.wishes.workers_max > 0)
            rays += job.work.rays();
    return from_seconds(rays / rays_per_s);
}

} // namespace

void stand_for_each_other(Scenario& s, std::size_t brokers) {
    s.brokers = brokers;
    s.branches.clear();
    for (WorkerPlan& worker : s.workers)
        worker.branch = 0;
    Rng rng(s.seed);
    if (!has_liars(s) && rng.below(3) == 0) // what is not checked may outlive who leads
        add_liar(rng, s);
}

Scenario random_scenario(std::uint64_t seed) {
    Rng rng(seed);
    Scenario s;
    s.seed = rng.next();
    s.faults = random_faults(rng);
    s.limits = random_limits(rng);
    s.store.there = rng.below(4) != 0;
    s.store.commit_max = between(rng, 1ms, rng.below(4) == 0 ? 2s : 50ms);
    const std::size_t workers = 1 + rng.below(6);
    for (std::size_t i = 0; i < workers; ++i)
        s.workers.push_back(random_worker(rng, i == 0));
    if (rng.below(3) == 0) {
        s.branches.resize(1 + rng.below(2));
        for (std::size_t i = 1; i < workers; ++i) // the first suits every job
            s.workers[i].branch = rng.below(s.branches.size() + 1);
    }
    const std::size_t jobs = 1 + rng.below(4);
    for (std::size_t i = 0; i < jobs; ++i)
        s.jobs.push_back(random_job(rng, i));
    if (rng.below(3) == 0)
        add_film(rng, s);
    // All frames may be for one worker alone, at minutes each.
    s.ends_at = s.faults.heals_at + 30min + 5min * (s.jobs.size() - jobs) + alone_on_slowest(s);
    if (rng.below(6) == 0)
        add_liar(rng, s);
    if (rng.below(4) == 0)
        stand_for_each_other(s, 2 + rng.below(4));
    return s;
}

} // namespace fraja::sim
