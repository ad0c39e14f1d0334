#include "tests/sim/kept.hpp"

#include "common/protocol/content_hash.hpp"

#include <algorithm>

namespace fraja::sim {
namespace {

Duration since(Duration at, Duration now) {
    return std::max(now - at, Duration::zero());
}

} // namespace

void Kept::put(const broker::Write& write, Duration wall_now) {
    std::visit([&](const auto& w) { put(w, wall_now); }, write);
}

void Kept::put(const broker::PutBlob& blob, Duration) {
    if (scenes_.contains(blob.hash))
        return;
    const Blob bytes = joined(blob.pieces);
    scenes_[blob.hash] = Bytes(bytes.begin(), bytes.end());
}

void Kept::put(const broker::PutJob& put, Duration now) {
    const JobId id = put.submission.job;
    if (const auto [at, is_new] = jobs_.try_emplace(id); is_new) {
        at->second.job.submission = put.submission;
        at->second.job.number = put.number;
        at->second.job.passes = put.passes;
        at->second.job.revision = put.revision;
        at->second.job.phase = put.phase;
        at->second.submitted_at = now;
    }
    std::erase_if(tombstones_, [&](const auto& tombstone) { return tombstone.first == id; });
    last_number_ = std::max(last_number_, put.number);
}

void Kept::put(const broker::PutTile& put, Duration) {
    const auto job = jobs_.find(put.tile->job);
    if (job != jobs_.end())
        job->second.tiles.try_emplace(
            TileKey{put.tile->tile, put.tile->rect.width, put.tile->rect.height}, put.tile);
}

void Kept::put(const broker::PutPhase& put, Duration now) {
    const auto job = jobs_.find(put.job);
    if (job == jobs_.end())
        return;
    KeptJob& kept = job->second;
    kept.job.phase = put.phase;
    kept.job.reason = put.reason;
    kept.job.elapsed = put.elapsed;
    kept.job.revision = put.revision;
    kept.job.checks = put.checks;
    kept.over_at =
        protocol::is_over(put.phase) ? kept.over_at.value_or(now) : std::optional<Duration>();
}

void Kept::put(const broker::PutDistrusted& put, Duration) {
    const auto job = jobs_.find(put.job);
    if (job == jobs_.end())
        return;
    auto& distrusted = job->second.job.distrusted;
    if (std::ranges::find(distrusted, put.worker) != distrusted.end())
        return;
    if (put.worker.worker != WorkerId{})
        distrusted.push_back(put.worker);
    for (const auto& tile : put.tiles)
        job->second.tiles.erase(TileKey{tile.tile, tile.size.width, tile.size.height});
}

void Kept::put(const broker::PutTrusted& put, Duration) {
    if (const auto job = jobs_.find(put.job); job != jobs_.end())
        std::erase_if(job->second.job.distrusted,
                      [&](const auto& who) { return who.worker == put.worker; });
}

void Kept::put(const broker::PutPriority& put, Duration) {
    if (const auto job = jobs_.find(put.job); job != jobs_.end()) {
        job->second.job.submission.priority = put.priority;
        job->second.job.revision = put.revision;
    }
}

void Kept::put(const broker::PutTerm& put, Duration) {
    epoch_ = std::max(epoch_, put.counter);
    last_term_ = std::max(last_term_, put.counter);
}

void Kept::put(const broker::PutNumber& put, Duration) {
    if (const auto job = jobs_.find(put.job); job != jobs_.end()) {
        job->second.job.number = put.number;
        job->second.job.revision = put.revision;
    }
    last_number_ = std::max(last_number_, put.number);
}

void Kept::put(const broker::ForgetJob& forget, Duration now) {
    jobs_.erase(forget.job);
    if (!forget.may_come_back &&
        std::ranges::find(tombstones_, forget.job, &std::pair<JobId, Duration>::first) ==
            tombstones_.end())
        tombstones_.emplace_back(forget.job, now);
    while (tombstones_.size() > tombstones_max_)
        tombstones_.pop_front();
    std::erase_if(scenes_, [this](const auto& scene) {
        return std::ranges::none_of(
            jobs_, [&](const auto& job) { return job.second.job.submission.scene == scene.first; });
    });
}

broker::Contents Kept::contents(Duration wall_now) const {
    broker::Contents contents;
    for (const auto& [id, kept] : jobs_) {
        broker::StoredJob job = kept.job;
        job.age = since(kept.submitted_at, wall_now);
        if (kept.over_at)
            job.over_for = since(*kept.over_at, wall_now);
        for (const auto& [key, tile] : kept.tiles)
            job.tiles.push_back({.tile = tile->tile,
                                 .frame = tile->frame,
                                 .pass = tile->pass,
                                 .rect = tile->rect,
                                 .rays = tile->rays,
                                 .elapsed = tile->elapsed,
                                 .worker = tile->worker,
                                 .worker_name = tile->worker_name,
                                 .pixels = protocol::content_hash(joined(tile->blobs))});
        contents.jobs.push_back(std::move(job));
    }
    std::ranges::sort(contents.jobs, {}, &broker::StoredJob::number);
    for (const auto& [hash, bytes] : scenes_)
        contents.blobs.push_back({hash, bytes.size()});
    for (const auto& [job, at] : tombstones_)
        contents.tombstones.push_back({job, since(at, wall_now)});
    contents.last_number = last_number_;
    contents.last_term = last_term_;
    return contents;
}

std::optional<Bytes> Kept::scene(const ContentHash& hash) const {
    const auto found = scenes_.find(hash);
    return found == scenes_.end() ? std::nullopt : std::optional(found->second);
}

std::vector<std::shared_ptr<const protocol::TileDone>> Kept::tiles(JobId job,
                                                                   TileIndex tile) const {
    std::vector<std::shared_ptr<const protocol::TileDone>> found;
    const auto kept = jobs_.find(job);
    if (kept == jobs_.end())
        return found;
    for (auto at = kept->second.tiles.lower_bound({tile, 0, 0});
         at != kept->second.tiles.end() && std::get<0>(at->first) == tile; ++at)
        found.push_back(at->second);
    return found;
}

} // namespace fraja::sim
