#include "broker/restore.hpp"

#include "broker/sqlite.hpp"
#include "broker/submission.hpp"

#include <algorithm>
#include <span>
#include <utility>

namespace fraja::broker {

Result<Restored> restore(const Store& store, StoreReader& reader) {
    auto contents = reader.read();
    if (!contents)
        return contents.error();
    for (const StoredJob& job : contents->jobs)
        if (const auto fault = fault_of(job))
            return damaged(store.file(), "job " + to_string(job.submission.job) + ": " + *fault);
    if (std::ranges::adjacent_find(contents->jobs, {}, &StoredJob::number) != contents->jobs.end())
        return damaged(store.file(), "two jobs with one number");
    Restored restored{std::move(*contents), {}};
    for (const StoredJob& job : restored.contents.jobs) {
        const ContentHash& scene = job.submission.scene;
        if (is_over(job.phase) || restored.scenes.contains(scene))
            continue;
        auto bytes = reader.blob(scene);
        if (!bytes)
            return bytes.error();
        if (*bytes)
            restored.scenes[scene] = std::move(**bytes);
    }
    return restored;
}

Result<void> check_bytes(const Contents& contents, StoreReader& reader) {
    for (const StoredJob& job : contents.jobs)
        for (const StoredTile& stored : job.tiles)
            if (const auto tile =
                    reader.tiles(job.submission.job, std::span(&stored.tile, std::size_t{1}));
                !tile)
                return tile.error();
    for (const StoredBlob& blob : contents.blobs)
        if (const auto bytes = reader.blob(blob.hash); !bytes)
            return bytes.error();
    return {};
}

} // namespace fraja::broker
