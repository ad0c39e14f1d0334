#include "broker/store_writer.hpp"

#include "broker/store_reader.hpp"
#include "common/net/waker.hpp"
#include "tests/broker/store_support.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <doctest/doctest.h>
#include <poll.h>
#include <sys/resource.h>
#include <thread>

using namespace fraja;
using namespace fraja::broker;
using namespace std::chrono_literals;

namespace {

constexpr Duration patience = 30s;
const WriterOptions impatient{.retry_pause = 5ms, .stop_patience = 100ms};

/// Waits for news of the wanted kind; all news on the way, that included.
template <class Wanted>
std::vector<StoreNews> news_until(StoreWriter& writer, const net::Waker& waker, Wanted wanted) {
    std::vector<StoreNews> all;
    const auto give_up = std::chrono::steady_clock::now() + patience;
    while (std::chrono::steady_clock::now() < give_up) {
        waker.drain();
        for (StoreNews& news : writer.take_news())
            all.push_back(std::move(news));
        for (const StoreNews& news : all)
            if (wanted(news))
                return all;
        pollfd wait{waker.fd(), POLLIN, 0};
        poll(&wait, 1, 1'000);
    }
    FAIL("no such news");
    return all;
}

std::vector<StoreNews> news_until_committed(StoreWriter& writer, const net::Waker& waker,
                                            std::uint64_t sequence) {
    return news_until(writer, waker, [&](const StoreNews& news) {
        return news == StoreNews(Committed{sequence});
    });
}

bool is_trouble(const StoreNews& news) {
    return std::holds_alternative<StoreTrouble>(news);
}

std::size_t trouble_count(const std::vector<StoreNews>& news) {
    return static_cast<std::size_t>(std::count_if(news.begin(), news.end(), is_trouble));
}

/// No file of this process grows beyond that, while it lives.
class FileSizeLimit {
public:
    explicit FileSizeLimit(rlim_t bytes_max) {
        getrlimit(RLIMIT_FSIZE, &before_);
        old_handler_ = std::signal(SIGXFSZ, SIG_IGN); // then writes fail
        rlimit limit = before_;
        limit.rlim_cur = bytes_max;
        setrlimit(RLIMIT_FSIZE, &limit);
    }
    ~FileSizeLimit() {
        setrlimit(RLIMIT_FSIZE, &before_);
        std::signal(SIGXFSZ, old_handler_);
    }
    FileSizeLimit(const FileSizeLimit&) = delete;
    FileSizeLimit& operator=(const FileSizeLimit&) = delete;

private:
    rlimit before_{};
    void (*old_handler_)(int) = nullptr;
};

} // namespace

TEST_CASE("the writer commits what it is given and says up to where") {
    const TempDirectory directory;
    Rng rng(1);
    const net::Waker waker;
    constexpr std::uint32_t tiles = 500;
    const PutJob job = job_of(rng, 1);
    {
        StoreWriter writer(open_store(directory.path()), waker, {.batch_bytes_max = 1 << 20});
        writer.enqueue(job, 1);
        for (std::uint32_t i = 0; i < tiles; ++i)
            writer.enqueue(tile_of(rng, job.submission.job, i, 10'000), 2 + i);
        const auto news = news_until_committed(writer, waker, 1 + tiles);
        std::uint64_t last = 0;
        for (const StoreNews& one : news) {
            REQUIRE(std::holds_alternative<Committed>(one));
            CHECK(std::get<Committed>(one).sequence > last);
            last = std::get<Committed>(one).sequence;
        }
        CHECK(writer.queued_bytes() == 0);
        CHECK(writer.stop());
        CHECK(writer.stop()); // once more is no harm
    }
    CHECK(contents_of(open_store(directory.path())).jobs.at(0).tiles.size() == tiles);
}

TEST_CASE("a writer that is stopped commits what is queued") {
    const TempDirectory directory;
    Rng rng(1);
    const net::Waker waker;
    const PutJob job = job_of(rng, 1);
    {
        StoreWriter writer(open_store(directory.path()), waker);
        writer.enqueue(job, 1);
        for (std::uint32_t i = 0; i < 300; ++i)
            writer.enqueue(tile_of(rng, job.submission.job, i, 10'000), 2 + i);
        CHECK(writer.stop());
        CHECK(writer.totals().commits > 0);
        CHECK(writer.totals().failed_commits == 0);
        CHECK(writer.totals().bytes > 300 * 10'000);
    }
    CHECK(contents_of(open_store(directory.path())).jobs.at(0).tiles.size() == 300);
}

TEST_CASE("a full disk loses nothing and is told once") {
    const TempDirectory directory;
    Rng rng(1);
    const net::Waker waker;
    const PutJob job = job_of(rng, 1);
    const JobId id = job.submission.job;
    StoreWriter writer(open_store(directory.path(), {.file_bytes_max = 1 << 20}), waker, impatient);
    writer.enqueue(job, 1);
    for (std::uint32_t i = 0; i < 100; ++i)
        writer.enqueue(tile_of(rng, id, i, 40'000), 2 + i);
    auto news = news_until(writer, waker, is_trouble);
    std::this_thread::sleep_for(50ms); // it is tried some times more
    for (const StoreNews& more : writer.take_news())
        news.push_back(more);
    CHECK(trouble_count(news) == 1);
    CHECK(std::get<StoreTrouble>(*std::find_if(news.begin(), news.end(), is_trouble))
              .reason.find("no more space") != std::string::npos);
    CHECK(writer.queued_bytes() > 0);
    CHECK(writer.totals().failed_commits > 0);
    writer.enqueue(PutPhase{id, protocol::JobPhase::done, "", 1s}, 102);
    writer.limit_file(0);
    const auto after = news_until_committed(writer, waker, 102);
    CHECK(after.front() == StoreNews(StoreRecovered{}));
    CHECK(trouble_count(after) == 0);
    CHECK(writer.queued_bytes() == 0);
    CHECK(writer.stop());
}

TEST_CASE("on a full disk a job that is to be forgotten makes room for what waits before it") {
    const TempDirectory directory;
    Rng rng(1);
    const net::Waker waker;
    const PutBlob scene = scene_of(noise(rng, 1'000));
    const PutJob old = job_of(rng, 1, scene.hash), young = job_of(rng, 2, scene.hash);
    Store store = open_store(directory.path(), {.file_bytes_max = 1 << 20});
    auto reader = StoreReader::open(store);
    StoreWriter writer(std::move(store), waker, impatient);
    writer.enqueue(scene, 1);
    writer.enqueue(old, 2);
    writer.enqueue(tile_of(rng, old.submission.job, 0, 600'000), 3);
    news_until_committed(writer, waker, 3);
    writer.enqueue(young, 4);
    writer.enqueue(tile_of(rng, young.submission.job, 0, 600'000), 5);
    news_until(writer, waker, is_trouble);
    writer.enqueue(tile_of(rng, old.submission.job, 1, 1'000), 6);
    writer.enqueue(ForgetJob{old.submission.job}, 7);
    news_until_committed(writer, waker, 7);
    const auto contents = reader->read();
    REQUIRE(contents.has_value());
    REQUIRE(contents->jobs.size() == 1);
    CHECK(contents->jobs[0].number == 2);
    CHECK(contents->jobs[0].tiles.size() == 1);
    CHECK(contents->blobs.size() == 1);
    CHECK(contents->tombstones.size() == 1);
    CHECK(writer.stop());
}

TEST_CASE("a disk that refuses to write loses nothing") {
    const TempDirectory directory;
    Rng rng(1);
    const net::Waker waker;
    const PutJob job = job_of(rng, 1);
    const JobId id = job.submission.job;
    StoreWriter writer(open_store(directory.path()), waker, impatient);
    writer.enqueue(job, 1);
    news_until_committed(writer, waker, 1);
    {
        const FileSizeLimit limit(200'000);
        for (std::uint32_t i = 0; i < 100; ++i)
            writer.enqueue(tile_of(rng, id, i, 40'000), 2 + i);
        const auto news = news_until(writer, waker, is_trouble);
        CHECK(std::get<StoreTrouble>(news.back()).reason.find(store_file_name) !=
              std::string::npos);
    }
    news_until_committed(writer, waker, 101);
    CHECK(writer.stop());
}

TEST_CASE("a writer in trouble stops when its patience ends and says that not all is in") {
    const TempDirectory directory;
    Rng rng(1);
    const net::Waker waker;
    const PutJob job = job_of(rng, 1);
    StoreWriter writer(open_store(directory.path(), {.file_bytes_max = 1 << 20}), waker, impatient);
    writer.enqueue(job, 1);
    writer.enqueue(tile_of(rng, job.submission.job, 0, 4 << 20), 2);
    const auto begun = std::chrono::steady_clock::now();
    CHECK_FALSE(writer.stop());
    CHECK(std::chrono::steady_clock::now() - begun < patience);
}

TEST_CASE("one thread reads while another writes") {
    const TempDirectory directory;
    Rng rng(1);
    const net::Waker waker;
    const PutJob job = job_of(rng, 1);
    Store store = open_store(directory.path());
    auto reader = StoreReader::open(store);
    REQUIRE(reader.has_value());
    StoreWriter writer(std::move(store), waker);
    writer.enqueue(job, 1);
    for (std::uint32_t i = 0; i < 400; ++i) {
        const PutTile tile = tile_of(rng, job.submission.job, i, 5'000);
        writer.enqueue(tile, 2 + i);
        if (i % 40 != 0)
            continue;
        news_until_committed(writer, waker, 2 + i);
        const std::array which{TileIndex{i}};
        const auto tiles = reader->tiles(job.submission.job, which);
        REQUIRE(tiles.has_value());
        REQUIRE(tiles->size() == 1);
        CHECK(same_tile(tiles->front(), *tile.tile));
    }
    CHECK(writer.stop());
}
