// Brokers that are workers of other brokers: fraja-broker --upstream.
#include "tests/e2e/farm.hpp"

#include <chrono>
#include <csignal>
#include <cstdio>
#include <map>
#include <sstream>

namespace fraja::e2e {
namespace {

Words below(const Farm& above) {
    return {"--heartbeat", heartbeat_option, "--upstream", above.endpoint()};
}

/// Waits until the broker above has said that of the one below for the `count`-th time; the line.
std::string wait_for(Farm& above, Farm& branch, const std::string& what, int count = 1) {
    const std::string wanted = ":" + std::to_string(branch.broker().pid()) + what;
    const auto line = above.broker().wait_for_line(
        Process::Stream::err,
        [&](std::string_view l) {
            return l.find(wanted) != std::string_view::npos && --count == 0;
        },
        patience);
    INFO(above.broker().story());
    INFO(branch.broker().story());
    REQUIRE(line.has_value());
    return *line;
}

/// Names of a broker's workers, with the tiles that they have done.
std::map<std::string, std::uint64_t> workers_of(const Farm& farm) {
    auto listed =
        run({{program("fraja-ctl"), "-b", farm.endpoint(), "workers", "--json"}}, patience);
    REQUIRE(listed.has_value());
    INFO(listed->err);
    REQUIRE(listed->exit == 0);
    std::map<std::string, std::uint64_t> workers;
    std::istringstream lines(listed->out);
    for (std::string line; std::getline(lines, line);) {
        const auto worker = nlohmann::json::parse(line);
        workers[worker.at("name")] = worker.at("tiles_done");
    }
    return workers;
}

/// A root and two branches that have a worker each.
struct Tree {
    Farm root, left, right;
    explicit Tree(const Words& root_options = {"--heartbeat", heartbeat_option})
        : root(root_options), left(below(root)), right(below(root)) {
        left.add_worker("leaf");
        right.add_worker("leaf");
        wait_for(root, left, " is here");
        wait_for(root, right, " is here");
    }
};

/// Some seconds of work in many tiles.
Words long_picture() {
    return {scene("overlapping_spheres"),        "--kernel", "reference", "-r",
            instrumented ? "100x75" : "320x240", "-a",       "2"};
}

TEST_CASE("a tree draws what one machine draws") {
    const Scratch scratch;
    Tree tree;
    const Words size = {"-r", instrumented ? "80x60" : "320x240"};
    for (const Words& settings :
         {Words{"-a", "4"}, Words{"--error", "2"}, Words{"--kernel", "reference"},
          Words{"--tile", "16", "-a", "2"}, Words{"--crop", "10,20,61,30", "--spp", "8"},
          // As many passes as may be, long before the time is up.
          Words{"--time-limit", "1000s", "--max-samples", "16"}}) {
        const Words picture = with(with({scene("overlapping_spheres")}, size), settings);
        CAPTURE(settings[0]);
        const auto submitted = tree.root.submit(with(picture, {"-o", scratch.file("tree.exr")}));
        INFO(submitted.err);
        REQUIRE(submitted.exit == 0);
        // (The settings in the file are the same, too.)
        CHECK((bytes_of(scratch.file("tree.exr")) == local_picture(scratch, picture, "local.exr")));
    }
    const auto branches = workers_of(tree.root);
    CHECK(branches.size() == 2);
    if (instrumented) // the pictures are so small that one branch may draw them all
        return;
    for (const auto& [name, tiles] : branches) {
        CAPTURE(name);
        CHECK(tiles > 0);
    }
    CHECK(workers_of(tree.left).at("leaf") > 0);
    CHECK(workers_of(tree.right).at("leaf") > 0);
}

TEST_CASE("a tree ends in time") {
    const Scratch scratch;
    Tree tree;
    const auto begin = std::chrono::steady_clock::now();
    const auto submitted =
        tree.root.submit({scene("overlapping_spheres"), "-r", instrumented ? "80x60" : "320x240",
                          "--time-limit", "2s", "-o", scratch.file("tree.exr")});
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    INFO(submitted.err);
    CHECK(submitted.exit == 0);
    std::printf("a time limit of 2 s: the picture was there after %.2f s\n", took.count());
    CHECK(took < (instrumented ? 30s : 5s)); // of a busy machine
    CHECK(bytes_of(scratch.file("tree.exr")).size() > 1'000);
}

TEST_CASE("a branch that is killed in the middle of a job costs nothing but time") {
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    Tree tree;
    const std::string job = tree.root.detach(long_picture());
    Process watcher = tree.root.watch(job, {"--json", "-o", scratch.file("tree.png")});
    wait_for_tiles(watcher, 2);
    tree.left.broker().send(SIGKILL);
    wait_for(tree.root, tree.left, " is gone");
    INFO(tree.root.broker().story());
    CHECK(watcher.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("tree.png")) == want));
}

TEST_CASE("a branch whose only worker leaves says goodbye, and comes back with the next one") {
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    Farm root, branch(below(root));
    CHECK(workers_of(root).empty()); // it has nobody
    Process& worker = branch.add_worker("first");
    wait_for(root, branch, " is here");
    CHECK(workers_of(root).size() == 1);
    const std::string job = root.detach(long_picture());
    Process watcher = root.watch(job, {"--json", "-o", scratch.file("tree.png")});
    wait_for_tiles(watcher, 2);
    worker.send(SIGTERM);
    CHECK(worker.wait_for_exit(patience) == 0);
    CHECK(wait_for(root, branch, " is gone").find("it said goodbye") != std::string::npos);
    CHECK(workers_of(root).empty());
    branch.add_worker("second");
    wait_for(root, branch, " is here", 2);
    INFO(root.broker().story());
    CHECK(watcher.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("tree.png")) == want));
    CHECK(root.broker().err().find("failed on") == std::string::npos); // nobody is blamed
}

TEST_CASE("a root that was killed goes on with its job when it is started again") {
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    Tree tree({"--heartbeat", heartbeat_option, "--state", scratch.file("state")});
    const std::string job = tree.root.detach(long_picture());
    {
        Process watcher = tree.root.watch(job);
        wait_for_tiles(watcher, 3);
    }
    tree.root.broker().send(SIGKILL);
    REQUIRE(tree.root.broker().wait_for_exit(patience) == -SIGKILL);
    tree.root.start_broker_again();
    Process watcher = tree.root.watch(job, {"--json", "-o", scratch.file("tree.png")});
    INFO(tree.root.broker().story());
    CHECK(watcher.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("tree.png")) == want));
    wait_for(tree.root, tree.left, " is here");
    wait_for(tree.root, tree.right, " is here");
}

TEST_CASE("a branch that is told to leave takes its leave of the root") {
    Farm root, branch(below(root));
    branch.add_worker("leaf");
    const auto welcomed = branch.broker().wait_for_line(
        Process::Stream::err,
        [](std::string_view l) {
            return l.find("upstream ") != std::string_view::npos &&
                   l.find(": connected") != std::string_view::npos;
        },
        patience);
    REQUIRE(welcomed.has_value());
    branch.broker().send(SIGTERM);
    CHECK(branch.broker().wait_for_exit(30s) == 0); // once the root has answered its last beat
    CHECK(wait_for(root, branch, " is gone").find("it said goodbye") != std::string::npos);
}

TEST_CASE("brokers stand three high") {
    const Scratch scratch;
    const Words adaptive = {scene("overlapping_spheres"), "-r", instrumented ? "80x60" : "320x240",
                            "--error", "2"};
    Farm root, middle(below(root)), lowest(below(middle));
    lowest.add_worker("leaf");
    wait_for(middle, lowest, " is here");
    wait_for(root, middle, " is here");
    for (const Words& words : {long_picture(), adaptive}) {
        const auto submitted = root.submit(with(words, {"-o", scratch.file("tree.png")}));
        INFO(submitted.err);
        REQUIRE(submitted.exit == 0);
        CHECK((bytes_of(scratch.file("tree.png")) == local_picture(scratch, words)));
    }
    CHECK(workers_of(root).size() == 1);
    CHECK(workers_of(lowest).contains("leaf"));
    lowest.worker(0).send(SIGTERM); // then nobody has anybody
    wait_for(middle, lowest, " is gone");
    wait_for(root, middle, " is gone");
    CHECK(workers_of(root).empty());
}

TEST_CASE("an upstream that makes no sense is refused before anything starts") {
    for (const char* upstream : {"h:x", "tcp://h:0", "pgm://h:1", "tcp://*:50057", "tcp://a b:1",
                                 "tcp://127.0.0.1:50057" /* its own */}) {
        CAPTURE(upstream);
        const auto ran =
            run({{program("fraja-broker"), "--state", "none", "--bind", "tcp://127.0.0.1:50057",
                  "--publish", "tcp://127.0.0.1:0", "--upstream", upstream}},
                patience);
        REQUIRE(ran.has_value());
        CHECK(ran->exit == 2);
        CHECK(ran->out.empty()); // it has not listened
        CHECK(ran->err.find("--upstream") != std::string::npos);
    }
}

} // namespace
} // namespace fraja::e2e
