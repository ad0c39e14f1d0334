// How fast the broker's store takes tiles, and what a start from it costs.
#include "broker/store_reader.hpp"
#include "broker/store_writer.hpp"
#include "common/base/rng.hpp"
#include "common/protocol/content_hash.hpp"
#include "tools/bench/measure.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <thread>
#include <utility>
#include <vector>

using namespace fraja;
using namespace fraja::broker;

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
}

template <class T>
T must(Result<T> result) {
    if (!result)
        fail(result.error().message);
    return std::move(*result);
}

struct Arguments {
    std::filesystem::path directory = std::filesystem::temp_directory_path();
    std::uint32_t tiles = 20'000;
    std::uint32_t tile_bytes = 24 << 10;
};

/// Many tiles share these pixels: what is measured is the store.
std::vector<Blob> some_pixels(std::uint32_t size) {
    Rng rng(1);
    std::vector<Blob> blobs;
    for (int i = 0; i < 64; ++i) {
        Bytes bytes(size);
        for (auto& byte : bytes)
            byte = static_cast<std::byte>(rng.next());
        blobs.push_back(Blob(std::move(bytes)));
    }
    return blobs;
}

/// The queue is kept short, as a broker would keep it.
void write_tiles(const Arguments& arguments, const std::filesystem::path& directory,
                 const JobId& job) {
    constexpr std::uint64_t queue_bytes_max = std::uint64_t{64} << 20;
    const net::Waker waker;
    StoreWriter writer(must(Store::open(directory)), waker);
    protocol::SubmitJob submission;
    submission.job = job;
    const auto pixels = some_pixels(arguments.tile_bytes);
    const auto begin = Clock::now();
    writer.enqueue(PutJob{submission, 1, 1}, 1);
    for (std::uint32_t i = 0; i < arguments.tiles; ++i) {
        protocol::TileDone tile;
        tile.job = job;
        tile.tile = TileIndex{i};
        tile.worker_name = "worker-1";
        tile.blobs = {pixels[i % pixels.size()]};
        while (writer.queued_bytes() > queue_bytes_max)
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        writer.enqueue(PutTile{std::make_shared<const protocol::TileDone>(std::move(tile))}, 2 + i);
    }
    writer.enqueue(PutPhase{job, protocol::JobPhase::done, "", {}}, 2 + arguments.tiles);
    if (!writer.stop())
        fail("the store could not be written");
    const double s = seconds_since(begin);
    std::printf("write    %8.0f tiles/s  %6.0f MiB/s\n", arguments.tiles / s,
                arguments.tiles / s * arguments.tile_bytes / (1 << 20));
}

void time_syncs(Store& store) {
    std::vector<double> times;
    for (std::uint32_t i = 0; i < 50; ++i) {
        protocol::SubmitJob submission;
        submission.job = random_id<JobId>();
        const std::vector<Write> writes{PutJob{submission, 2 + i, 1}};
        const auto begin = Clock::now();
        if (const auto done = store.commit(writes, Durability::synced); !done)
            fail(done.error().message);
        times.push_back(seconds_since(begin));
    }
    std::sort(times.begin(), times.end());
    std::printf("submit   %8.2f ms median, %.2f ms at most, to be synced\n", 1e3 * times[25],
                1e3 * times.back());
}

void read_all(const Arguments& arguments, Store& store, const JobId& job) {
    auto reader = must(StoreReader::open(store));
    auto begin = Clock::now();
    const Contents contents = must(reader.read());
    std::printf("contents %8.2f s\n", seconds_since(begin));
    std::size_t tiles = 0;
    for (const StoredJob& stored : contents.jobs)
        tiles += stored.tiles.size();
    begin = Clock::now();
    Bytes hashes;
    for (std::uint32_t i = 0; i < arguments.tiles; ++i) {
        const std::vector<TileIndex> which{TileIndex{i}};
        for (const auto& tile : must(reader.tiles(job, which))) {
            const ContentHash hash = protocol::content_hash(tile.blobs.front());
            const auto bytes = std::as_bytes(std::span(hash.bytes));
            hashes.insert(hashes.end(), bytes.begin(), bytes.end());
        }
    }
    std::printf("read     %8.0f tiles/s\n", arguments.tiles / seconds_since(begin));
    std::printf("result   %zu tiles, %s\n", tiles,
                to_string(protocol::content_hash(hashes)).substr(0, 16).c_str());
}

void forget(Store& store, const JobId& job) {
    const auto begin = Clock::now();
    const std::vector<Write> writes{ForgetJob{job}};
    if (const auto done = store.commit(writes, Durability::synced); !done)
        fail(done.error().message);
    std::printf("forget   %8.2f s\n", seconds_since(begin));
}

} // namespace

int main(int argc, char** argv) {
    Arguments arguments;
    for (int i = 1; i + 1 < argc; i += 2) {
        if (std::strcmp(argv[i], "--tiles") == 0)
            arguments.tiles = count_of(argv[i + 1]);
        else if (std::strcmp(argv[i], "--bytes") == 0)
            arguments.tile_bytes = count_of(argv[i + 1]);
        else if (std::strcmp(argv[i], "--in") == 0)
            arguments.directory = argv[i + 1];
        else
            fail("usage: store [--tiles N] [--bytes N] [--in DIRECTORY]");
    }
    std::printf("%u tiles of %u bytes\n", arguments.tiles, arguments.tile_bytes);
    const auto directory = arguments.directory / ("fraja-store-" + to_string(random_id<JobId>()));
    const auto job = random_id<JobId>();
    write_tiles(arguments, directory, job);
    {
        const auto begin = Clock::now();
        Store store = must(Store::open(directory));
        std::printf("open     %8.2f s, to find damage\n", seconds_since(begin));
        time_syncs(store);
        read_all(arguments, store, job);
        forget(store, job);
    }
    std::filesystem::remove_all(directory);
    return 0;
}
