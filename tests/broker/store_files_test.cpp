// What the store makes of the file and the directory it finds, and of an end without notice.
#include "broker/store.hpp"

#include "broker/restore.hpp"
#include "broker/sqlite.hpp"
#include "broker/store_reader.hpp"
#include "broker/store_schema.hpp"
#include "tests/broker/store_support.hpp"
#include "tests/support/seeds.hpp"

#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <doctest/doctest.h>
#include <fstream>
#include <sys/resource.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

using namespace fraja;
using namespace fraja::broker;
using namespace std::chrono_literals;
namespace fs = std::filesystem;

namespace {

using namespace std::chrono_literals;

Error refusal(const fs::path& directory) {
    const auto store = Store::open(directory);
    REQUIRE_FALSE(store.has_value());
    return store.error();
}

bool says(const Error& error, std::string_view text) {
    CAPTURE(error.message);
    const bool found = error.message.find(text) != std::string::npos;
    CHECK(found);
    return found;
}

void write_file(const fs::path& path, std::string_view text) {
    std::ofstream(path, std::ios::binary) << text;
}

void overwrite(const fs::path& path, std::size_t offset, std::string_view text) {
    std::fstream stream(path, std::ios::binary | std::ios::in | std::ios::out);
    stream.seekp(static_cast<std::streamoff>(offset));
    stream << text;
}

void execute(const fs::path& file, const std::string& sql) {
    auto database = Database::open(file, DatabaseAccess::writing);
    REQUIRE(database.has_value());
    database->set_untouched(false);
    REQUIRE(database->execute(sql).has_value());
}

/// A store with a job of so many tiles.
JobId fill(const fs::path& directory, std::uint32_t tiles) {
    Rng rng(1);
    Store store = open_store(directory);
    const PutJob job = job_of(rng, 1);
    std::vector<Write> writes{job};
    for (std::uint32_t i = 0; i < tiles; ++i)
        writes.emplace_back(tile_of(rng, job.submission.job, i, 24'576));
    REQUIRE(store.commit(writes, Durability::written).has_value());
    return job.submission.job;
}

} // namespace

TEST_CASE("a store of a newer broker is refused and says what to do") {
    const TempDirectory directory;
    fill(directory.path(), 1);
    execute(directory.file(), "PRAGMA user_version = 5");
    const std::string before = bytes_of(directory.file());
    const Error error = refusal(directory.path());
    CHECK(error.code == ErrorCode::version_mismatch);
    says(error, directory.file().string() + " was written by a newer fraja-broker (store version "
                                            "5, this one knows 4): use that one, or another "
                                            "--state");
    CHECK(bytes_of(directory.file()) == before);
}

TEST_CASE("a store of an earlier broker is read, and goes on as one of this") {
    const TempDirectory directory;
    const JobId job = fill(directory.path(), 3);
    const auto make_earlier = [&](int version, const std::string& what) {
        execute(directory.file(), what + "PRAGMA user_version = " + std::to_string(version));
    };
    int version = 3;
    SUBCASE("version 3, as it was in the end") {
        make_earlier(3, "");
    }
    SUBCASE("version 3, as it was at first, without terms") {
        make_earlier(3, "ALTER TABLE farm DROP COLUMN term;");
    }
    SUBCASE("version 2, which compared no tiles") {
        version = 2;
    }
    SUBCASE("version 1, which stood alone") {
        version = 1;
    }
    if (version <= 2)
        make_earlier(2, "ALTER TABLE farm DROP COLUMN term;"
                        "DROP TABLE distrusted;"
                        "ALTER TABLE jobs DROP COLUMN agreed;"
                        "ALTER TABLE jobs DROP COLUMN unchecked;");
    if (version <= 1)
        make_earlier(1, "ALTER TABLE jobs DROP COLUMN revised_by;"
                        "ALTER TABLE jobs DROP COLUMN revision;");
    for (int opened = 0; opened < 2; ++opened) {
        Store store = open_store(directory.path());
        const Contents contents = contents_of(store);
        REQUIRE(contents.jobs.size() == 1);
        CHECK(contents.jobs[0].tiles.size() == 3);
        CHECK((contents.jobs[0].revision == protocol::Revision{} || version > 1));
        CHECK(contents.jobs[0].checks == protocol::CheckCounts{});
        CHECK(contents.jobs[0].distrusted.empty());
        CHECK(contents.jobs[0].submission.job == job);
        CHECK(contents.last_term == (opened > 0 ? 1'000 : 0));
        commit(store, {PutPriority{job, 3, {}}, PutTerm{1'000}, PutTerm{900}});
        CHECK(Database::open(directory.file(), DatabaseAccess::reading)
                  ->integer("PRAGMA user_version")
                  .value() == store_version);
    }
}

TEST_CASE("a file that is no store is refused and left as it is") {
    const TempDirectory directory;
    SUBCASE("text") {
        write_file(directory.file(), "dear diary");
    }
    SUBCASE("another program's database") {
        execute(directory.file(), "CREATE TABLE recipes (name TEXT)");
    }
    SUBCASE("another program's database with an id") {
        execute(directory.file(), "PRAGMA application_id = 7; CREATE TABLE recipes (name TEXT)");
    }
    SUBCASE("another program's database with a log") {
        execute(directory.file(), "PRAGMA journal_mode = WAL; CREATE TABLE recipes (name TEXT)");
    }
    const std::string before = bytes_of(directory.file());
    const Error error = refusal(directory.path());
    CHECK(error.code == ErrorCode::invalid_argument);
    says(error, directory.file().string() + ": this is no store of fraja-broker");
    says(error, "--state");
    CHECK(bytes_of(directory.file()) == before);
}

TEST_CASE("a store in which nothing is yet is filled") {
    const TempDirectory directory;
    SUBCASE("an empty file") {
        write_file(directory.file(), "");
    }
    SUBCASE("no table") {
        execute(directory.file(), "PRAGMA journal_mode = WAL");
    }
    fill(directory.path(), 1);
    CHECK(contents_of(open_store(directory.path())).jobs.size() == 1);
}

TEST_CASE("a damaged store is refused and left as it is") {
    const TempDirectory directory;
    fill(directory.path(), 200);
    const std::size_t size = fs::file_size(directory.file());
    SUBCASE("bytes in its middle") {
        overwrite(directory.file(), size / 2, std::string(100'000, 'x'));
    }
    SUBCASE("its tables' page") {
        overwrite(directory.file(), 100, std::string(4'000, 'x'));
    }
    SUBCASE("its end is missing") {
        fs::resize_file(directory.file(), size / 2);
    }
    const std::string before = bytes_of(directory.file());
    for (int i = 0; i < 2; ++i) { // and again
        const Error error = refusal(directory.path());
        CHECK(error.code == ErrorCode::io);
        says(error, directory.file().string() + " is damaged");
        says(error, "--state");
        CHECK(bytes_of(directory.file()) == before);
    }
}

TEST_CASE("every start has a larger epoch, and a disk that is full is no reason to have none") {
    const TempDirectory directory;
    StoreOptions options;
    auto now = std::chrono::system_clock::time_point(1h);
    options.wall_clock = [&now] { return now; };
    const auto next = [&](rlim_t file_bytes_max) {
        rlimit before{};
        REQUIRE(getrlimit(RLIMIT_FSIZE, &before) == 0);
        auto store = Store::open(directory.path(), options);
        REQUIRE(store.has_value());
        const rlimit full{file_bytes_max, before.rlim_max};
        REQUIRE(setrlimit(RLIMIT_FSIZE, &full) == 0);
        const auto epoch = store->next_epoch();
        REQUIRE(setrlimit(RLIMIT_FSIZE, &before) == 0);
        REQUIRE(epoch.has_value());
        return *epoch;
    };
    const auto ignored = std::signal(SIGXFSZ, SIG_IGN);
    const std::uint64_t first = next(RLIM_INFINITY);
    CHECK(first == 3'600'000'000);
    CHECK(next(RLIM_INFINITY) == first + 1); // the clock stands
    CHECK(next(0) == first + 2);
    now += 1s;
    CHECK(next(0) == first + 1'000'000);
    now -= 1h;
    CHECK(next(RLIM_INFINITY) == first + 2); // those on a full disk were not kept
    std::signal(SIGXFSZ, ignored);
}

TEST_CASE("pixels and scenes that are not what was put are never given out") {
    const TempDirectory directory;
    const JobId job = fill(directory.path(), 1);
    Rng rng(3);
    const Bytes scene = noise(rng, 5'000);
    {
        Store store = open_store(directory.path());
        commit(store, {scene_of(scene)});
    }
    const auto check = [&] {
        const Store store = open_store(directory.path());
        auto reader = StoreReader::open(store);
        const auto contents = reader->read();
        return check_bytes(*contents, *reader);
    };
    CHECK(check().has_value());
    execute(directory.file(), "UPDATE pieces SET bytes = zeroblob(5000)");
    CHECK(says(check().error(), "is damaged"));
    execute(directory.file(), "UPDATE pixels SET bytes = zeroblob(24576)");
    CHECK(says(check().error(), "the pixels of tile 0 of job " + to_string(job)));
    const Store store = open_store(directory.path());
    auto reader = StoreReader::open(store);
    REQUIRE(reader.has_value());
    const std::array which{TileIndex{0}};
    const auto tiles = reader->tiles(job, which);
    REQUIRE_FALSE(tiles.has_value());
    says(tiles.error(), "the pixels of tile 0 of job " + to_string(job));
    const auto blob = reader->blob(protocol::content_hash(scene));
    REQUIRE_FALSE(blob.has_value());
    says(blob.error(), "is damaged");
}

TEST_CASE("a directory has one broker at a time") {
    const TempDirectory directory;
    {
        const Store store = open_store(directory.path());
        const Error error = refusal(directory.path());
        CHECK(error.code == ErrorCode::in_use);
        says(error, directory.path().string() + ": another fraja-broker is using it (process " +
                        std::to_string(getpid()) + ")");
    }
    open_store(directory.path());
}

TEST_CASE("a directory that cannot be used is refused with the system's reason") {
    const TempDirectory directory;
    SUBCASE("a file") {
        write_file(directory.path() / "file", "");
        says(refusal(directory.path() / "file"), "this is no directory");
        says(refusal(directory.path() / "file" / "in it"), "Not a directory");
    }
    SUBCASE("one that may not be written") {
        if (geteuid() == 0) // may do everything
            return;
        fs::permissions(directory.path(), fs::perms::owner_read | fs::perms::owner_exec);
        says(refusal(directory.path()), "Permission denied");
        says(refusal(directory.path() / "below"), "Permission denied");
    }
    SUBCASE("one whose file may not be written") {
        if (geteuid() == 0)
            return;
        fill(directory.path(), 1);
        fs::permissions(directory.file(), fs::perms::owner_read);
        says(refusal(directory.path()), "cannot be opened or written");
    }
}

// --------------------------------------------------------------------------------- killed, not
// asked

namespace {

/// In a child: commits tiles of the job from `first` on, and says each through the pipe when it is
/// in. Never returns.
[[noreturn]] void commit_for_ever(const fs::path& directory, const PutJob& job, std::uint32_t first,
                                  int pipe) {
    auto store = Store::open(directory);
    Rng rng(first);
    for (std::uint32_t index = first; store.has_value(); ++index) {
        const std::vector<Write> writes{job, tile_of(rng, job.submission.job, index, 40'000)};
        if (!store->commit(writes, index % 4 == 0 ? Durability::synced : Durability::written) ||
            write(pipe, &index, sizeof index) != sizeof index)
            break;
    }
    std::fputs("the child could not commit\n", stderr);
    _exit(1);
}

/// How many tiles are in, by the child's word.
std::uint32_t commit_until_killed(const fs::path& directory, const PutJob& job, std::uint32_t first,
                                  Duration life) {
    std::array<int, 2> pipe_ends{};
    REQUIRE(pipe(pipe_ends.data()) == 0);
    const pid_t child = fork();
    REQUIRE(child >= 0);
    if (child == 0) {
        close(pipe_ends[0]);
        commit_for_ever(directory, job, first, pipe_ends[1]);
    }
    close(pipe_ends[1]);
    std::this_thread::sleep_for(life);
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    CHECK(WIFSIGNALED(status));
    std::uint32_t count = first, index = 0;
    while (read(pipe_ends[0], &index, sizeof index) == sizeof index)
        count = index + 1;
    close(pipe_ends[0]);
    return count;
}

} // namespace

TEST_CASE("a broker that is killed while it makes its store can be started again") {
    for_each_seed(20, [](Rng& rng) {
        const TempDirectory directory;
        const PutJob job = job_of(rng, 1);
        const auto life = std::chrono::microseconds(rng.below(30'000));
        commit_until_killed(directory.path(), job, 0, life);
        open_store(directory.path());
    });
}

TEST_CASE("whatever was committed is there after a kill at any moment") {
    const TempDirectory directory;
    Rng jobs(1);
    const PutJob job = job_of(jobs, 1);
    std::uint32_t known = 0;
    for_each_seed(25, [&](Rng& rng) {
        const auto life = std::chrono::microseconds(rng.below(60'000));
        const std::uint32_t acknowledged = commit_until_killed(directory.path(), job, known, life);
        const Store store = open_store(directory.path()); // which looks for damage
        const Contents contents = contents_of(store);
        const std::size_t found = contents.jobs.empty() ? 0 : contents.jobs[0].tiles.size();
        CHECK(found >= acknowledged);
        CHECK(found <= acknowledged + 1); // the last may have been in before it was said
        auto reader = StoreReader::open(store);
        for (std::uint32_t i = known; i < found; ++i) {
            const std::array which{TileIndex{i}};
            const auto tiles = reader->tiles(job.submission.job, which);
            REQUIRE(tiles.has_value());
            CHECK(tiles->size() == 1);
        }
        known = static_cast<std::uint32_t>(found);
    });
    CHECK(known > 0);
}
