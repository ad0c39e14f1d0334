// fraja-submit --direct: a job on workers that listen, without a broker.
#include "tests/e2e/farm.hpp"

#include <algorithm>
#include <csignal>
#include <deque>
#include <set>
#include <sstream>

using namespace fraja;
using namespace fraja::e2e;

namespace {

/// Minutes of it.
Words endless_picture() {
    return {scene("overlapping_spheres"), "-r", "640x480", "-a", "16", "--tile", "4"};
}
Words small_picture() {
    return {scene("cone"), "-r", "40x30"};
}

/// Workers that listen on ports that the system chose.
class Listeners {
public:
    Process& add(const std::string& name, Words options = {"-j", "1"}, std::size_t count = 1,
                 const std::string& listen = "tcp://127.0.0.1:0") {
        auto started = Process::start(
            {with({program("fraja-worker"), "--listen", listen, "--name", name}, options)});
        REQUIRE_MESSAGE(started.has_value(), (started ? "" : started.error().message));
        Process& worker = workers_.emplace_back(std::move(*started));
        const auto last = worker.wait_for_line(
            Process::Stream::out, [&](std::string_view) { return --count == 0; }, patience);
        INFO(worker.story());
        REQUIRE(last.has_value());
        std::istringstream lines(worker.out());
        for (std::string word, endpoint; lines >> word >> endpoint;) {
            REQUIRE(word == "listening");
            REQUIRE(endpoint.starts_with("tcp://127.0.0.1:"));
            endpoints.push_back(endpoint);
        }
        return worker;
    }
    Process& operator[](std::size_t i) { return workers_.at(i); }
    [[nodiscard]] std::string all() const {
        std::string joined;
        for (const std::string& endpoint : endpoints)
            joined += (joined.empty() ? "" : ",") + endpoint;
        return joined;
    }
    std::vector<std::string> endpoints;

private:
    std::deque<Process> workers_;
};

Process start_submit(const Words& arguments) {
    auto process = Process::start({with({program("fraja-submit")}, arguments)});
    REQUIRE_MESSAGE(process.has_value(), (process ? "" : process.error().message));
    return std::move(*process);
}

/// Waits until a worker has been welcomed by so many callers in all.
void wait_for_callers(Process& worker, std::size_t count) {
    const auto line = worker.wait_for_line(
        Process::Stream::err,
        [&](std::string_view l) { return contains(l, ": connected: ") && --count == 0; }, patience);
    INFO(worker.story());
    REQUIRE(line.has_value());
}

/// Waits for a line of progress that tells of at least one per cent; they are written where stderr
/// is no terminal as well.
void wait_for_progress(Process& client) {
    const auto line = client.wait_for_line(
        Process::Stream::err,
        [](std::string_view l) { return contains(l, "%") && !contains(l, "  0%"); }, patience);
    INFO(client.story());
    REQUIRE(line.has_value());
}

} // namespace

TEST_CASE("a picture from workers that listen has the bytes of the local one, job after job") {
    const Scratch scratch;
    Listeners workers;
    workers.add("one");
    workers.add("two");
    const std::string path = scratch.file("direct.exr");
    for (const Words& options : {Words{},
                                 {"-a", "2", "--schedule", "static"},
                                 {"--error", "4", "--tile", "7"},
                                 {"--schedule", "stealing", "--crop", "5,3,17,13"}}) {
        const Words words = with({scene("overlapping_spheres"), "-r", "96x72"}, options);
        const std::string want = local_picture(scratch, words, "want.exr");
        const RunResult result =
            submit(with(words, {"--direct", workers.all(), "--json", "--stats", "-o", path}));
        INFO(result.err);
        REQUIRE(result.exit == 0);
        CHECK((bytes_of(path) == want));
        CHECK(nlohmann::json::parse(result.out).at("state") == "done");
    }
    for (std::size_t i : {0u, 1u}) {
        workers[i].send(SIGTERM);
        CHECK(workers[i].wait_for_exit(patience) == 0);
    }
}

TEST_CASE("emulated workers that listen are called each at a port of its own") {
    const Scratch scratch;
    Listeners workers;
    workers.add("many", {"--emulate", "3@20M", "--emulate", "1@40M"}, 4);
    REQUIRE(std::set<std::string>(workers.endpoints.begin(), workers.endpoints.end()).size() == 4);
    const std::string path = scratch.file("direct.png");
    const RunResult result =
        submit({scene("cone"), "-r", "96x72", "--direct", workers.all(), "-o", path});
    INFO(result.err);
    REQUIRE(result.exit == 0);
    CHECK((bytes_of(path) == local_picture(scratch, {scene("cone"), "-r", "96x72"})));
    wait_for_callers(workers[0], 4);
}

TEST_CASE("a listening worker that is killed in the middle of a job costs nothing but time") {
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    Listeners workers;
    workers.add("one");
    workers.add("two");
    const std::string path = scratch.file("direct.png");
    Process client = start_submit(
        with(long_picture(), {"--direct", workers.all(), "--progress", "plain", "-o", path}));
    wait_for_callers(workers[0], 1);
    wait_for_callers(workers[1], 1);
    wait_for_progress(client);
    workers[0].send(SIGKILL);
    REQUIRE(workers[0].wait_for_exit(patience) == -SIGKILL);
    const auto exit = client.wait_for_exit(patience);
    INFO(client.story());
    CHECK(exit == 0);
    CHECK((bytes_of(path) == want));
}

TEST_CASE("a worker that is started again at its port in the middle of a job is found there") {
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    Listeners workers;
    workers.add("one");
    const std::string endpoint = workers.endpoints[0], path = scratch.file("direct.png");
    Process client = start_submit(
        with(long_picture(), {"--direct", endpoint, "--progress", "plain", "-o", path}));
    wait_for_progress(client);
    workers[0].send(SIGKILL);
    REQUIRE(workers[0].wait_for_exit(patience) == -SIGKILL);
    workers.add("again", {"-j", "1"}, 1, endpoint);
    const auto exit = client.wait_for_exit(patience);
    INFO(client.story());
    CHECK(exit == 0);
    CHECK((bytes_of(path) == want));
    wait_for_callers(workers[1], 1);
}

TEST_CASE("two jobs at once share a worker: one waits for its turn, and both come out right") {
    const Scratch scratch;
    const std::string want_long = local_picture(scratch, long_picture()),
                      want_small = local_picture(scratch, small_picture());
    Listeners workers;
    workers.add("one");
    Process first = start_submit(with(long_picture(), {"--direct", workers.all(), "--progress",
                                                       "plain", "-o", scratch.file("a.png")}));
    wait_for_callers(workers[0], 1);
    Process second =
        start_submit(with(small_picture(), {"--direct", workers.all(), "--connect-timeout", "10m",
                                            "-o", scratch.file("b.png")}));
    CHECK(second.wait_for_exit(patience) == 0);
    CHECK(first.wait_for_exit(patience) == 0);
    INFO(workers[0].story());
    wait_for_callers(workers[0], 2); // of each once: the first was served to its end
    CHECK((bytes_of(scratch.file("a.png")) == want_long));
    CHECK((bytes_of(scratch.file("b.png")) == want_small));
    const auto third = workers[0].wait_for_line(
        Process::Stream::err,
        [count = 0](std::string_view l) mutable {
            return contains(l, ": connected: ") && ++count == 3;
        },
        0s);
    CHECK_FALSE(third.has_value());
    CHECK_FALSE(contains(workers[0].err(), "oddity"));
}

TEST_CASE("a worker serves the next job when the one before it was killed or interrupted") {
    const Scratch scratch;
    const std::string want = local_picture(scratch, small_picture());
    Listeners workers;
    workers.add("one");
    std::size_t callers = 0;
    for (const int signal : {SIGKILL, SIGINT}) {
        CAPTURE(signal);
        Process first = start_submit(
            with(endless_picture(), {"--direct", workers.all(), "-o", scratch.file("a.png")}));
        wait_for_callers(workers[0], ++callers);
        first.send(signal);
        CHECK(first.wait_for_exit(patience) == (signal == SIGKILL ? -SIGKILL : 130));
        CHECK_FALSE(contains(first.err(), "goes on"));
        const RunResult next =
            submit(with(small_picture(), {"--direct", workers.all(), "-o", scratch.file("b.png")}));
        INFO(workers[0].story());
        ++callers;
        REQUIRE(next.exit == 0);
        CHECK((bytes_of(scratch.file("b.png")) == want));
    }
}

TEST_CASE("a film is drawn by workers that listen, and given up where none answers") {
    const Scratch scratch;
    const Words film =
        with(small_picture(), {"--travel", scene("travels/cone"), "--frames", "1-3"});
    Listeners workers;
    workers.add("one");
    workers.add("two");
    const RunResult drawn = submit(with(
        film, {"--direct", workers.all() + ",127.0.0.1:1", "-o", scratch.file("direct%d.png")}));
    REQUIRE_MESSAGE(drawn.exit == 0, drawn.err);
    REQUIRE(submit(with(film, {"--local", "-o", scratch.file("local%d.png")})).exit == 0);
    for (const char* n : {"1.png", "2.png", "3.png"})
        CHECK((bytes_of(scratch.file(std::string("direct") + n)) ==
               bytes_of(scratch.file(std::string("local") + n))));
    // So long that all three have begun by then, also where programs are slow.
    const RunResult nobody = submit(with(film, {"--direct", "127.0.0.1:1", "--connect-timeout",
                                                "3s", "-o", scratch.file("none%d.png")}));
    CHECK(nobody.exit == 3);
    INFO(nobody.err);
    CHECK(contains(nobody.err, "no worker takes tiles at tcp://127.0.0.1:1: "));
    CHECK(contains(nobody.err, "of 3 frames 0 written, 0 not begun: the same command with "
                               "--skip-existing goes on"));
}

TEST_CASE("where no worker answers in time it exits with 3 and names them all") {
    const Scratch scratch;
    const Words late = {"--connect-timeout", "300ms", "-o", scratch.file("x.png")};
    const RunResult nobody =
        submit(with(with(small_picture(), {"--direct", "127.0.0.1:1,127.0.0.1:2"}), late));
    CHECK(nobody.exit == 3);
    CHECK(contains(nobody.err, "tcp://127.0.0.1:1, tcp://127.0.0.1:2"));

    Listeners workers;
    workers.add("one");
    Process first = start_submit(
        with(endless_picture(), {"--direct", workers.all(), "-o", scratch.file("a.png")}));
    wait_for_callers(workers[0], 1);
    const RunResult busy = submit(with(with(small_picture(), {"--direct", workers.all()}), late));
    CHECK(busy.exit == 3);
    CHECK(contains(busy.err, workers.all()));

    Farm farm; // a broker is no worker
    const RunResult broker =
        submit(with(with(small_picture(), {"--direct", farm.endpoint()}), late));
    CHECK(broker.exit == 3);
    CHECK_FALSE(fs::exists(scratch.file("x.png")));
}

TEST_CASE("mistakes about listening and calling exit with 2 and say what is wrong") {
    struct Row {
        Words words;
        const char* says;
    };
    const Words submit_cone = with({program("fraja-submit")}, small_picture());
    const Words listen = {program("fraja-worker"), "--listen"};
    for (const Row& row : {Row{with(submit_cone, {"--direct", "h"}), "a port is missing"},
                           Row{with(submit_cone, {"--direct", "h:1", "-b", "h:2"}), "--broker"},
                           Row{with(submit_cone, {"--direct", "h:1", "--local"}), "--local"},
                           Row{with(listen, {"tcp://127.0.0.1:0", "-b", "h:2"}), "--broker"},
                           Row{with(listen, {"tcp://*:0"}), "--insecure"},
                           Row{with(listen, {"tcp://127.0.0.1:x"}), "port"},
                           Row{{program("fraja-worker"), "--insecure"}, "--listen"}}) {
        const auto result = run({row.words}, patience);
        REQUIRE(result.has_value());
        CAPTURE(row.says);
        CAPTURE(result->err);
        CHECK(result->exit == 2);
        CHECK(result->out.empty());
        CHECK(contains(result->err, row.says));
    }
    // The environment names a broker for those who want one.
    const RunResult result = submit(with(small_picture(), {"--direct", "127.0.0.1:1", "--dry-run"}),
                                    {"FRAJA_BROKER=h:1"});
    CHECK(result.exit == 0);
    CHECK(contains(result.out, "workers at tcp://127.0.0.1:1"));
}
