// A farm of real processes for tests: a broker on ports that the system chose, workers, clients,
// watchers.
#pragma once

#include "tests/support/file_bytes.hpp"
#include "tests/support/process.hpp"
#include "tests/support/resident.hpp"

#include <chrono>
#include <cstdint>
#include <doctest/doctest.h>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

/// Exit codes in the messages of checks that failed.
template <>
struct doctest::StringMaker<std::optional<int>> {
    static String convert(const std::optional<int>& code) {
        return code ? toString(*code) : "none: it still runs";
    }
};

namespace fraja::e2e {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

/// How long a test waits for something that must happen. Sanitizers are slow and machines busy.
inline constexpr Duration patience = 240s;

#ifdef FRAJA_INSTRUMENTED
inline constexpr bool instrumented =
    true; ///< a sanitizer or debug build: a ray costs ten times as much
#else
inline constexpr bool instrumented = false;
#endif

/// Of the farms of tests: short, so that what is lost is found soon. A process under a sanitizer
/// may have to wait longer for its turn.
inline constexpr Duration heartbeat = instrumented ? Duration(500ms) : Duration(250ms);
inline constexpr const char* heartbeat_option = instrumented ? "500ms" : "250ms";

inline std::string program(const std::string& name) {
    return std::string(FRAJA_BIN_DIR) + "/" + name;
}
inline std::string scene(const std::string& name) {
    return std::string(FRAJA_SOURCE_DIR) + "/scenes/" + name + ".raj";
}

/// A directory of its own, removed at the end.
class Scratch {
public:
    Scratch();
    ~Scratch();
    Scratch(const Scratch&) = delete;
    Scratch& operator=(const Scratch&) = delete;
    [[nodiscard]] std::string file(const std::string& name) const {
        return (path_ / name).string();
    }

private:
    fs::path path_;
};

inline bool contains(std::string_view text, std::string_view part) {
    return text.find(part) != std::string_view::npos;
}

using Words = std::vector<std::string>;
[[nodiscard]] Words with(Words first, const Words& rest);
/// Some seconds of work in many tiles: the fast kernel would be done before anything happens.
[[nodiscard]] Words long_picture();

/// Runs fraja-submit to its end. `env` as in Command.
RunResult submit(Words arguments, const Words& env = {});
/// The picture that `--local` draws with these arguments (scene first), as a file's bytes.
std::string local_picture(const Scratch& scratch, Words arguments,
                          const std::string& name = "local.png", const Words& env = {});

class Farm {
public:
    /// Nothing is kept where the options do not say --state. `launcher`: words before the broker's
    /// own command line.
    explicit Farm(Words broker_options = {"--heartbeat", heartbeat_option}, Words launcher = {});

    /// Starts the broker again with the same options, at the endpoints that the first one had. Its
    /// predecessor must have ended.
    void start_broker_again();

    /// Starts a worker and waits until the broker has welcomed it.
    Process& add_worker(const std::string& name, Words options = {"-j", "1"}, Words env = {});
    /// Starts a process that emulates as many workers as `options` say: NAME/1 to NAME/COUNT. Waits
    /// until the broker has welcomed them all.
    Process& add_emulated(const std::string& name, std::size_t count, const Words& options);
    [[nodiscard]] Process& worker(std::size_t i) { return workers_.at(i); }
    [[nodiscard]] Process& broker() { return *broker_; }
    [[nodiscard]] const std::string& endpoint() const { return endpoint_; }
    [[nodiscard]] const std::string& stream() const { return stream_; }

    /// fraja-submit to this broker, to its end.
    RunResult submit(Words arguments);
    /// The same in the background.
    Process start_submit(Words arguments);
    /// Submits and leaves; returns the job's id.
    std::string detach(Words arguments);
    /// fraja-watch JOB --json in the background.
    Process watch(const std::string& job, Words options = {"--json"});
    /// The same, and it is known to follow the job already: add the workers after it.
    Process watch_from_the_start(const std::string& job, const Words& json_options);

private:
    /// Starts a broker and waits until it listens; false: it has ended.
    bool start_broker();

    Words launcher_, options_;
    std::string endpoint_ = "tcp://127.0.0.1:0", stream_ = "tcp://127.0.0.1:0";
    std::optional<Process> broker_;
    std::vector<Process> workers_;
};

/// Waits until a program that prints JSON lines has printed that many tiles.
void wait_for_tiles(Process& watcher, std::size_t count);

/// One line of `fraja-watch --json` about a tile.
struct TileLine {
    std::uint32_t x, y, w, h;
    std::string worker;
};
std::vector<TileLine> tile_lines(const std::string& output);

/// Whether the tiles cover a picture of that size, each pixel exactly once.
void check_each_pixel_once(const std::vector<TileLine>& tiles, std::uint32_t width,
                           std::uint32_t height);

} // namespace fraja::e2e
