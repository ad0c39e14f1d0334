#include "tests/e2e/farm.hpp"

#include <csignal>

using namespace fraja;
using namespace fraja::e2e;

namespace {

/// The broker has given the first worker up, and tiles of it back to the queue: so the job was
/// under way.
void wait_until_first_is_lost(Farm& farm) {
    const auto line =
        farm.broker().wait_for_words(Process::Stream::err, "worker first is gone", patience);
    REQUIRE(line.has_value());
    CHECK(line->find("; 0 tiles requeued") == std::string::npos);
}

/// Three workers, a job, and something done to the first worker when some tiles are there; the
/// picture must come out as if nothing had happened.
template <class Deed>
void check_picture_survives(Deed deed) {
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    Farm farm;
    const std::string job = farm.detach(long_picture());
    Process watcher = farm.watch_from_the_start(job, {"--json", "-o", scratch.file("farm.png")});
    for (const char* name : {"first", "second", "third"})
        farm.add_worker(name);
    wait_for_tiles(watcher, 10);
    deed(farm);
    INFO(farm.broker().err());
    CHECK(watcher.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("farm.png")) == want));
    // Nothing needs restarting: the next job is done by whoever is left.
    CHECK(farm.submit({scene("cone"), "-r", "20x15", "-o", scratch.file("next.png")}).exit == 0);
}

} // namespace

TEST_CASE("a worker killed in the middle of a job costs nothing but time") {
    check_picture_survives([](Farm& farm) {
        farm.worker(0).send(SIGKILL);
        wait_until_first_is_lost(farm);
    });
}

TEST_CASE("a worker stopped in the middle of a job is given up and may come back") {
    check_picture_survives([](Farm& farm) {
        farm.worker(0).send(SIGSTOP);
        wait_until_first_is_lost(farm);
        farm.worker(0).send(SIGCONT);
        int times = 0; // it is welcomed a second time
        CHECK(farm.broker()
                  .wait_for_line(
                      Process::Stream::err,
                      [&](std::string_view l) {
                          return l.find("worker first is here") != std::string_view::npos &&
                                 ++times == 2;
                      },
                      patience)
                  .has_value());
    });
}

TEST_CASE("a worker that is told to leave finishes what it has and exits with 0") {
    check_picture_survives([](Farm& farm) {
        farm.worker(0).send(SIGTERM);
        CHECK(farm.worker(0).wait_for_exit(patience) == 0);
        CHECK(farm.broker().err().find("failed on first") == std::string::npos);
    });
}

TEST_CASE("a worker told twice to leave hands its tile back at once") {
    Farm farm;
    Process& worker = farm.add_worker("first", {"-j", "1", "--log-level", "debug"});
    farm.detach(
        {scene("overlapping_spheres"), "-r", "640x480", "-a", "16", "--tile", "640"}); // minutes
    // It fetches the scene for a tile that it has.
    REQUIRE(worker.wait_for_words(Process::Stream::err, "fetched ", patience).has_value());
    // One at a time: two signals of a kind that come together are one.
    worker.send(SIGTERM);
    const auto leaving =
        worker.wait_for_words(Process::Stream::err, "leaving with 1 tile", patience);
    REQUIRE(leaving.has_value());
    worker.send(SIGTERM);
    CHECK(worker.wait_for_exit(patience) == 128 + SIGTERM);
    const auto gone =
        farm.broker().wait_for_words(Process::Stream::err, "worker first is gone", patience);
    REQUIRE(gone.has_value());
    CHECK(gone->find("(it said goodbye); 0 tiles") != std::string::npos); // all answered for
    CHECK(farm.broker().err().find("failed on first") == std::string::npos);
}

TEST_CASE("a worker that joins in the middle of a job gets tiles of it") {
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    Farm farm;
    const std::string job = farm.detach(long_picture());
    Process watcher = farm.watch_from_the_start(job, {"--json", "-o", scratch.file("farm.png")});
    farm.add_worker("first");
    wait_for_tiles(watcher, 3);
    farm.add_worker("second");
    CHECK(watcher.wait_for_exit(patience) == 0);
    const auto tiles = tile_lines(watcher.out());
    CHECK(std::ranges::count(tiles, "second", &TileLine::worker) > 0);
    CHECK(std::ranges::count(tiles, "first", &TileLine::worker) > 0);
    CHECK((bytes_of(scratch.file("farm.png")) == want));
}

TEST_CASE("two clients at once get their own pictures and a third one after them") {
    const Scratch scratch;
    const std::string tile = instrumented ? "4" : "10";
    const Words a = {scene("csg_basic"), "-r", instrumented ? "40x30" : "160x120", "-a", "2",
                     "--tile",           tile};
    const Words b = {scene("nested_aggregate"),
                     "-r",
                     instrumented ? "44x33" : "200x150",
                     "-d",
                     "9",
                     "--tile",
                     tile};
    const Words c = {scene("stereo"), "-r", "80x30"};
    const std::string want_a = local_picture(scratch, a), want_b = local_picture(scratch, b),
                      want_c = local_picture(scratch, c);
    Farm farm;
    farm.add_worker("one");
    farm.add_worker("two");
    Process client_a = farm.start_submit(with(a, {"-o", scratch.file("a.png")}));
    Process client_b = farm.start_submit(with(b, {"-o", scratch.file("b.png")}));
    CHECK(client_a.wait_for_exit(patience) == 0);
    CHECK(client_b.wait_for_exit(patience) == 0);
    CHECK(farm.submit(with(c, {"-o", scratch.file("c.png")})).exit == 0);
    CHECK((bytes_of(scratch.file("a.png")) == want_a));
    CHECK((bytes_of(scratch.file("b.png")) == want_b));
    CHECK((bytes_of(scratch.file("c.png")) == want_c));
}

TEST_CASE("a job waits for workers that come later") {
    const Scratch scratch;
    Farm farm;
    Process client =
        farm.start_submit({scene("cone"), "-r", "40x30", "-o", scratch.file("cone.png")});
    const auto queued =
        farm.broker().wait_for_words(Process::Stream::err, " pixels queued", patience);
    CHECK(queued.has_value());
    farm.add_worker("late");
    CHECK(client.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("cone.png")) ==
           local_picture(scratch, {scene("cone"), "-r", "40x30"})));
}

TEST_CASE("every program ends with 0 or its signal when it is told to") {
    const Scratch scratch;
    Farm farm;
    Process client = farm.start_submit({scene("cone"), "-r", "20x15", "-o", scratch.file("x.png")});
    const auto accepted = client.wait_for_words(Process::Stream::err, ": job ", patience);
    REQUIRE(accepted.has_value());
    Process watcher = farm.watch_from_the_start("cone", {"--json"});
    client.send(SIGTERM);
    CHECK(client.wait_for_exit(patience) == 128 + SIGTERM);
    watcher.send(SIGINT);
    CHECK(watcher.wait_for_exit(patience) == 128 + SIGINT);
    Process& worker = farm.add_worker("one");
    worker.send(SIGINT);
    CHECK(worker.wait_for_exit(patience) == 0);
    farm.broker().send(SIGTERM);
    CHECK(farm.broker().wait_for_exit(patience) == 0);
}

TEST_CASE("a worker finds its broker again") {
    const Scratch scratch;
    Farm farm;
    Process& worker = farm.add_worker("one");
    farm.broker().send(SIGTERM);
    REQUIRE(farm.broker().wait_for_exit(patience) == 0);
    auto again =
        Process::start({{program("fraja-broker"), "--bind", farm.endpoint(), "--publish",
                         "tcp://127.0.0.1:0", "--state", "none", "--heartbeat", heartbeat_option}});
    REQUIRE(again.has_value());
    const auto here = again->wait_for_words(Process::Stream::err, "worker one is here", patience);
    INFO(worker.story());
    REQUIRE(here.has_value());
    CHECK(farm.submit({scene("cone"), "-r", "20x15", "-o", scratch.file("c.png")}).exit == 0);
}

TEST_CASE("what a killed broker had of a picture is not drawn again") {
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    const std::string state = scratch.file("state");
    Farm farm({"--state", state}); // no beat is missed by chance: tiles count from a hello on
    const std::string job = farm.detach(long_picture());
    Process watcher = farm.watch_from_the_start(job, {"--json", "-o", scratch.file("farm.png")});
    Process& first = farm.add_worker("first");
    wait_for_tiles(watcher, 10);
    farm.broker().send(SIGKILL);
    CHECK(farm.broker().wait_for_exit(patience) == -SIGKILL);
    first.send(SIGKILL); // so that it answers no second broker with what it still has
    CHECK(first.wait_for_exit(patience) == -SIGKILL);
    farm.start_broker_again();
    const auto asked = [&](const Words& words) {
        const auto answer =
            run({with({program("fraja-ctl"), "-b", farm.endpoint(), "--json"}, words)}, patience);
        REQUIRE(answer.has_value());
        INFO(answer->err);
        REQUIRE(answer->exit == 0);
        return nlohmann::json::parse(answer->out);
    };
    const auto found = asked({"show", job});
    const int done = found.at("done_count"), all = found.at("cell_count");
    CHECK(done > 0); // who watches may have seen some that were not written yet
    CHECK(done < all);
    farm.add_worker("second");
    CHECK(watcher.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("farm.png")) == want));
    CHECK(asked({"workers"}).at("tiles_done") == all - done); // of a cell each

    farm.broker().send(SIGTERM);
    CHECK(farm.broker().wait_for_exit(patience) == 0);
    for (const auto& [directory, says] :
         {std::pair{state, "1 job, 1 of them over, " + std::to_string(all) + " tiles"},
          std::pair{scratch.file("none"), std::string("there is no store yet: it will be made")}}) {
        const auto checked =
            run({{program("fraja-broker"), "--state", directory, "--check"}}, patience);
        REQUIRE(checked.has_value());
        INFO(checked->out << checked->err);
        CHECK(checked->exit == 0);
        CHECK(contains(checked->out, says));
    }
    CHECK_FALSE(fs::exists(scratch.file("none")));
    const auto bad =
        run({{program("fraja-broker"), "--state", "/dev/null/state", "--check"}}, patience);
    REQUIRE(bad.has_value());
    CHECK(bad->exit == 2);
    CHECK(contains(bad->err, "--state /dev/null/state: /dev/null is no directory"));
}

// Passes that were complete come again: they belong to a new picture.
TEST_CASE("a picture of passes whose job the broker has lost begins anew") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one");
    Process client = farm.start_submit({scene("cone"), "-r", "8x6", "--tile", "8", "--time-limit",
                                        "10m", "--max-samples", "65536", "--name", "passes", "-o",
                                        scratch.file("passes.exr")});
    const auto accepted = client.wait_for_words(Process::Stream::err, ": job ", patience);
    REQUIRE(accepted.has_value());
    constexpr int some_passes = 4; // of one tile each
    Process before = farm.watch_from_the_start("passes", {"--json"});
    wait_for_tiles(before, some_passes);
    farm.broker().send(SIGKILL);
    CHECK(farm.broker().wait_for_exit(patience) == -SIGKILL);
    farm.start_broker_again();
    const auto again = client.wait_for_words(Process::Stream::err, "submitted again", patience);
    INFO(client.story());
    REQUIRE(again.has_value());
    Process after = farm.watch_from_the_start("passes", {"--json"});
    wait_for_tiles(after, some_passes);
    client.send(SIGTERM);
    CHECK(client.wait_for_exit(patience) == 128 + SIGTERM);
}
