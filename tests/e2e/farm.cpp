#include "tests/e2e/farm.hpp"

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <sstream>
#include <thread>
#include <unistd.h>

namespace fraja::e2e {
namespace {

Process start(Words argv, Words env = {}) {
    auto process = Process::start({std::move(argv), std::move(env)});
    REQUIRE_MESSAGE(process.has_value(), (process ? "" : process.error().message));
    return std::move(*process);
}

} // namespace

Words with(Words first, const Words& rest) {
    first.insert(first.end(), rest.begin(), rest.end());
    return first;
}

Words long_picture() {
    return {scene("overlapping_spheres"),
            "--kernel",
            "reference",
            "-r",
            instrumented ? "100x75" : "320x240",
            "-a",
            "2",
            "--tile",
            instrumented ? "5" : "16"};
}

Scratch::Scratch() {
    std::string name = (fs::temp_directory_path() / "fraja-e2e-XXXXXX").string();
    REQUIRE(mkdtemp(name.data()) != nullptr);
    path_ = name;
}
Scratch::~Scratch() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
}

RunResult submit(Words arguments, const Words& env) {
    auto result = run({with({program("fraja-submit")}, arguments), env}, patience);
    REQUIRE_MESSAGE(result.has_value(), (result ? "" : result.error().message));
    return std::move(*result);
}

std::string local_picture(const Scratch& scratch, Words arguments, const std::string& name,
                          const Words& env) {
    const std::string path = scratch.file(name);
    const auto result = submit(with(std::move(arguments), {"--local", "-o", path}), env);
    INFO(result.err);
    REQUIRE(result.exit == 0);
    return bytes_of(path);
}

Farm::Farm(Words broker_options, Words launcher)
    : launcher_(std::move(launcher)), options_(std::move(broker_options)) {
    if (std::ranges::find(options_, "--state") == options_.end())
        options_.insert(options_.end(), {"--state", "none"});
    const bool listens = start_broker();
    INFO(broker_->story());
    REQUIRE(listens);
}

bool Farm::start_broker() {
    broker_ = start(
        with(with(launcher_, {program("fraja-broker"), "--bind", endpoint_, "--publish", stream_}),
             options_));
    const auto line = broker_->wait_for_line(
        Process::Stream::out, [](std::string_view l) { return l.starts_with("listening "); },
        patience);
    if (!line)
        return false;
    std::istringstream words(*line);
    std::string listening, stream;
    words >> listening >> endpoint_ >> stream >> stream_;
    REQUIRE(endpoint_.starts_with("tcp://127.0.0.1:"));
    REQUIRE(stream_.starts_with("tcp://127.0.0.1:"));
    return true;
}

void Farm::start_broker_again() {
    // Meanwhile somebody else may have had the port for a moment: the system hands out such ports
    // to whoever connects, too.
    for (int i = 0; i < 20 && !start_broker(); ++i)
        std::this_thread::sleep_for(100ms);
    const auto ended = broker_->wait_for_exit(0s);
    INFO(broker_->story());
    REQUIRE(!ended.has_value());
}

Process& Farm::add_worker(const std::string& name, Words options, Words env) {
    workers_.push_back(start(
        with({program("fraja-worker"), "-b", endpoint_, "--name", name}, options), std::move(env)));
    const auto here =
        broker_->wait_for_words(Process::Stream::err, "worker " + name + " is here", patience);
    INFO(workers_.back().story());
    REQUIRE(here.has_value());
    return workers_.back();
}

Process& Farm::add_emulated(const std::string& name, std::size_t count, const Words& options) {
    workers_.push_back(
        start(with({program("fraja-worker"), "-b", endpoint_, "--name", name}, options)));
    std::size_t missing = count;
    const auto all_here = broker_->wait_for_line(
        Process::Stream::err,
        [&](std::string_view l) {
            return l.find("worker " + name + "/") != std::string_view::npos &&
                   l.find(" is here: ") != std::string_view::npos && --missing == 0;
        },
        patience);
    INFO(workers_.back().story());
    REQUIRE(all_here.has_value());
    return workers_.back();
}

RunResult Farm::submit(Words arguments) {
    return e2e::submit(with({"-b", endpoint_}, arguments));
}

Process Farm::start_submit(Words arguments) {
    return start(with({program("fraja-submit"), "-b", endpoint_}, arguments));
}

std::string Farm::detach(Words arguments) {
    const auto result = submit(with(std::move(arguments), {"--detach"}));
    INFO(result.err);
    REQUIRE(result.exit == 0);
    REQUIRE(result.out.size() == 37); // an id and a newline, alone
    return result.out.substr(0, 36);
}

Process Farm::watch(const std::string& job, Words options) {
    return start(with({program("fraja-watch"), "-b", endpoint_, job}, options));
}

Process Farm::watch_from_the_start(const std::string& job, const Words& json_options) {
    Process watcher = watch(job, json_options);
    const auto line = watcher.wait_for_words(Process::Stream::out, "fraja.job/1", patience);
    INFO(watcher.story());
    REQUIRE(line.has_value());
    return watcher;
}

void wait_for_tiles(Process& watcher, std::size_t count) {
    const auto line = watcher.wait_for_line(
        Process::Stream::out,
        [&](std::string_view l) {
            return l.find("fraja.tile/1") != std::string_view::npos && --count == 0;
        },
        patience);
    INFO(watcher.story());
    REQUIRE(line.has_value());
}

std::vector<TileLine> tile_lines(const std::string& output) {
    std::vector<TileLine> tiles;
    std::istringstream in(output);
    for (std::string line; std::getline(in, line);) {
        const auto object = nlohmann::json::parse(line);
        if (object.at("schema") != "fraja.tile/1")
            continue;
        for (const char* field :
             {"job", "frame", "x", "y", "w", "h", "worker", "elapsed_s", "rays"})
            CHECK(object.contains(field));
        tiles.push_back(
            {object.at("x"), object.at("y"), object.at("w"), object.at("h"), object.at("worker")});
    }
    return tiles;
}

void check_each_pixel_once(const std::vector<TileLine>& tiles, std::uint32_t width,
                           std::uint32_t height) {
    std::vector<int> times(std::size_t{width} * height);
    for (const TileLine& t : tiles)
        for (std::uint32_t y = t.y; y < t.y + t.h; ++y)
            for (std::uint32_t x = t.x; x < t.x + t.w; ++x) {
                REQUIRE(x < width);
                REQUIRE(y < height);
                ++times[std::size_t{y} * width + x];
            }
    CHECK(std::ranges::count(times, 1) == static_cast<std::ptrdiff_t>(times.size()));
}

} // namespace fraja::e2e
