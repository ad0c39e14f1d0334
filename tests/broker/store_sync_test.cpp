// What is acknowledged has reached the disk before: counted below SQLite, where it asks the system
// for that. (A program that is killed loses nothing either way, as the system writes on.)
#include "broker/store_writer.hpp"
#include "common/net/waker.hpp"
#include "tests/broker/store_support.hpp"

#include <atomic>
#include <doctest/doctest.h>
#include <map>
#include <mutex>
#include <poll.h>
#include <sqlite3.h>
#include <variant>

using namespace fraja;
using namespace fraja::broker;

namespace {

std::atomic<int> syncs = 0;
sqlite3_vfs* real_vfs = nullptr;

/// Kinds of files have tables of their own.
struct CountingMethods {
    sqlite3_io_methods methods; ///< first, as SQLite knows it by its address
    const sqlite3_io_methods* real;
    CountingMethods(const sqlite3_io_methods& copied, const sqlite3_io_methods* of)
        : methods(copied), real(of) {}
};
std::map<const sqlite3_io_methods*, CountingMethods> counting_methods;
std::mutex counting_methods_mutex;

int count_sync(sqlite3_file* file, int flags) {
    ++syncs;
    return reinterpret_cast<const CountingMethods*>(file->pMethods)->real->xSync(file, flags);
}

int open_counted(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* opened_as) {
    const int status = real_vfs->xOpen(real_vfs, name, file, flags, opened_as);
    if (status != SQLITE_OK)
        return status;
    const std::lock_guard lock(counting_methods_mutex);
    const sqlite3_io_methods* real = file->pMethods;
    const auto [counting, is_new] = counting_methods.try_emplace(real, *real, real);
    if (is_new)
        counting->second.methods.xSync = count_sync;
    file->pMethods = &counting->second.methods;
    return SQLITE_OK;
}

/// While it lives, SQLite's syncs are counted.
class CountedSyncs {
public:
    CountedSyncs() {
        real_vfs = sqlite3_vfs_find(nullptr);
        counting_ = *real_vfs;
        counting_.zName = "counting";
        counting_.xOpen = open_counted;
        REQUIRE(sqlite3_vfs_register(&counting_, 1) == SQLITE_OK);
        syncs = 0;
    }
    ~CountedSyncs() { sqlite3_vfs_unregister(&counting_); }
    CountedSyncs(const CountedSyncs&) = delete;
    CountedSyncs& operator=(const CountedSyncs&) = delete;
    /// Since the last call.
    static int take() { return syncs.exchange(0); }

private:
    sqlite3_vfs counting_{};
};

void await_committed(StoreWriter& writer, const net::Waker& waker, std::uint64_t sequence) {
    for (;;) {
        waker.drain();
        for (const StoreNews& news : writer.take_news())
            if (const auto* committed = std::get_if<Committed>(&news);
                committed && committed->sequence >= sequence)
                return;
        pollfd wait{waker.fd(), POLLIN, 0};
        REQUIRE(poll(&wait, 1, 30'000) == 1);
    }
}

} // namespace

TEST_CASE("a commit that is to be durable waits for the disk, and no other") {
    const CountedSyncs counted;
    const TempDirectory directory;
    Store store = open_store(directory.path());
    Rng rng(1);
    const PutJob job = job_of(rng, 1);
    (void)CountedSyncs::take();
    commit(store, {job}, Durability::synced);
    CHECK(CountedSyncs::take() > 0);
    commit(store, {tile_of(rng, job.submission.job, 0, 100)}, Durability::written);
    CHECK(CountedSyncs::take() == 0);
    commit(store, {PutPhase{job.submission.job, protocol::JobPhase::done, "", {}}},
           Durability::synced);
    CHECK(CountedSyncs::take() > 0); // with the tile before it
}

TEST_CASE("a job and its end are told to be kept when they are on the disk, a tile before that") {
    const CountedSyncs counted;
    const TempDirectory directory;
    const net::Waker waker;
    StoreWriter writer(open_store(directory.path()), waker);
    Rng rng(1);
    const PutJob job = job_of(rng, 1);
    const JobId id = job.submission.job;
    std::uint64_t sequence = 0;
    const auto syncs_of = [&](Write write) {
        (void)CountedSyncs::take();
        writer.enqueue(std::move(write), ++sequence);
        await_committed(writer, waker, sequence);
        return CountedSyncs::take();
    };
    CHECK(syncs_of(job) > 0);
    CHECK(syncs_of(tile_of(rng, id, 0, 100)) == 0);
    CHECK(syncs_of(PutPhase{id, protocol::JobPhase::cancelled, "", {}}) > 0);
    CHECK(syncs_of(ForgetJob{id}) > 0);
}
