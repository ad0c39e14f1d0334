#include "broker/store.hpp"

#include "broker/store_reader.hpp"
#include "tests/broker/store_support.hpp"
#include "tests/support/seeds.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::broker;
using namespace std::chrono_literals;

namespace {

/// A wall clock that stands where it is put.
struct HandClock {
    std::shared_ptr<Duration> since_1970 = std::make_shared<Duration>(1'000'000h);
    std::chrono::system_clock::time_point operator()() const {
        return std::chrono::system_clock::time_point(*since_1970);
    }
};

std::vector<protocol::TileDone> tiles_of(const Store& store, const JobId& job,
                                         std::initializer_list<std::uint32_t> which) {
    std::vector<TileIndex> indices;
    for (const std::uint32_t index : which)
        indices.push_back(TileIndex{index});
    auto reader = StoreReader::open(store);
    REQUIRE(reader.has_value());
    auto tiles = reader->tiles(job, indices);
    REQUIRE(tiles.has_value());
    return std::move(*tiles);
}

std::optional<Bytes> blob_of(const Store& store, const ContentHash& hash) {
    auto reader = StoreReader::open(store);
    REQUIRE(reader.has_value());
    auto blob = reader->blob(hash);
    REQUIRE(blob.has_value());
    return std::move(*blob);
}

StoredTile stored(const PutTile& put) {
    const protocol::TileDone& t = *put.tile;
    return {t.tile,   t.frame,       t.pass,
            t.rect,   t.rays,        t.elapsed,
            t.worker, t.worker_name, protocol::content_hash(joined(t.blobs))};
}

} // namespace

TEST_CASE("a new store is empty") {
    const TempDirectory directory;
    const Contents contents = contents_of(open_store(directory.path() / "made" / "for it"));
    CHECK(contents.jobs.empty());
    CHECK(contents.blobs.empty());
    CHECK(contents.tombstones.empty());
    CHECK(contents.last_number == 0);
    const auto mode = std::filesystem::status(directory.path() / "made" / "for it").permissions();
    CHECK(mode == std::filesystem::perms::owner_all); // nobody else's
}

TEST_CASE("a copy without its scene is kept with its phase") {
    const TempDirectory directory;
    Rng rng(1);
    PutJob copy = job_of(rng, 1);
    copy.phase = protocol::JobPhase::cancelled;
    Store store = open_store(directory.path());
    commit(store, {copy});
    CHECK(contents_of(store).jobs.at(0).phase == copy.phase);
}

TEST_CASE("what was committed is there when the store is opened again") {
    for_each_seed(10, [](Rng& rng) {
        const TempDirectory directory;
        const Bytes scene = noise(rng, rng.below(3) * protocol::chunk_bytes + rng.below(3));
        const PutBlob blob = scene_of(scene);
        PutJob job = job_of(rng, 7, blob.hash);
        job.passes = 3;
        const JobId id = job.submission.job;
        const PutTile first = tile_of(rng, id, 0, 100);
        const PutTile last = tile_of(rng, id, 4'194'303, protocol::chunk_bytes + 1);
        const PutPhase phase{id, protocol::JobPhase::failed, std::string("wh\0y", 4), -5s};
        {
            Store store = open_store(directory.path());
            commit(store, {blob, job, last});
            commit(store, {first, phase, PutPriority{id, -3}}, Durability::synced);
        }
        const Store store = open_store(directory.path());
        const Contents contents = contents_of(store);
        REQUIRE(contents.jobs.size() == 1);
        const StoredJob& found = contents.jobs.front();
        job.submission.priority = -3;
        CHECK(found.submission == job.submission);
        CHECK(found.number == 7);
        CHECK(found.passes == 3);
        CHECK(found.phase == phase.phase);
        CHECK(found.reason == phase.reason);
        CHECK(found.elapsed == phase.elapsed);
        CHECK(found.age >= 0s);
        CHECK(found.over_for.has_value());
        CHECK(found.tiles == std::vector{stored(first), stored(last)});
        CHECK(contents.last_number == 7);
        CHECK(contents.blobs == std::vector{StoredBlob{blob.hash, scene.size()}});
        CHECK(blob_of(store, blob.hash) == scene);
        const auto tiles = tiles_of(store, id, {4'194'303, 5, 0}); // 5 is not there
        REQUIRE(tiles.size() == 2);
        CHECK(same_tile(tiles[0], *last.tile));
        CHECK(same_tile(tiles[1], *first.tile));
    });
}

TEST_CASE("the largest tile comes back as it was, cut as it travelled") {
    const TempDirectory directory;
    Rng rng(1);
    Store store = open_store(directory.path());
    const PutJob job = job_of(rng, 1);
    const PutTile tile = tile_of(rng, job.submission.job, 0, std::size_t{1024} * 1024 * 12);
    commit(store, {job, tile});
    const auto tiles = tiles_of(store, job.submission.job, {0});
    REQUIRE(tiles.size() == 1);
    CHECK(tiles[0].blobs.size() == 24);
    CHECK(same_tile(tiles[0], *tile.tile));
}

TEST_CASE("everything may be put twice and the first stands") {
    const TempDirectory directory;
    Rng rng(1);
    HandClock clock;
    Store store = open_store(directory.path(), {.wall_clock = clock});
    const PutBlob blob = scene_of(noise(rng, 1000));
    const PutJob job = job_of(rng, 5, blob.hash);
    const JobId id = job.submission.job;
    const PutTile tile = tile_of(rng, id, 0, 100), other = tile_of(rng, id, 0, 200);
    const PutPhase phase{id, protocol::JobPhase::done, "", 9s};
    commit(store, {blob, job, tile, phase});
    *clock.since_1970 += 1h;
    PutJob again = job;
    again.submission.job_name = "another";
    commit(store, {blob, again, other, phase});
    auto reader = StoreReader::open(store, clock);
    const auto contents = reader->read();
    REQUIRE(contents.has_value());
    REQUIRE(contents->jobs.size() == 1);
    CHECK(contents->jobs[0].submission == job.submission);
    CHECK(contents->jobs[0].age == 1h);
    CHECK(contents->jobs[0].over_for == 1h);
    CHECK(contents->jobs[0].tiles == std::vector{stored(tile)});
    CHECK(contents->blobs.size() == 1);
    CHECK(same_tile(tiles_of(store, id, {0}).at(0), *tile.tile));
}

TEST_CASE("the tiles of a worker that is distrusted go, and it stays named") {
    const TempDirectory directory;
    Rng rng(1);
    const PutJob job = job_of(rng, 5);
    const JobId id = job.submission.job;
    const PutTile wrong = tile_of(rng, id, 0, 100), right = tile_of(rng, id, 1, 100);
    const PutTile anew = tile_of(rng, id, 0, 100);
    const PutDistrusted distrusted{
        id, {wrong.tile->worker, "b", "it lies"}, {{TileIndex{0}, {8, 8}}}, {}};
    const PutPhase phase{id, protocol::JobPhase::done, "", 9s, {}, {3, 1}};
    {
        Store store = open_store(directory.path());
        commit(store, {job, wrong, right, distrusted, anew});
        commit(store, {distrusted, phase}); // the second time nothing goes
    }
    Store store = open_store(directory.path());
    const StoredJob kept = contents_of(store).jobs.at(0);
    CHECK(kept.tiles == std::vector{stored(anew), stored(right)});
    CHECK(kept.distrusted == std::vector{distrusted.worker});
    CHECK(kept.checks == protocol::CheckCounts{3, 1});
    CHECK(same_tile(tiles_of(store, id, {0}).at(0), *anew.tile));
    commit(store, {PutTrusted{random_id<JobId>(), distrusted.worker.worker}, // of another job
                   PutTrusted{id, random_id<WorkerId>()}});
    CHECK(contents_of(store).jobs.at(0).distrusted.size() == 1);
    commit(store, {PutTrusted{id, distrusted.worker.worker}, wrong});
    CHECK(contents_of(store).jobs.at(0).distrusted.empty());
    commit(store, {distrusted});
    CHECK(contents_of(store).jobs.at(0).distrusted.size() == 1);
    commit(store, {ForgetJob{id}, job});
    CHECK(contents_of(store).jobs.at(0).distrusted.empty());
}

TEST_CASE("what is about a job that is not there does nothing") {
    const TempDirectory directory;
    Rng rng(1);
    Store store = open_store(directory.path());
    const JobId nobody = random_id<JobId>();
    commit(store, {tile_of(rng, nobody, 0, 100), PutPriority{nobody, 1},
                   PutPhase{nobody, protocol::JobPhase::done, "", 1s},
                   PutDistrusted{nobody, {random_id<WorkerId>(), "b", ""}, {}, {}}});
    CHECK(contents_of(store).jobs.empty());
    CHECK(tiles_of(store, nobody, {0}).empty());
}

TEST_CASE("a forgotten job goes with its tiles and leaves a tombstone") {
    const TempDirectory directory;
    Rng rng(1);
    HandClock clock;
    Store store = open_store(directory.path(), {.wall_clock = clock});
    const PutJob gone = job_of(rng, 1), kept = job_of(rng, 2);
    const JobId id = gone.submission.job;
    commit(store,
           {gone, kept, tile_of(rng, id, 0, 100), tile_of(rng, kept.submission.job, 0, 100)});
    commit(store, {ForgetJob{id}});
    *clock.since_1970 += 1min;
    commit(store, {ForgetJob{id}, tile_of(rng, id, 1, 100)}); // too late
    auto reader = StoreReader::open(store, clock);
    const auto contents = reader->read();
    REQUIRE(contents.has_value());
    REQUIRE(contents->jobs.size() == 1);
    CHECK(contents->jobs[0].number == 2);
    CHECK(contents->jobs[0].tiles.size() == 1);
    CHECK(tiles_of(store, id, {0, 1}).empty());
    REQUIRE(contents->tombstones.size() == 1);
    CHECK(contents->tombstones[0].job == id);
    CHECK(contents->tombstones[0].age == 1min);
    CHECK(contents->last_number == 2);
    commit(store, {ForgetJob{kept.submission.job}});
    CHECK(contents_of(store).last_number == 2); // numbers are not used again
    commit(store, {gone});
    CHECK(contents_of(store).tombstones.size() == 1); // it is there again
}

TEST_CASE("a scene goes with the last job that needs it") {
    const TempDirectory directory;
    Rng rng(1);
    Store store = open_store(directory.path());
    const PutBlob shared = scene_of(noise(rng, 1000)), own = scene_of(noise(rng, 2000));
    const PutJob a = job_of(rng, 1, shared.hash), b = job_of(rng, 2, shared.hash),
                 c = job_of(rng, 3, own.hash);
    commit(store, {shared, own, a, b, c});
    commit(store, {ForgetJob{a.submission.job}});
    CHECK(contents_of(store).blobs.size() == 2);
    commit(store, {ForgetJob{b.submission.job}});
    CHECK(contents_of(store).blobs == std::vector{StoredBlob{own.hash, 2000}});
    CHECK_FALSE(blob_of(store, shared.hash).has_value());
    CHECK(blob_of(store, own.hash).has_value());
    commit(store, {shared, b}); // it may come again
    CHECK(blob_of(store, shared.hash).has_value());
}

TEST_CASE("tombstones are kept up to their limit, the newest ones") {
    const TempDirectory directory;
    Store store = open_store(directory.path(), {.tombstones_max = 3});
    std::vector<JobId> jobs;
    for (int i = 0; i < 10; ++i) {
        jobs.push_back(random_id<JobId>());
        commit(store, {ForgetJob{jobs.back()}});
    }
    const Contents contents = contents_of(store);
    REQUIRE(contents.tombstones.size() == 3);
    for (std::size_t i = 0; i < 3; ++i)
        CHECK(contents.tombstones[i].job == jobs[7 + i]);
}

TEST_CASE("ages come from the wall clock and a clock that goes back does no harm") {
    const TempDirectory directory;
    Rng rng(1);
    HandClock clock;
    Store store = open_store(directory.path(), {.wall_clock = clock});
    const PutJob job = job_of(rng, 1);
    commit(store, {job});
    *clock.since_1970 += 10s;
    const auto put = [&](protocol::JobPhase phase) {
        commit(store, {PutPhase{job.submission.job, phase, "", 0s}});
    };
    auto reader = StoreReader::open(store, clock);
    put(protocol::JobPhase::running);
    CHECK_FALSE(reader->read()->jobs[0].over_for.has_value());
    put(protocol::JobPhase::cancelled);
    *clock.since_1970 += 5s;
    CHECK(reader->read()->jobs[0].age == 15s);
    CHECK(reader->read()->jobs[0].over_for == 5s);
    *clock.since_1970 -= 1000h;
    CHECK(reader->read()->jobs[0].age == 0s);
    CHECK(reader->read()->jobs[0].over_for == 0s);
}

TEST_CASE("jobs are read in the order of their numbers") {
    const TempDirectory directory;
    Rng rng(1);
    Store store = open_store(directory.path());
    commit(store, {job_of(rng, 30), job_of(rng, 4), job_of(rng, 7)});
    const Contents contents = contents_of(store);
    REQUIRE(contents.jobs.size() == 3);
    CHECK(contents.jobs[0].number == 4);
    CHECK(contents.jobs[2].number == 30);
    CHECK(contents.last_number == 30);
}

TEST_CASE("a commit that finds no space changes nothing and works once there is some") {
    const TempDirectory directory;
    Rng rng(1);
    Store store = open_store(directory.path(), {.file_bytes_max = 1 << 20});
    const PutJob job = job_of(rng, 1);
    const JobId id = job.submission.job;
    commit(store, {job});
    const std::vector<Write> writes{tile_of(rng, id, 0, 100'000), tile_of(rng, id, 1, 2 << 20)};
    for (int i = 0; i < 3; ++i) {
        const auto done = store.commit(writes, Durability::synced);
        REQUIRE_FALSE(done.has_value());
        CHECK(done.error().message.find("no more space") != std::string::npos);
        CHECK(contents_of(store).jobs[0].tiles.empty());
    }
    REQUIRE(store.limit_file(0).has_value());
    REQUIRE(store.commit(writes, Durability::synced).has_value());
    CHECK(contents_of(store).jobs[0].tiles.size() == 2);
}

TEST_CASE("space that a forgotten job leaves is used again") {
    const TempDirectory directory;
    Rng rng(1);
    Store store = open_store(directory.path(), {.file_bytes_max = 3 << 20});
    for (std::uint32_t number = 1; number <= 10; ++number) {
        const PutJob job = job_of(rng, number);
        commit(store, {job, tile_of(rng, job.submission.job, 0, 2 << 20)});
        commit(store, {ForgetJob{job.submission.job}});
    }
    CHECK(contents_of(store).jobs.empty());
}
