// How many tiles a second the broker deals out and takes in, beside a bare ROUTER that does nothing
// else: paired runs with the same workers, which answer at once.
#include "broker/shell.hpp"
#include "broker/status_pages.hpp"
#include "common/base/freed_memory.hpp"
#include "common/net/clock.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/content_hash.hpp"
#include "tools/bench/broker_load.hpp"
#include "tools/bench/measure.hpp"

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <httplib.h>
#include <mutex>
#include <optional>

using namespace fraja;
using namespace fraja::protocol;

namespace {

using namespace std::chrono_literals;

constexpr const char* usage =
    "usage: broker [--tiles N] [--workers N] [--credit N] [--runs N] [--in DIRECTORY] "
    "[--way broker,keys,scraped,watcher,watchers,store] [--csv FILE]";

struct Arguments {
    LoadOptions load;
    std::uint32_t runs = 5;
    std::filesystem::path directory = std::filesystem::temp_directory_path();
    const char* csv = nullptr;
    std::string ways; ///< these alone, with commas between; empty: all
};

// Tiles are squares: these have 24 KiB as nearly as can be.
constexpr std::uint32_t tile_side = 45, tile_bytes = tile_side * tile_side * 12;

/// A broker's pages, and somebody who asks for its metrics every second.
class Scraped {
public:
    explicit Scraped(broker::Options& options) : server_(listen(options)) {
        options.on_report = [this](const broker::Report& report) { board_.post(report); };
        server_.serve();
        scraper_ = std::jthread([this](const std::stop_token& stop) { scrape(stop); });
    }

private:
    [[nodiscard]] http::Server listen(const broker::Options& options) const {
        auto bound = http::Server::bind({"127.0.0.1", 0}, {status_pages(board_, options.state)});
        if (!bound)
            fail(bound.error().message);
        return std::move(*bound);
    }
    void scrape(const std::stop_token& stop) const {
        std::mutex mutex;
        std::condition_variable_any stopped;
        std::unique_lock lock(mutex);
        do {
            if (const auto page = httplib::Client(to_string(server_.address())).Get("/metrics");
                !page || page->status != 200)
                fail("the metrics did not come");
        } while (!stopped.wait_for(lock, stop, 1s, [&] { return stop.stop_requested(); }));
    }

    broker::Board board_;
    http::Server server_;
    std::jthread scraper_;
};

/// That lists nobody: the farm's own key is let in by itself.
std::filesystem::path allow_file() {
    const auto file = std::filesystem::temp_directory_path() /
                      ("fraja-bench-allow-" + to_string(random_id<JobId>()));
    std::fclose(std::fopen(file.c_str(), "w"));
    return file;
}

/// Runs a broker here, in the main thread as fraja-broker does, while `use(endpoint, stream)` goes
/// on in another one.
template <class Use>
void run_broker_while(const std::filesystem::path& state, const std::optional<net::Keys>& keys,
                      bool is_scraped, Use use) {
    broker::Control control;
    std::jthread user;
    broker::Options options;
    if (keys)
        options.allow = allow_file();
    options.bind = options.publish = "tcp://127.0.0.1:0";
    options.state = state;
    options.limits.heartbeat = 1min; // the workers do not beat
    options.on_listening = [&](const std::string& endpoint, const std::string& stream) {
        user = std::jthread([&control, use, endpoint, stream] {
            use(endpoint, stream);
            control.stop();
        });
    };
    std::optional<Scraped> scraped;
    if (is_scraped)
        scraped.emplace(options);
    const net::Context context(keys);
    const auto ran = broker::run_broker(context, options, control);
    if (keys)
        std::filesystem::remove(options.allow);
    if (!ran)
        fail(ran.error().message);
}

/// Submits a job of at least so many tiles. It does not follow it.
void submit(const net::Context& context, const std::string& endpoint, const JobId& job,
            std::uint32_t tiles) {
    auto opened = net::DealerSocket::connect(context, endpoint);
    if (!opened)
        fail(opened.error().message);
    net::DealerSocket& socket = *opened;
    const auto say = [&](const Message& message) {
        while (socket.send(encode(message)) != net::SendStatus::sent)
            std::this_thread::sleep_for(1ms);
    };
    const Blob scene(to_bytes("a scene that nobody reads"));
    const auto columns =
        static_cast<std::uint32_t>(std::ceil(std::sqrt(static_cast<double>(tiles))));
    const std::uint32_t rows = (tiles + columns - 1) / columns;
    const Extent size{columns * tile_side, rows * tile_side};
    say(ClientHello{"bench", "0"});
    say(SubmitJob{.job = job,
                  .job_name = "bench",
                  .scene = content_hash(scene),
                  .scene_bytes = scene.size(),
                  .settings = {.size = size, .crop = {0, 0, size.width, size.height}},
                  .tile_side = tile_side,
                  .wishes = {}});
    for (;;) {
        net::wait({socket}, 1s);
        while (const auto frames = socket.receive()) {
            const auto message = decode(*frames);
            if (!message)
                fail(message.error().message);
            if (const auto* need = std::get_if<NeedChunk>(&*message))
                say(Chunk{need->blob, 0, scene.size(), {scene}});
            if (const auto* refused = std::get_if<Refused>(&*message))
                fail(refused->reason);
            if (const auto* state = std::get_if<JobState>(&*message);
                state && state->phase != JobPhase::waiting_for_scene)
                return say(Goodbye{});
        }
    }
}

struct Way {
    const char* name;
    std::uint32_t watchers;
    bool keeps, is_scraped, has_keys;
    double mark; ///< of the bare rate, at 64 workers and 20,000 tiles; 0: none
};
constexpr Way ways[] = {
    {"broker", 0, false, false, false, 0.85},   {"keys", 0, false, false, true, 0},
    {"scraped", 0, false, true, false, 0},      {"watcher", 1, false, false, false, 0.65},
    {"watchers", 8, false, false, false, 0.55}, {"store", 0, true, false, false, 0}};

bool is_wanted(const std::string& names, const Way& way) {
    return names.empty() ||
           ("," + names + ",").find("," + std::string(way.name) + ",") != std::string::npos;
}

struct Outcome {
    double tiles_per_s = 0;
    double cpu_us = 0;  ///< of all threads, for a tile
    double watched = 1; ///< of what the watchers should have seen so far
};

/// Of this process, from the construction on.
class CpuTime {
public:
    [[nodiscard]] double us() const { return now_us() - begin_; }

private:
    static double now_us() {
        timespec t{};
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
        return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
    }
    double begin_ = now_us();
};

Outcome run(const Arguments& arguments, const Way& way) {
    std::filesystem::path state;
    if (way.keeps)
        state = arguments.directory / ("fraja-bench-" + to_string(random_id<JobId>()));
    Outcome outcome;
    LoadOptions load_options = arguments.load;
    if (way.has_keys) {
        net::KeyPair pair = net::make_key_pair();
        net::PublicKey farm = pair.public_key;
        load_options.keys = net::Keys{std::move(pair), std::move(farm)};
    }
    const CpuTime cpu;
    run_broker_while(state, load_options.keys, way.is_scraped,
                     [&](const std::string& endpoint, const std::string& stream) {
                         const net::Context context(load_options.keys);
                         const auto job = random_id<JobId>();
                         std::optional<WatcherLoad> watchers;
                         if (way.watchers > 0)
                             watchers.emplace(stream, way.watchers, job);
                         const WorkerLoad load(endpoint, load_options);
                         while (!load.all_welcome())
                             std::this_thread::sleep_for(1ms);
                         submit(context, endpoint, job, arguments.load.tiles);
                         while (load.orders() < arguments.load.tiles)
                             std::this_thread::sleep_for(1ms);
                         outcome.tiles_per_s = load.orders_per_s();
                         outcome.cpu_us = cpu.us() / arguments.load.tiles;
                         if (watchers)
                             outcome.watched =
                                 static_cast<double>(watchers->tiles()) /
                                 (static_cast<double>(arguments.load.tiles) * way.watchers);
                     });
    std::filesystem::remove_all(state);
    return outcome;
}

Outcome run_bare(const Arguments& arguments) {
    const CpuTime cpu;
    Outcome outcome;
    outcome.tiles_per_s = bare_orders_per_s(arguments.load);
    outcome.cpu_us = cpu.us() / arguments.load.tiles;
    return outcome;
}

/// Of a figure of each run.
template <class Figure>
double median_of(const std::vector<Outcome>& outcomes, Figure figure) {
    std::vector<double> values;
    for (std::size_t i = 0; i < outcomes.size(); ++i)
        values.push_back(figure(i));
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

/// What the workers say must be what the broker takes: a cheap answer that were refused would make
/// it look fast.
void check_answer() {
    RenderTile tile;
    tile.job = random_id<JobId>();
    tile.tile = TileIndex{70'000};
    tile.attempt = AttemptNumber{300};
    const Packet order = encode(tile);
    const auto bytes = to_bytes(answer_to(as_text(order.body)));
    Packet packet = encode(TileRendered{.job = {}, .rays = {}, .blobs = {Blob()}});
    const std::vector<Blob> frames{Blob(packet.header), Blob(bytes), Blob()};
    const auto message = decode(frames);
    const auto* answer = message ? std::get_if<TileRendered>(&*message) : nullptr;
    if (!answer || answer->job != tile.job || answer->tile != tile.tile ||
        answer->attempt != tile.attempt)
        fail("the workers' answers are none");
}

Arguments read(int argc, char** argv) {
    Arguments arguments;
    arguments.load.tile_bytes = tile_bytes;
    for (int i = 1; i < argc; i += 2) {
        const auto is = [&](const char* name) { return std::strcmp(argv[i], name) == 0; };
        if (i + 1 == argc)
            fail(usage);
        if (is("--tiles"))
            arguments.load.tiles = count_of(argv[i + 1]);
        else if (is("--workers"))
            arguments.load.workers = count_of(argv[i + 1]);
        else if (is("--credit"))
            arguments.load.credit = count_of(argv[i + 1]);
        else if (is("--runs"))
            arguments.runs = count_of(argv[i + 1]);
        else if (is("--in"))
            arguments.directory = argv[i + 1];
        else if (is("--way"))
            arguments.ways = argv[i + 1];
        else if (is("--csv"))
            arguments.csv = argv[i + 1];
        else
            fail(usage);
    }
    if (arguments.load.tiles < 10 || arguments.runs == 0 || arguments.load.workers == 0 ||
        arguments.load.credit == 0)
        fail(usage);
    return arguments;
}

void write_csv(const char* path, const std::vector<Outcome>& bare,
               const std::vector<std::vector<Outcome>>& outcomes) {
    std::FILE* file = std::fopen(path, "w");
    if (!file)
        fail(std::string("cannot write ") + path);
    std::fprintf(file, "run,way,tiles_per_s,of_bare,cpu_us,watched\n");
    for (std::size_t i = 0; i < bare.size(); ++i) {
        std::fprintf(file, "%zu,bare,%.0f,1,%.2f,1\n", i, bare[i].tiles_per_s, bare[i].cpu_us);
        for (std::size_t w = 0; w < std::size(ways); ++w) {
            if (outcomes[w].empty())
                continue;
            std::fprintf(file, "%zu,%s,%.0f,%.3f,%.2f,%.3f\n", i, ways[w].name,
                         outcomes[w][i].tiles_per_s,
                         outcomes[w][i].tiles_per_s / bare[i].tiles_per_s, outcomes[w][i].cpu_us,
                         outcomes[w][i].watched);
        }
    }
    std::fclose(file);
}

} // namespace

int main(int argc, char** argv) {
    const Arguments arguments = read(argc, argv);
    check_answer();
    keep_all_freed_memory(); // as fraja-broker does
    std::vector<Outcome> bare;
    std::vector<std::vector<Outcome>> outcomes(std::size(ways));
    for (std::uint32_t i = 0; i < arguments.runs; ++i) {
        bare.push_back(run_bare(arguments));
        for (std::size_t w = 0; w < std::size(ways); ++w)
            if (is_wanted(arguments.ways, ways[w]))
                outcomes[w].push_back(run(arguments, ways[w]));
    }
    std::printf("%u workers, credit %u, %u tiles of %u bytes; medians of %u paired runs\n",
                arguments.load.workers, arguments.load.credit, arguments.load.tiles, tile_bytes,
                arguments.runs);
    std::printf("%-9s %8s %8s %6s %12s %8s %9s\n", "", "tiles/s", "of bare", "mark", "us CPU/tile",
                "of bare", "watched");
    std::printf("%-9s %8.0f %8s %6s %12.1f\n", "bare",
                median_of(bare, [&](std::size_t i) { return bare[i].tiles_per_s; }), "", "",
                median_of(bare, [&](std::size_t i) { return bare[i].cpu_us; }));
    const bool has_marks = arguments.load.workers == 64 && arguments.load.tiles >= 20'000;
    bool missed = false;
    for (std::size_t w = 0; w < std::size(ways); ++w) {
        const std::vector<Outcome>& these = outcomes[w];
        if (these.empty())
            continue;
        const double ratio = median_of(
            these, [&](std::size_t i) { return these[i].tiles_per_s / bare[i].tiles_per_s; });
        missed = missed || (has_marks && ratio < ways[w].mark);
        std::printf("%-9s %8.0f %8.2f", ways[w].name,
                    median_of(these, [&](std::size_t i) { return these[i].tiles_per_s; }), ratio);
        if (has_marks && ways[w].mark > 0)
            std::printf(" %6.2f", ways[w].mark);
        else
            std::printf(" %6s", "");
        std::printf(
            " %12.1f %8.2f", median_of(these, [&](std::size_t i) { return these[i].cpu_us; }),
            median_of(these, [&](std::size_t i) { return these[i].cpu_us / bare[i].cpu_us; }));
        if (ways[w].watchers > 0)
            std::printf(" %7.0f %%",
                        100 * median_of(these, [&](std::size_t i) { return these[i].watched; }));
        std::printf("\n");
    }
    if (arguments.csv)
        write_csv(arguments.csv, bare, outcomes);
    return missed ? 1 : 0;
}
