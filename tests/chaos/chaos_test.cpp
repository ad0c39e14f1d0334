// Everything at once: workers that are killed and stopped, a broker that is killed, watchers that
// come and go, a worker that answers rubbish and one that is very slow. Every picture must come out
// as if nothing had happened. Short as a test, long by tools/chaos.
#include "common/base/rng.hpp"
#include "tests/chaos/rubbish_worker.hpp"
#include "tests/e2e/farm.hpp"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <list>
#include <string_view>
#include <sys/wait.h>
#include <thread>

using namespace fraja;
using namespace fraja::e2e;
using chaos::Misdeed;

namespace {

using Clock = std::chrono::steady_clock;

/// A number from the environment, set by tools/chaos.
std::uint64_t setting(const char* name, std::uint64_t otherwise) {
    const char* text = std::getenv(name);
    return text ? std::strtoull(text, nullptr, 10) : otherwise;
}

struct Picture {
    std::string scene;
    std::uint32_t width, height;
    Words options;
    std::string extension;
    std::string bytes = {}; ///< as --local draws it

    [[nodiscard]] Words words() const {
        return with({e2e::scene(scene), "-r", std::to_string(width) + "x" + std::to_string(height)},
                    options);
    }
};

std::vector<Picture> some_pictures() {
    constexpr std::uint32_t part = instrumented ? 4 : 1;
    return {{"overlapping_spheres",
             160 / part,
             120 / part,
             {"--kernel", "reference", "-a", "2", "--tile", "8"},
             "png"},
            {"overlapping_spheres", 320 / part, 240 / part, {"-a", "4"}, "exr"},
            {"cone", 320 / part, 240 / part, {"-a", "4", "--tile", "20"}, "png"},
            {"csg_basic", 240 / part, 180 / part, {"--error", "2"}, "exr"},
            {"nested_aggregate", 200 / part, 150 / part, {"-d", "9", "-a", "3"}, "png"},
            {"mirrors", 320 / part, 240 / part, {"--spp", "16", "--schedule", "stealing"}, "exr"},
            {"lights_many", 160 / part, 120 / part, {"--kernel", "reference"}, "png"}};
}

/// A picture that somebody wants, and how far that is.
struct Errand {
    enum class Stage { attached, submitting, waiting, getting };
    const Picture* picture;
    std::string name, file;
    Stage stage;
    Process client;
    std::string job = {};
};

/// Every pixel was told of, and no tile twice. (A tile that took long and was given out again in
/// parts may be told of beside some of these.)
void check_all_told(const std::vector<TileLine>& tiles, const Picture& picture) {
    std::vector<bool> told(std::size_t{picture.width} * picture.height);
    std::set<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t, std::uint32_t>> rects;
    for (const TileLine& t : tiles) {
        const bool is_new = rects.emplace(t.x, t.y, t.w, t.h).second;
        CHECK(is_new);
        REQUIRE(t.x + t.w <= picture.width);
        REQUIRE(t.y + t.h <= picture.height);
        for (std::uint32_t y = t.y; y < t.y + t.h; ++y)
            for (std::uint32_t x = t.x; x < t.x + t.w; ++x)
                told[std::size_t{y} * picture.width + x] = true;
    }
    CHECK(std::ranges::count(told, false) == 0);
}

struct Watcher {
    const Picture* picture;
    std::string file; ///< empty: it prints JSON
    Process process;
    bool told_to_go = false;
};

struct Worker {
    Process process;
    std::optional<Clock::time_point> stopped_until = {};
};

class Chaos {
public:
    Chaos(std::uint64_t seed, Duration time, std::uint64_t broker_deaths);
    void rage();
    void heal();
    void check_that_it_raged() const;
    void check_that_nothing_is_left();
    void tell() const;

private:
    void do_something();
    void look_around();
    void check_that_broker_runs(const std::optional<int>& ended);
    void kill_broker();
    void submit();
    void start_worker();
    void kill_workers();
    void stop_worker();
    void start_watcher();
    void send_watcher_away();
    /// True: the errand is done.
    bool go_on(Errand& errand);
    bool is_gone(Watcher& watcher);
    void check_log(const Process& process) const;
    [[nodiscard]] std::uint64_t rubbish_count() const;
    Process start(const std::string& name, const Words& words) const;
    std::string file_name(const std::string& extension) {
        return scratch_.file(std::to_string(++files_) + "." + extension);
    }
    template <class T>
    T& any_of(std::list<T>& list) {
        return *std::next(list.begin(), static_cast<std::ptrdiff_t>(rng_.below(list.size())));
    }

    Duration healing_{};
    static constexpr std::size_t workers_max = 6, errands_max = 5, watchers_max = 4;

    Scratch scratch_;
    Rng rng_;
    Duration time_;
    std::uint64_t broker_deaths_;
    std::vector<Picture> pictures_;
    Farm farm_;
    std::optional<chaos::RubbishWorker> rubbish_;
    std::list<Worker> workers_;
    std::list<Errand> errands_;
    std::list<Watcher> watchers_;
    std::uint64_t files_ = 0, worker_names_ = 0;
    struct {
        std::uint64_t attached = 0, detached = 0, watchers = 0, workers_killed = 0,
                      workers_stopped = 0, broker_killed = 0;
    } counts_;
};

// A tile that dies with its worker counts as a failure: here that is never its fault.
Chaos::Chaos(std::uint64_t seed, Duration time, std::uint64_t broker_deaths)
    : rng_(seed), time_(time), broker_deaths_(broker_deaths), pictures_(some_pictures()),
      farm_({"--heartbeat", heartbeat_option, "--lease", "3s", "--max-attempts", "1000",
             "--quarantine", "5/2s", "--state", scratch_.file("state")}) {
    for (Picture& picture : pictures_)
        picture.bytes = local_picture(scratch_, picture.words(), "local." + picture.extension);
    for (int i = 0; i < 3; ++i)
        start_worker();
    farm_.add_emulated("slow", 1, {"--emulate", "1@20k", "-j", "1"});
    rubbish_.emplace(farm_.endpoint(), seed);
}

Process Chaos::start(const std::string& name, const Words& words) const {
    auto process = Process::start({with({program(name), "-b", farm_.endpoint()}, words)});
    REQUIRE(process.has_value());
    return std::move(*process);
}

// ------------------------------------------------------------------------------------------- deeds

void Chaos::start_worker() {
    if (workers_.size() < workers_max)
        workers_.push_back(
            {start("fraja-worker", {"-j", "1", "--name", "w" + std::to_string(++worker_names_)})});
}

/// One of them, and sometimes half of them at once.
void Chaos::kill_workers() {
    if (workers_.size() < 2)
        return;
    std::list<Worker> doomed;
    for (std::size_t left = rng_.below(4) == 0 ? workers_.size() / 2 : 1; left > 0; --left)
        doomed.splice(
            doomed.end(), workers_,
            std::next(workers_.begin(), static_cast<std::ptrdiff_t>(rng_.below(workers_.size()))));
    for (Worker& worker : doomed)
        worker.process.send(SIGKILL);
    for (Worker& worker : doomed) {
        CHECK(worker.process.wait_for_exit(patience) == -SIGKILL);
        check_log(worker.process);
    }
    counts_.workers_killed += doomed.size();
}

void Chaos::stop_worker() {
    const auto stopped = std::ranges::count_if(
        workers_, [](const Worker& w) { return w.stopped_until.has_value(); });
    Worker& worker = any_of(workers_);
    if (worker.stopped_until || 2 * static_cast<std::size_t>(stopped + 1) > workers_.size())
        return;
    worker.process.send(SIGSTOP);
    worker.stopped_until = Clock::now() + std::chrono::milliseconds(100 + rng_.below(2'000));
    ++counts_.workers_stopped;
}

void Chaos::submit() {
    if (errands_.size() >= errands_max)
        return;
    const Picture& picture = pictures_[rng_.below(pictures_.size())];
    const bool detached = rng_.below(2) == 0;
    const std::string file = file_name(picture.extension), name = "job" + std::to_string(files_);
    const Words words =
        with(with(picture.words(), {"--connect-timeout", "2m", "--name", name}),
             detached ? Words{"--detach"} : Words{"-o", file, "--progress", "none"});
    errands_.push_back({&picture, name, file,
                        detached ? Errand::Stage::submitting : Errand::Stage::attached,
                        start("fraja-submit", words)});
    ++(detached ? counts_.detached : counts_.attached);
}

void Chaos::start_watcher() {
    if (errands_.empty() || watchers_.size() >= watchers_max)
        return;
    const Errand& errand = any_of(errands_);
    const bool prints = rng_.below(2) == 0;
    const std::string file = prints ? "" : file_name(errand.picture->extension);
    watchers_.push_back({errand.picture, file,
                         start("fraja-watch", with({errand.name, "--connect-timeout", "2m"},
                                                   prints ? Words{"--json"} : Words{"-o", file}))});
    ++counts_.watchers;
}

void Chaos::send_watcher_away() {
    if (watchers_.empty())
        return;
    Watcher& watcher = any_of(watchers_);
    watcher.process.send(rng_.below(2) == 0 ? SIGKILL : SIGTERM);
    watcher.told_to_go = true;
}

void Chaos::kill_broker() {
    farm_.broker().send(SIGKILL);
    CHECK(farm_.broker().wait_for_exit(patience) == -SIGKILL);
    check_log(farm_.broker());
    std::this_thread::sleep_for(std::chrono::milliseconds(rng_.below(1'500)));
    farm_.start_broker_again();
    ++counts_.broker_killed;
}

void Chaos::do_something() {
    const std::uint64_t die = rng_.below(100);
    if (die < 35)
        submit();
    else if (die < 55)
        start_worker();
    else if (die < 65)
        kill_workers();
    else if (die < 80)
        stop_worker();
    else if (die < 92)
        start_watcher();
    else
        send_watcher_away();
}

void Chaos::rage() {
    const auto begin = Clock::now(), end = begin + time_;
    const auto life = time_ / (broker_deaths_ + 1);
    while (Clock::now() < end) {
        if (Clock::now() - begin > life * (counts_.broker_killed + 1))
            kill_broker();
        do_something();
        // Meanwhile everybody is listened to.
        const auto ended =
            farm_.broker().wait_for_exit(std::chrono::milliseconds(10 + rng_.below(150)));
        check_that_broker_runs(ended);
        look_around();
    }
}

void Chaos::check_that_broker_runs(const std::optional<int>& ended) {
    INFO(farm_.broker().story());
    REQUIRE(!ended.has_value());
}

// ---------------------------------------------------------------------------------- what must hold

void Chaos::check_log(const Process& process) const {
    INFO(process.story());
    CHECK(process.err().find("ssertion") == std::string::npos); // ours or libzmq's
}

bool Chaos::go_on(Errand& errand) {
    const auto exit = errand.client.wait_for_exit(0s);
    if (!exit)
        return false;
    INFO(farm_.broker().story());
    INFO(errand.client.story()); // last, where even a log that is cut short has it
    REQUIRE(exit == 0);
    const Words patient = {"--connect-timeout", "2m"};
    switch (errand.stage) {
    case Errand::Stage::submitting:
        REQUIRE(errand.client.out().size() == 37);
        errand.job = errand.client.out().substr(0, 36);
        errand.stage = Errand::Stage::waiting;
        errand.client = start("fraja-watch", with({errand.job}, patient));
        return false;
    case Errand::Stage::waiting:
        errand.stage = Errand::Stage::getting;
        errand.client = start("fraja-ctl", with({"get", errand.job, "-o", errand.file}, patient));
        return false;
    case Errand::Stage::attached:
    case Errand::Stage::getting:
        REQUIRE((bytes_of(errand.file) == errand.picture->bytes));
        fs::remove(errand.file);
        return true;
    }
    return false;
}

/// It may have asked for a job that is not there yet.
bool Chaos::is_gone(Watcher& watcher) {
    constexpr int no_such_job = 6;
    const auto exit = watcher.process.wait_for_exit(0s);
    if (!exit)
        return false;
    INFO(farm_.broker().story());
    INFO(watcher.process.story());
    const bool expected = exit == 0 || exit == no_such_job || watcher.told_to_go;
    REQUIRE(expected);
    if (exit == 0 && watcher.file.empty())
        check_all_told(tile_lines(watcher.process.out()), *watcher.picture);
    else if (exit == 0)
        REQUIRE((bytes_of(watcher.file) == watcher.picture->bytes));
    return true;
}

void Chaos::look_around() {
    for (Worker& worker : workers_) {
        const auto ended = worker.process.wait_for_exit(0s);
        INFO(worker.process.story());
        REQUIRE(!ended.has_value());
        if (worker.stopped_until && Clock::now() >= *worker.stopped_until) {
            worker.process.send(SIGCONT);
            worker.stopped_until.reset();
        }
    }
    std::erase_if(errands_, [&](Errand& errand) { return go_on(errand); });
    std::erase_if(watchers_, [&](Watcher& watcher) { return is_gone(watcher); });
}

/// Nothing more goes wrong, but for the rubbish that goes on: everybody gets what they wanted.
void Chaos::heal() {
    for (Worker& worker : workers_)
        worker.stopped_until = worker.stopped_until ? Clock::now() : worker.stopped_until;
    start_worker();
    const auto begin = Clock::now(), end = begin + patience;
    while ((!errands_.empty() || !watchers_.empty()) && Clock::now() < end) {
        static_cast<void>(farm_.broker().wait_for_exit(50ms));
        look_around();
    }
    healing_ = Clock::now() - begin;
    for (const Errand& errand : errands_) {
        INFO(farm_.broker().story());
        INFO(errand.client.story());
        CHECK_MESSAGE(false, errand.name << " is not done");
    }
    for (const Watcher& watcher : watchers_) {
        INFO(watcher.process.story());
        CHECK_MESSAGE(false, "a watcher does not end");
    }
}

void Chaos::check_that_nothing_is_left() {
    rubbish_.reset();
    for (Worker& worker : workers_)
        worker.process.send(SIGTERM);
    farm_.worker(0).send(SIGTERM);
    for (Worker& worker : workers_) {
        CHECK(worker.process.wait_for_exit(patience) == 0);
        check_log(worker.process);
    }
    CHECK(farm_.worker(0).wait_for_exit(patience) == 0);
    check_log(farm_.worker(0));
    farm_.broker().send(SIGTERM);
    CHECK(farm_.broker().wait_for_exit(patience) == 0);
    check_log(farm_.broker());
    const bool no_child = ::waitpid(-1, nullptr, WNOHANG) == -1 && errno == ECHILD;
    CHECK(no_child);
    const auto checked =
        run({{program("fraja-broker"), "--state", scratch_.file("state"), "--check"}}, patience);
    REQUIRE(checked.has_value());
    INFO(checked->out << checked->err);
    CHECK(checked->exit == 0);
}

std::uint64_t Chaos::rubbish_count() const {
    std::uint64_t rubbish = 0;
    for (std::size_t i = 0; rubbish_ && i < chaos::misdeed_count; ++i)
        rubbish += rubbish_->count(static_cast<Misdeed>(i));
    return rubbish;
}

/// Or nothing is proven.
void Chaos::check_that_it_raged() const {
    CHECK(counts_.attached + counts_.detached > 0);
    CHECK(counts_.watchers > 0);
    CHECK(counts_.workers_killed > 0);
    CHECK(counts_.workers_stopped > 0);
    CHECK(counts_.broker_killed >=
          std::max<std::uint64_t>(1, broker_deaths_ - 1)); // a deed may take long
    CHECK(rubbish_count() > 0);
}

void Chaos::tell() const {
    const auto n = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
    std::printf("%llu jobs waited for and %llu fetched, all right; %llu watchers; workers: %llu "
                "killed, %llu stopped; broker: killed %llu times; rubbish: %llu answers in %llu "
                "sessions; healed in %.1f s\n",
                n(counts_.attached), n(counts_.detached), n(counts_.watchers),
                n(counts_.workers_killed), n(counts_.workers_stopped), n(counts_.broker_killed),
                n(rubbish_count()), n(rubbish_ ? rubbish_->sessions() : 0), seconds(healing_));
    std::fflush(stdout);
}

} // namespace

TEST_CASE("every picture comes out as if nothing had happened") {
    const std::uint64_t seed =
        setting("FRAJA_SEED",
                static_cast<std::uint64_t>(Clock::now().time_since_epoch().count()) % 1'000'000);
    const std::uint64_t time_s = setting("FRAJA_CHAOS_SECONDS", 15);
    const std::uint64_t broker_deaths = std::max<std::uint64_t>(2, time_s / 60);
    std::printf("seed %llu, %llu s\n", static_cast<unsigned long long>(seed),
                static_cast<unsigned long long>(time_s));
    std::fflush(stdout);
    CAPTURE(seed);
    Chaos chaos(seed, std::chrono::seconds(time_s), broker_deaths);
    chaos.rage();
    chaos.heal();
    chaos.tell();
    chaos.check_that_it_raged();
    chaos.check_that_nothing_is_left();
}
