// fraja-ctl and what it makes of jobs and workers, with real processes.
#include "tests/e2e/farm.hpp"

#include <array>
#include <ctime>
#include <doctest/doctest.h>
#include <pty.h>
#include <sstream>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace fraja::e2e {
namespace {

RunResult ctl(Farm& farm, Words words) {
    Words argv{program("fraja-ctl"), "-b", farm.endpoint()};
    argv.insert(argv.end(), words.begin(), words.end());
    auto result = run({argv}, patience);
    REQUIRE_MESSAGE(result.has_value(), (result ? "" : result.error().message));
    return std::move(*result);
}

nlohmann::json job(Farm& farm, const std::string& id) {
    const auto shown = ctl(farm, {"show", id, "--json"});
    REQUIRE(shown.exit == 0);
    return nlohmann::json::parse(shown.out);
}

std::string state(Farm& farm, const std::string& id) {
    return job(farm, id).at("state");
}

/// A job that takes a while on one thread.
const Words long_job{scene("overlapping_spheres"), "-r", "200x150", "-d", "20", "-a",
                     instrumented ? "2" : "8"};

TEST_CASE("a job is paused, resumed, cancelled and tried again from the command line") {
    const Scratch scratch;
    Farm farm;
    const std::string id = farm.detach(long_job);
    CHECK(ctl(farm, {"pause", id}).exit == 0);
    CHECK(state(farm, id) == "paused");
    farm.add_worker("one", {"-j", "2"});
    Process watcher = farm.watch_from_the_start(id, {"--json"});
    CHECK(job(farm, id).at("in_flight_count") == 0);
    const auto resumed = ctl(farm, {"resume", id});
    CHECK(resumed.exit == 0);
    wait_for_tiles(watcher, 1);
    const auto cancelled = ctl(farm, {"cancel", id, "--yes"});
    CHECK(cancelled.exit == 0);
    CHECK(cancelled.err.find("is cancelled") != std::string::npos);
    CHECK(watcher.wait_for_exit(patience) == 5);
    const auto done_before = job(farm, id).at("done_count").get<int>();
    CHECK(done_before > 0);
    CHECK(ctl(farm, {"retry", id}).exit == 0);
    Process again = farm.watch(id);
    CHECK(again.wait_for_exit(patience) == 0);
    CHECK(state(farm, id) == "done");
    CHECK(ctl(farm, {"retry", id}).exit == 2); // there is nothing to try again
    CHECK(ctl(farm, {"pause", id}).exit == 2);
    CHECK(ctl(farm, {"pause", "nothing"}).exit == 6);
    CHECK(ctl(farm, {"cancel", id}).exit == 0); // it is over: nothing is asked
    const std::string picture = scratch.file("got.png");
    CHECK(ctl(farm, {"get", id, "-o", picture}).exit == 0);
    CHECK((bytes_of(picture) == local_picture(scratch, long_job)));
}

/// fraja-ctl on a terminal: what it asks is answered with `keys`. Returns how it ended.
std::optional<int> ctl_answered(Farm& farm, const Words& words, const std::string& keys) {
    int terminal = -1;
    const pid_t child = forkpty(&terminal, nullptr, nullptr, nullptr);
    REQUIRE(child >= 0);
    if (child == 0) {
        const Words line = with({program("fraja-ctl"), "-b", farm.endpoint()}, words);
        std::vector<char*> argv;
        for (const std::string& word : line)
            argv.push_back(const_cast<char*>(word.c_str()));
        argv.push_back(nullptr);
        execv(argv[0], argv.data());
        _exit(127);
    }
    std::string seen;
    bool answered = false;
    std::array<char, 256> some{};
    for (ssize_t n = 0; (n = read(terminal, some.data(), some.size())) > 0;) { // until it has ended
        seen.append(some.data(), static_cast<std::size_t>(n));
        if (!answered && contains(seen, "? [y/N] ")) {
            answered = true;
            REQUIRE(write(terminal, keys.data(), keys.size()) == static_cast<ssize_t>(keys.size()));
        }
    }
    close(terminal);
    CHECK_MESSAGE(answered, seen);
    int status = 0;
    REQUIRE(waitpid(child, &status, 0) == child);
    return WIFEXITED(status) ? std::optional(WEXITSTATUS(status)) : std::nullopt;
}

TEST_CASE("what cannot be undone is asked on a terminal, where Ctrl-C is heard too") {
    Farm farm;
    const std::string id = farm.detach(long_job);
    CHECK(ctl_answered(farm, {"cancel", id}, "\x03") == 130);
    CHECK(ctl_answered(farm, {"cancel", id}, "n\n") == 2);
    CHECK(state(farm, id) == "queued");
    CHECK(ctl_answered(farm, {"cancel", id}, "y\n") == 0);
    CHECK(state(farm, id) == "cancelled");
}

TEST_CASE("priorities are changed, and the job that matters more ends first") {
    Farm farm;
    const std::string first = farm.detach({scene("cone"), "-r", "64x48", "-n", "first"});
    const std::string second = farm.detach({scene("cone"), "-r", "64x48", "-n", "second"});
    const auto changed = ctl(farm, {"prio", "second", "7"});
    CHECK(changed.exit == 0);
    CHECK(changed.err.find("has priority 7") != std::string::npos);
    CHECK(job(farm, second).at("priority") == 7);
    Process watcher = farm.watch_from_the_start(first, {"--json"});
    farm.add_worker("one");
    wait_for_tiles(watcher, 1);
    CHECK(job(farm, second).at("done_count") > 0);
    CHECK(watcher.wait_for_exit(patience) == 0);
}

TEST_CASE("workers are drained, undrained and told to leave from the command line") {
    const Scratch scratch;
    Farm farm;
    Process& worker = farm.add_worker("ada");
    const auto drained = ctl(farm, {"drain", "ada", "--json"});
    CHECK(drained.exit == 0);
    CHECK(nlohmann::json::parse(drained.out).at("draining") == true);
    CHECK(ctl(farm, {"workers"}).out.find("draining") != std::string::npos);
    const std::string id = farm.detach({scene("cone"), "-r", "20x15"});
    CHECK(job(farm, id).at("in_flight_count") == 0);
    CHECK(ctl(farm, {"undrain", "ada"}).exit == 0);
    Process watcher = farm.watch(id);
    CHECK(watcher.wait_for_exit(patience) == 0);
    CHECK(ctl(farm, {"kick", "ada"}).exit == 2); // off a terminal it wants --yes
    CHECK(ctl(farm, {"kick", "eve", "--yes"}).exit == 6);
    CHECK(ctl(farm, {"kick", "ada", "--yes"}).exit == 0);
    CHECK(worker.wait_for_exit(patience) == 0);
    CHECK(worker.err().find("told to leave") != std::string::npos);
}

TEST_CASE("a job goes to workers with its tags, and to no more than it wants") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("plain");
    const std::string id = farm.detach({scene("cone"), "-r", "40x30", "--tag", "fast"});
    Process watcher = farm.watch_from_the_start(id, {"--json"});
    farm.add_worker("slow", {"-j", "1", "--tag", "fast=no"});
    CHECK(watcher.wait_for_exit(patience) == 0);
    for (const TileLine& tile : tile_lines(watcher.out()))
        CHECK(tile.worker == "slow");
    const auto one = farm.submit({scene("cone"), "-r", "60x40", "--max-workers", "1", "--json",
                                  "-o", scratch.file("one.png")});
    CHECK(one.exit == 0);
    CHECK(nlohmann::json::parse(one.out).at("workers") == 1);
}

TEST_CASE("every schedule draws the same bytes") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one");
    farm.add_worker("two");
    const Words picture{scene("overlapping_spheres"), "-r", "80x60"};
    const std::string want = local_picture(scratch, picture);
    for (const char* schedule : {"demand", "static", "weighted", "stealing"}) {
        CAPTURE(schedule);
        Words words = picture;
        const std::string file = scratch.file(std::string(schedule) + ".png");
        words.insert(words.end(), {"--schedule", schedule, "-o", file});
        CHECK(farm.submit(words).exit == 0);
        CHECK((bytes_of(file) == want));
    }
}

TEST_CASE("an interrupted job is taken over with --resume") {
    const Scratch scratch;
    Farm farm;
    const std::string id = farm.detach({scene("cone"), "-r", "64x48"});
    Process client = farm.start_submit(
        {scene("cone"), "-r", "64x48", "--resume", "--json", "-o", scratch.file("c.png")});
    farm.add_worker("one");
    CHECK(client.wait_for_exit(patience) == 0);
    CHECK(nlohmann::json::parse(client.out()).at("job") == id);
    CHECK((bytes_of(scratch.file("c.png")) ==
           local_picture(scratch, {scene("cone"), "-r", "64x48"})));
}

TEST_CASE("brokers are listed each for itself, and one that answers is enough") {
    Farm farm;
    farm.add_worker("one", {"-j", "2"});
    const std::string nobody = "tcp://127.0.0.1:1";
    const auto both = ctl(farm, {"-b", nobody, "--connect-timeout", "300ms", "brokers", "--json"});
    CHECK(both.exit == 0);
    std::istringstream lines(both.out);
    std::string line;
    REQUIRE(std::getline(lines, line));
    const auto first = nlohmann::json::parse(line);
    CHECK(first.at("endpoint") == farm.endpoint());
    CHECK(first.at("workers").at("threads") == 2);
    CHECK(first.at("keeps") == false);
    REQUIRE(std::getline(lines, line));
    const auto second = nlohmann::json::parse(line);
    CHECK(second.at("endpoint") == nobody);
    CHECK(second.at("reason") == "gone: nothing listens there");
    const auto table = ctl(farm, {"brokers"});
    CHECK(table.out.find(farm.endpoint() + "  alone") != std::string::npos);
    const auto none = run(
        {{program("fraja-ctl"), "-b", nobody, "--connect-timeout", "300ms", "brokers"}}, patience);
    REQUIRE(none.has_value());
    CHECK(none->exit == 3);
}

TEST_CASE("stats count what a farm has done") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one", {"-j", "2"});
    REQUIRE(farm.submit({scene("cone"), "-r", "64x48", "-o", scratch.file("a.png")}).exit == 0);
    const auto stats = ctl(farm, {"stats", "--json"});
    REQUIRE(stats.exit == 0);
    const auto json = nlohmann::json::parse(stats.out);
    CHECK(json.at("jobs").at("done") == 1);
    CHECK(json.at("tiles").at("done").get<int>() > 0);
    CHECK(json.at("rays").get<std::uint64_t>() >= 64 * 48);
    CHECK(ctl(farm, {"stats"}).out.find("jobs over         1 done, 0 failed") != std::string::npos);
}

TEST_CASE("a doctor finds a farm well, and says what is wrong where it is not") {
    Farm farm;
    const auto lonely = ctl(farm, {"doctor"});
    CHECK(lonely.exit == 0);
    CHECK(lonely.out.find("-> start one on each machine: fraja-worker") != std::string::npos);
    farm.add_worker("one", {"-j", "2"});
    const auto well = ctl(farm, {"doctor", "--json"});
    CHECK(well.exit == 0);
    std::istringstream lines(well.out);
    for (std::string line; std::getline(lines, line);) {
        const auto finding = nlohmann::json::parse(line);
        CAPTURE(line);
        CHECK(finding.at("schema") == "fraja.finding/1");
        CHECK(finding.at("grade") != "bad");
    }
    const auto examine = [](const std::string& broker) {
        auto result = run({{program("fraja-ctl"), "-b", broker, "doctor"}}, patience);
        REQUIRE(result.has_value());
        return std::move(*result);
    };
    const auto nobody = examine("tcp://127.0.0.1:1");
    CHECK(nobody.exit == 3);
    CHECK(nobody.out.find("nothing listens there\n") != std::string::npos);
    CHECK(nobody.out.find("-> start one: fraja-broker --bind tcp://127.0.0.1:1\n") !=
          std::string::npos);
    const auto no_host = examine("no-such-host.invalid");
    CHECK(no_host.exit == 3);
    CHECK(no_host.out.find("no-such-host.invalid") != std::string::npos);
    CHECK(no_host.out.find("-> look for a typing error") != std::string::npos);
}

/// A worker of the farm that nobody looks after.
Process start_worker(Farm& farm, Words options) {
    Words argv{program("fraja-worker"), "-b", farm.endpoint(), "--name", "casual", "-j", "1"};
    argv.insert(argv.end(), options.begin(), options.end());
    auto process = Process::start({argv});
    REQUIRE(process.has_value());
    return std::move(*process);
}

TEST_CASE("a worker leaves by itself when it was idle, or its first work is over") {
    const Scratch scratch;
    Farm farm;
    Process idle = start_worker(farm, {"--idle-exit", "1s"});
    CHECK(idle.wait_for_exit(patience) == 0);
    CHECK(idle.err().find("has served enough") != std::string::npos);
    farm.broker().send(SIGSTOP);
    Process unheard = start_worker(farm, {"--idle-exit", "1s"});
    CHECK(unheard.wait_for_exit(patience) == 3);
    CHECK(unheard.err().find("no broker has answered") != std::string::npos);
    farm.broker().send(SIGCONT);
    Process once = start_worker(farm, {"--once"});
    REQUIRE(farm.submit({scene("cone"), "-r", "64x48", "-o", scratch.file("a.png")}).exit == 0);
    CHECK(once.wait_for_exit(patience) == 0);
    CHECK(once.err().find("has served enough") != std::string::npos);
}

TEST_CASE("a worker shows by a file that it does not hang") {
    const Scratch scratch;
    Farm farm;
    const std::string file = scratch.file("alive");
    Process worker = start_worker(farm, {"--alive", file});
    INFO(worker.story());
    for (int i = 0; i < 2; ++i) {
        while (!fs::exists(file))
            REQUIRE_FALSE(worker.wait_for_exit(10ms).has_value());
        const auto old = fs::last_write_time(file) - 1h;
        fs::last_write_time(file, old);
        while (fs::last_write_time(file) - old < 30min)
            REQUIRE_FALSE(worker.wait_for_exit(10ms).has_value());
    }
    worker.send(SIGTERM);
    CHECK(worker.wait_for_exit(patience) == 0);
    Process none = start_worker(farm, {"--alive", scratch.file("no/such")});
    CHECK(none.wait_for_exit(patience) == 2);
    CHECK(none.err().find("--alive " + scratch.file("no/such") + ": no file can be written") !=
          std::string::npos);
}

TEST_CASE("a worker that grew beyond its limit asks to be started again, and its tiles go on") {
    const Scratch scratch;
    Farm farm;
    // Tiles that take 36 MiB for some seconds, beside what a worker has before it draws any.
    const std::string id = farm.detach(
        {scene("cone"), "-r", "2048x1024", "-a", instrumented ? "2" : "4", "--tile", "1024"});
    Process small = start_worker(farm, {"--max-memory", "1M"});
    CHECK(small.wait_for_exit(patience) == 2);
    CHECK(small.err().find("before it draws anything") != std::string::npos);
    Farm empty;
    Process measured = start_worker(empty, {});
    REQUIRE(measured.wait_for_words(Process::Stream::err, "serves", patience));
    const auto limit = static_cast<int>(resident_mib(measured.pid())) + 6;
    Process large = start_worker(farm, {"--max-memory", std::to_string(limit) + "M"});
    CHECK(large.wait_for_exit(patience) == 75);
    farm.add_worker("one", {"-j", "2"});
    Process watcher = farm.watch(id);
    CHECK(watcher.wait_for_exit(patience) == 0);
}

TEST_CASE("a worker rests outside of its hours, and can be told to leave then") {
    Farm farm;
    // An hour that is twelve hours away, in the zone that TZ names.
    const std::time_t now = std::time(nullptr);
    std::tm utc{};
    gmtime_r(&now, &utc);
    const int begin = (utc.tm_hour + 12) % 24;
    const auto at = [](int hour) { return (hour < 10 ? "0" : "") + std::to_string(hour) + ":00"; };
    auto resting = Process::start({{program("fraja-worker"), "-b", farm.endpoint(), "-j", "1",
                                    "--hours", at(begin) + "-" + at((begin + 1) % 24)},
                                   {"TZ=UTC"}});
    REQUIRE(resting.has_value());
    CHECK(resting->wait_for_words(Process::Stream::err, "rests until " + at(begin), patience));
    CHECK(nlohmann::json::parse(ctl(farm, {"stats", "--json"}).out).at("workers").at("count") == 0);
    resting->send(SIGTERM);
    CHECK(resting->wait_for_exit(patience) == 0);
}

TEST_CASE("a worker is as nice as it is told to be") {
    Farm farm;
    Process worker = start_worker(farm, {"--nice", "7"});
    CHECK(worker.wait_for_words(Process::Stream::err, "serves", patience));
    CHECK(getpriority(PRIO_PROCESS, static_cast<id_t>(worker.pid())) == 7);
    worker.send(SIGTERM);
    CHECK(worker.wait_for_exit(patience) == 0);
}

} // namespace
} // namespace fraja::e2e
