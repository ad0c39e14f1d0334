#include "tests/e2e/farm.hpp"

#include <algorithm>
#include <csignal>
#include <fstream>
#include <regex>
#include <sys/stat.h>

using namespace fraja;
using namespace fraja::e2e;

namespace {

/// libgcc_s.so, which every C++ program has loaded.
std::string library_of_this_program() {
    std::ifstream maps("/proc/self/maps");
    for (std::string line; std::getline(maps, line);)
        if (contains(line, "libgcc_s.so"))
            return line.substr(line.find('/'));
    FAIL("no libgcc_s.so");
    return {};
}

} // namespace

TEST_CASE("every invalid scene exits with 2 and nothing is submitted") {
    const Scratch scratch;
    Farm farm;
    std::size_t files = 0;
    const auto check = [&](const fs::path& path) {
        CAPTURE(path.string());
        const auto result = farm.submit({path.string(), "-o", scratch.file("x.png")});
        CHECK(result.exit == 2);
        CHECK(result.out.empty());
        const std::regex place(path.filename().string() + R"(:\d+:\d+: \S)");
        CHECK(std::regex_search(result.err, place));
        CHECK_FALSE(fs::exists(scratch.file("x.png")));
        ++files;
    };
    for (const auto& entry : fs::directory_iterator(FRAJA_SOURCE_DIR "/scenes/invalid"))
        if (entry.path().extension() == ".raj")
            check(entry.path());
    CHECK(files == 59);
    check(scene("missing_texture"));
    Process watcher = farm.watch("");
    CHECK(watcher.wait_for_exit(patience) == 6); // no job at all
}

TEST_CASE("an overlap that a ray must resolve fails the job and names both solids") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one");
    const Words picture = {scene("overlap_without_priority"), "-r", "80x60", "-o",
                           scratch.file("x.png")};
    Words locally = picture;
    locally.push_back("--local");
    for (const RunResult& result : {farm.submit(picture), submit(locally)}) {
        CHECK(result.exit == 1);
        CHECK(contains(result.err, "@a"));
        CHECK(contains(result.err, "@c"));
        CHECK_FALSE(fs::exists(scratch.file("x.png")));
    }
}

TEST_CASE("what Raja dies of is drawn") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one");
    const std::string path = scratch.file("x.png");
    CHECK(farm.submit({scene("normal_incidence"), "-r", "41x31", "-a", "1", "-o", path}).exit == 0);
    CHECK(farm.submit({scene("no_blue"), "-r", "40x30", "-e", "-o", path}).exit == 0);
}

TEST_CASE("mistakes on the command line exit with 2 and say what is wrong") {
    const Scratch scratch;
    struct Row {
        Words arguments;
        const char* says;
    };
    const std::string cone = scene("cone");
    for (const Row& row : {
             Row{{}, ""},
             Row{{"no_such_file.raj", "--local"}, "no_such_file.raj"},
             Row{{cone, "--local", "-r", "640"}, "640"},
             Row{{cone, "--local", "-r", "0x0"}, "0x0"},
             Row{{cone, "--local", "-r", "99999x99999"}, "99999"},
             Row{{cone, "--local", "-d", "-1"}, "-1"},
             Row{{cone, "--local", "--crop", "0,0,0,0"}, "crop"},
             Row{{cone, "--local", "--crop", "200,0,100,100"}, "crop"},
             Row{{cone, "--local", "--tile", "99999"}, "tile"},
             Row{{cone, "--local", "-o", scratch.file("picture.pgn")}, "pgn"},
             Row{{cone, "--local", "-o", "/no/such/directory/x.png"}, "/no/such/directory"},
             Row{{cone, "--colour"}, "--colour"},
             Row{{cone, "--detach", "-o", scratch.file("x.png")}, "--detach"},
             Row{{cone, "-b", "pgm://x", "-o", scratch.file("x.png")}, "pgm"},
             Row{{cone, "-b", "", "-o", scratch.file("x.png")}, "-b '': empty, and ENDPOINT"},
             Row{{cone, "--local", "-o", ""}, "-o '': empty, and FILE"},
             Row{{cone, "--local", "--name="}, "--name '': empty, and NAME"},
             Row{{cone, "--local", "-b", "tcp://127.0.0.1:1"},
                 "--local and -b/--broker contradict"},
         }) {
        const auto result = submit(row.arguments);
        CAPTURE(row.says);
        CAPTURE(result.err);
        CHECK(result.exit == 2);
        CHECK(result.out.empty());
        CHECK(contains(result.err, row.says));
    }
}

TEST_CASE("the library for pictures is loaded from beside the program, when a picture is wanted") {
    const Scratch scratch;
    fs::create_directories(scratch.file("bin"));
    fs::create_directories(scratch.file("lib/fraja"));
    const std::string name = "lib/fraja/picture_codec.so";
    const fs::path built = fs::path(FRAJA_BIN_DIR) / ".." / name;
    const std::string alone = scratch.file("bin/fraja-submit"), library = scratch.file(name);
    const std::string picture = scratch.file("x.png");
    fs::copy_file(program("fraja-submit"), alone);
    const auto draw = [&] {
        auto result =
            run({{alone, "--local", scene("cone"), "-r", "8x6", "-o", picture}}, patience);
        REQUIRE(result.has_value());
        return *std::move(result);
    };
    const auto fails = [&](std::string_view why) {
        const RunResult result = draw();
        CAPTURE(result.err);
        CHECK(result.exit == 2);
        CHECK(contains(result.err, fs::canonical(scratch.file("")).string() + "/" + name + ": "));
        CHECK(contains(result.err, why));
        CHECK_FALSE(fs::exists(picture));
    };
    CHECK(run({{alone, "--version"}}, patience)->exit == 0);
    fails("there is no such file");
    std::ofstream(library) << "this is no library";
    fails("file too short");
    fs::copy_file(library_of_this_program(), library, fs::copy_options::overwrite_existing);
    fails("is of another version than fraja-submit");
    fs::copy_file(built, library, fs::copy_options::overwrite_existing);
    const RunResult result = draw();
    INFO(result.err);
    CHECK(result.exit == 0);
    CHECK(fs::exists(picture));
}

TEST_CASE("without a broker it exits with 3 within the time given") {
    const Scratch scratch;
    const auto result = submit({scene("cone"), "-b", "tcp://127.0.0.1:1", "--connect-timeout",
                                "300ms", "-o", scratch.file("x.png")});
    CHECK(result.exit == 3);
    CHECK(contains(result.err, "127.0.0.1:1"));
}

TEST_CASE("when its time runs out it exits with 124 and the job goes on") {
    const Scratch scratch;
    Farm farm; // and no worker
    // The time counts from the start: a busy machine may need more of it to submit at all.
    Duration timeout = 500ms;
    RunResult result;
    do {
        result = farm.submit({scene("cone"), "-r", "20x15", "--timeout",
                              std::to_string(timeout / 1ms) + "ms", "-o", scratch.file("x.png")});
        INFO(result.err);
        REQUIRE(result.exit == 124);
        timeout *= 2;
    } while (contains(result.err, "no broker has acknowledged the job") && timeout < patience);
    CHECK(contains(result.err, "goes on"));
    farm.add_worker("late");
    Process watcher = farm.watch("cone");
    const auto exit = watcher.wait_for_exit(patience);
    INFO(watcher.story());
    CHECK(exit == 0);
}

TEST_CASE("an interrupt leaves the job running and says how to go on") {
    const Scratch scratch;
    Farm farm;
    Process client = farm.start_submit({scene("cone"), "-r", "20x15", "-o", scratch.file("x.png")});
    const auto queued = client.wait_for_words(Process::Stream::err, ": job ", patience);
    REQUIRE(queued.has_value());
    client.send(SIGINT);
    CHECK(client.wait_for_exit(patience) == 130);
    CHECK(contains(client.err(), "fraja-watch"));
    farm.add_worker("late");
    Process watcher = farm.watch("cone");
    CHECK(watcher.wait_for_exit(patience) == 0);
}

TEST_CASE("a signal is heard while a scene is read from a pipe") {
    const Scratch scratch;
    const std::string pipe = scratch.file("scene.raj");
    for (const Words& words :
         {Words{"-o", scratch.file("x.png")},
          Words{"-o", scratch.file("%d.png"), "--travel", scene("travels/cone")}}) {
        fs::remove(pipe);
        REQUIRE(mkfifo(pipe.c_str(), 0600) == 0);
        auto waiting = Process::start({with({program("fraja-submit"), pipe, "--local"}, words)});
        REQUIRE(waiting.has_value());
        const std::ofstream writer(pipe); // it reads now
        waiting->send(SIGTERM);           // SIGINT may be ignored where tests run in the background
        CHECK(waiting->wait_for_exit(patience) == -SIGTERM);
    }
}

TEST_CASE("help opens with examples, and version says version, revision and instruction set") {
    for (const char* name :
         {"fraja-broker", "fraja-worker", "fraja-submit", "fraja-watch", "fraja-ctl"}) {
        CAPTURE(name);
        const auto help = run({{program(name), "--help"}}, patience);
        REQUIRE(help.has_value());
        CHECK(help->exit == 0);
        CHECK(help->out.find(name) < help->out.find("--help"));
        const auto version = run({{program(name), "--version"}}, patience);
        REQUIRE(version.has_value());
        CHECK(version->exit == 0);
        CAPTURE(version->out);
        const std::regex line(std::string(name) + R"( \d+\.\d+\.\d+, revision )" +
                              R"(([0-9a-f]{12}(\+changes)?|unknown), (x86-64(-v[234])?|arm64)\n)");
        CHECK(std::regex_match(version->out, line));
    }
}

TEST_CASE("an instruction set that is unknown is a usage error, wherever something is drawn") {
    const Scratch scratch;
    Farm farm;
    const Words unknown = {"FRAJA_ISA=x86-64-v9"};
    const Words cone = {scene("cone"), "-r", "20x15", "-o", scratch.file("x.png")};
    Words locally = cone;
    locally.push_back("--local");
    const auto worker = run({{program("fraja-worker"), "-b", farm.endpoint()}, unknown}, patience);
    REQUIRE(worker.has_value());
    for (const RunResult& result : {*worker, submit(locally, unknown)}) {
        CHECK(result.exit == 2);
        CHECK(result.out.empty());
        CHECK(contains(result.err, "FRAJA_ISA=x86-64-v9"));
        CHECK(std::ranges::count(result.err, '\n') == 1);
    }
    CHECK_FALSE(fs::exists(scratch.file("x.png")));
    for (const char* name : {"fraja-worker", "fraja-submit"}) { // they can still say who they are
        const auto version = run({{program(name), "--version"}, unknown}, patience);
        REQUIRE(version.has_value());
        CHECK(version->exit == 0);
    }
    farm.add_worker("one");
    Words remotely = cone;
    remotely.insert(remotely.end(), {"-b", farm.endpoint()});
    CHECK(submit(remotely, unknown).exit == 0); // nothing is drawn here
}

TEST_CASE("an unfinished local picture never bears the name of a whole one") {
    const Scratch scratch;
    const std::string whole = scratch.file("x.png"), unfinished = scratch.file("x.unfinished.png");
    const Words slow = {scene("overlapping_spheres"),
                        "--local",
                        "-r",
                        "640x480",
                        "-a",
                        "16",
                        "--tile",
                        "2",
                        "-o",
                        whole};
    const auto interrupted = [&] {
        auto client =
            Process::start({with({program("fraja-submit")}, with(slow, {"--progress", "json"}))});
        REQUIRE(client.has_value());
        const auto begun = client->wait_for_line(
            Process::Stream::err,
            [](std::string_view line) {
                return contains(line, "\"running\"") && !contains(line, "\"done_count\":0,");
            },
            patience);
        INFO(client->story());
        REQUIRE(begun.has_value());
        client->send(SIGINT);
        CHECK(client->wait_for_exit(patience) == 130);
        CHECK(contains(client->err(), unfinished + " holds the "));
        CHECK(fs::exists(unfinished));
        fs::remove(unfinished);
    };
    interrupted();
    CHECK_FALSE(fs::exists(whole)); // --skip-existing would take it for done
    REQUIRE(submit({scene("cone"), "--local", "-r", "20x15", "-o", whole}).exit == 0);
    const std::string before = bytes_of(whole);
    interrupted();
    CHECK((bytes_of(whole) == before));
    CHECK(submit(with(slow, {"--timeout", "300ms"})).exit == 124);
    CHECK((bytes_of(whole) == before));
}

TEST_CASE("a refused scene tells scripts why") {
    const auto result =
        submit({FRAJA_SOURCE_DIR "/scenes/invalid/unclosed.raj", "--local", "--json"});
    CHECK(result.exit == 2);
    const auto json = nlohmann::json::parse(result.out);
    CHECK(json.at("exit_code") == 2);
    CHECK(contains(json.at("reason").get<std::string>(), "unclosed.raj:"));
}

TEST_CASE("a result that cannot be written is no success") {
    const Scratch scratch;
    const auto result = run({{"/bin/sh", "-c",
                              program("fraja-submit") + " --local --stats -r 8x6 " + scene("cone") +
                                  " -o " + scratch.file("x.png") + " >/dev/full"}},
                            patience);
    REQUIRE(result.has_value());
    CHECK(result->exit == 1);
    CHECK(contains(result->err, "standard output"));
}

TEST_CASE("a picture comes out although its messages cannot be written") {
    const Scratch scratch;
    const auto result = run(
        {{"sh", "-c", R"("$@" 2>/dev/full)", "sh", program("fraja-submit"), scene("cone"),
          "--local", "-j", "1", "-r", "32x24", "--progress", "plain", "-o", scratch.file("x.png")}},
        patience);
    REQUIRE(result.has_value());
    CHECK(result->exit == 0);
    CHECK(fs::exists(scratch.file("x.png")));
}

TEST_CASE("a program that gets no threads ends and says so") {
    if (instrumented) // a sanitizer wants more addresses than there is memory
        return;
    const Scratch scratch;
    const Words little{"prlimit", "--as=1000000000"}; // and a thread takes 8 MiB for its stack
    const Words local{program("fraja-submit"), scene("cone"), "--local", "-j", "256"};
    for (const Words& words :
         {with(local, {"-o", scratch.file("x.png")}),
          with(local, {"-o", scratch.file("%d.png"), "--travel",
                       FRAJA_SOURCE_DIR "/scenes/travels/cone.raj"}),
          Words{program("fraja-worker"), "-j", "256", "-b", "tcp://127.0.0.1:9"}}) {
        const auto result = run({with(little, words)}, patience);
        REQUIRE(result.has_value());
        CAPTURE(result->err);
        CHECK(result->exit.value_or(-1) > 0); // no signal
        CHECK(contains(result->err, "Resource temporarily unavailable"));
        CHECK_FALSE(contains(result->err, "terminate called"));
    }
}

TEST_CASE("fraja-watch off a terminal shows the broker before jobs and workers") {
    Farm farm;
    const auto result = run({{program("fraja-watch"), "-b", farm.endpoint(), "--once"}}, patience);
    REQUIRE(result.has_value());
    CHECK(result->exit == 0);
    CHECK(result->out.starts_with("BROKER "));
    CHECK(result->out.find(farm.endpoint()) < result->out.find("no jobs"));
    CHECK(result->out.find("no jobs") < result->out.find("no workers"));
}

TEST_CASE("a dry run checks everything and submits nothing") {
    const Scratch scratch;
    const auto result = submit(
        {scene("cone"), "--dry-run", "-b", "tcp://127.0.0.1:1", "-o", scratch.file("x.png")});
    CHECK(result.exit == 0);
    CHECK_FALSE(fs::exists(scratch.file("x.png")));
    for (const char* line : {"picture   64x48, of it 0,0,32,16\n", "broker    tcp://127.0.0.1:1\n"})
        for (const Words& what :
             {Words{"-o", scratch.file("x.png")},
              Words{"-o", scratch.file("%d.png"), "--travel", scene("travels/cone")}}) {
            const auto plan = submit(with({scene("cone"), "--dry-run", "-b", "127.0.0.1:1", "-r",
                                           "64x48", "--crop", "0,0,32,16"},
                                          what));
            CAPTURE(plan.out);
            CHECK(plan.exit == 0);
            CHECK(contains(plan.out, line));
        }
}

TEST_CASE("a dry run's JSON says as much as its words") {
    const Scratch scratch;
    const std::string path = scratch.file("x.png");
    const auto planned = [&](const Words& more) {
        const auto result = submit(with({scene("cone"), "--dry-run", "--json"}, more));
        CHECK(result.exit == 0);
        return nlohmann::json::parse(result.out);
    };
    const auto there = planned({"-b", "127.0.0.1:1", "-o", path});
    CHECK(there.at("state") == "dry_run");
    CHECK(there.at("output") == path);
    CHECK(there.at("broker") == "tcp://127.0.0.1:1");
    CHECK(planned({"--local", "-o", path}).at("broker").is_null());
    const auto film =
        planned({"--travel", scene("travels/cone"), "--frames", "2", "-o", scratch.file("%d.png")});
    CHECK(film.at("broker") == "tcp://127.0.0.1:50057");
    CHECK(film.at("frames").at(0).at("output") == scratch.file("2.png"));
}

TEST_CASE("one whose job is cancelled meanwhile exits with 5 and writes nothing") {
    const Scratch scratch;
    Farm farm; // and no worker: it is not done before
    Process client = farm.start_submit({scene("cone"), "-r", "20x15", "-o", scratch.file("x.png")});
    REQUIRE(client.wait_for_words(Process::Stream::err, ": job ", patience).has_value());
    const auto cancelled =
        run({{program("fraja-ctl"), "-b", farm.endpoint(), "cancel", "--yes", "cone"}}, patience);
    REQUIRE(cancelled.has_value());
    CHECK(cancelled->exit == 0);
    CHECK(client.wait_for_exit(patience) == 5);
    INFO(client.story());
    CHECK(contains(client.err(), "cancelled"));
    CHECK(fs::is_empty(scratch.file("")));
}
