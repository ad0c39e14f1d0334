// Films: fraja-submit --travel, with real processes.
#include "tests/e2e/farm.hpp"

#include <csignal>
#include <doctest/doctest.h>
#include <fstream>
#include <sstream>

namespace fraja::e2e {
namespace {

const std::string travel = std::string(FRAJA_SOURCE_DIR) + "/scenes/travels/cone.raj";
const Words small{"-r", "64x48"};

Words film(const std::string& output, Words more = {}) {
    Words words{scene("cone"), "--travel", travel, "-o", output};
    words.insert(words.end(), small.begin(), small.end());
    words.insert(words.end(), more.begin(), more.end());
    return words;
}

/// The id of the one job of that name, once its scene is there; empty: there is none.
std::string frame_job(Farm& farm, const std::string& name) {
    const auto list =
        run({{program("fraja-ctl"), "-b", farm.endpoint(), "jobs", "--json"}}, patience);
    REQUIRE(list.has_value());
    std::string id;
    std::istringstream lines(list->out);
    for (std::string line; std::getline(lines, line);)
        if (const auto job = nlohmann::json::parse(line); job.at("name") == name) {
            CHECK(id.empty());
            if (job.at("state") != "waiting_for_scene")
                id = job.at("job");
        }
    return id;
}

std::string wait_for_frame_job(Farm& farm, const std::string& name) {
    std::string id;
    while (id.empty())
        id = frame_job(farm, name);
    return id;
}

TEST_CASE("a film's frames are the pictures that --local draws of them, in numbered files") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one");
    farm.add_worker("two");
    const auto drawn = farm.submit(film(scratch.file("farm%03d.png"), {"--frames", "2-10x2"}));
    REQUIRE_MESSAGE(drawn.exit == 0, drawn.err);
    const auto local =
        submit(film(scratch.file("local%d.png"), {"--frames", "1-12", "--local", "-j", "2"}));
    REQUIRE_MESSAGE(local.exit == 0, local.err);
    CHECK(local.err.find("cone  12 of 12 frames  100%") != std::string::npos);
    std::set<std::string> pictures;
    for (int n = 1; n <= 12; ++n) {
        CAPTURE(n);
        const std::string one = bytes_of(scratch.file("local" + std::to_string(n) + ".png"));
        const std::string name =
            scratch.file(std::string("farm0") + (n < 10 ? "0" : "") + std::to_string(n) + ".png");
        CHECK(fs::exists(name) == (n % 2 == 0 && n <= 10));
        if (fs::exists(name))
            CHECK((bytes_of(name) == one));
        pictures.insert(one);
    }
    CHECK(pictures.size() == 12); // each from another place
}

TEST_CASE("a frame is the picture of its scene with another camera") {
    const Scratch scratch;
    const std::string cameras = bytes_of(travel);
    std::string text = bytes_of(scene("cone"));
    const std::size_t begin = cameras.find("raja.renderer"), end = cameras.find("  },", begin) + 3;
    const std::size_t at = text.find("raja.renderer.HorizontalCamera");
    REQUIRE(at != std::string::npos);
    text.replace(at, text.find("\n  }", at) + 4 - at, cameras.substr(begin, end - begin));
    std::ofstream(scratch.file("first.raj")) << text;
    Words single{scratch.file("first.raj")};
    single.insert(single.end(), small.begin(), small.end());
    const auto drawn =
        submit(film(scratch.file("f%d.png"), {"--frames", "1", "--local", "-j", "1"}));
    REQUIRE_MESSAGE(drawn.exit == 0, drawn.err);
    CHECK((bytes_of(scratch.file("f1.png")) == local_picture(scratch, single)));
}

TEST_CASE("frames whose files are there are skipped if asked for, and else drawn anew") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one", {"-j", "2"});
    const std::string pattern = scratch.file("%02d.png");
    std::ofstream(scratch.file("02.png")) << "mine";
    const auto report =
        farm.submit(film(pattern, {"--frames", "1-3", "--skip-existing", "--json"}));
    REQUIRE_MESSAGE(report.exit == 0, report.err);
    const auto json = nlohmann::json::parse(report.out);
    CHECK(json.at("schema") == "fraja.film/1");
    REQUIRE(json.at("frames").size() == 3);
    CHECK(json.at("frames")[0].at("state") == "done");
    CHECK(json.at("frames")[0].at("output") == scratch.file("01.png"));
    CHECK(json.at("frames")[1].at("state") == "skipped");
    CHECK(json.at("frames")[2].at("frame") == 3);
    CHECK(bytes_of(scratch.file("02.png")) == "mine");
    const auto shown = run({{program("fraja-ctl"), "-b", farm.endpoint(), "show", "--json",
                             json.at("frames")[2].at("job").get<std::string>()}},
                           patience);
    REQUIRE(shown.has_value());
    const auto job = nlohmann::json::parse(shown->out);
    CHECK(job.at("film") == json.at("film"));
    CHECK(job.at("frame") == 3);
    CHECK(job.at("name") == "cone-0003");

    const auto nothing =
        farm.submit(film(pattern, {"--frames", "1-3", "--skip-existing", "--json"}));
    CHECK(nothing.exit == 0);
    const auto skipped = nlohmann::json::parse(nothing.out);
    for (const auto& frame : skipped.at("frames")) {
        CHECK(frame.at("state") == "skipped");
        CHECK_FALSE(frame.contains("job")); // nothing was submitted
    }
    CHECK(farm.submit(film(pattern, {"--frames", "2"})).exit == 0);
    CHECK(bytes_of(scratch.file("02.png")) != "mine");
}

TEST_CASE("a frame that cannot be written is told, and the others go on") {
    const Scratch scratch;
    fs::create_directories(scratch.file("1"));
    fs::create_directories(scratch.file("3"));
    const auto drawn =
        submit(film(scratch.file("%d/x.png"), {"--frames", "1-3", "--local", "-j", "1"}));
    CHECK(drawn.exit == 1);
    CHECK(drawn.err.find("frame 2: ") != std::string::npos);
    CHECK(fs::exists(scratch.file("1/x.png")));
    CHECK(fs::exists(scratch.file("3/x.png")));
}

/// The cameras of six films in one.
std::string six_rounds(const Scratch& scratch) {
    const std::string round = bytes_of(travel);
    const std::size_t begin = round.find('[') + 1;
    const std::string cameras = round.substr(begin, round.rfind(']') - begin);
    std::string path = scratch.file("rounds.raj");
    std::ofstream(path) << '[' << cameras << ',' << cameras << ',' << cameras << ',' << cameras
                        << ',' << cameras << ',' << cameras << ']';
    return path;
}

TEST_CASE("a film whose frames find no room on the disk begins no more, and says how to go on") {
    const Scratch scratch;
    const Words words{program("fraja-submit"), scene("cone"), "--travel",
                      six_rounds(scratch),     "-r",          "64x48",
                      "--skip-existing",       "-o",          scratch.file("%d.png")};
    for (const int there : {1, 3, 4, 5}) // between them and the end
        std::ofstream(scratch.file(std::to_string(there) + ".png")) << "there";
    // To it a limit on the size of files is a disk that is full.
    const Words full{"env", "--ignore-signal=XFSZ", "prlimit", "--fsize=10"};
    const auto drawn = run({with(with(full, words), {"--local", "-j", "1"})}, patience);
    REQUIRE(drawn.has_value());
    INFO(drawn->err);
    CHECK(drawn->exit == 1);
    // Which frame is drawn first is a matter of threads: one that was to be written, with its file.
    const std::size_t told = drawn->err.find("error: frame ");
    REQUIRE(told != std::string::npos);
    const auto number = std::strtol(drawn->err.c_str() + told + 13, nullptr, 10);
    const std::string frame = std::to_string(number);
    CHECK((number == 2 || (number > 5 && number <= 72)));
    CHECK(contains(drawn->err, "error: frame " + frame + ": " + scratch.file(frame + ".png") +
                                   ": File too large; no more frames are begun\n"));
    CHECK(drawn->err.rfind("error: frame ") == drawn->err.find("error: frame ")); // once for all
    CHECK(contains(drawn->err, " of 68 frames could not be written, "));
    CHECK(contains(drawn->err, " not begun. Once they can, the same command with --skip-existing "
                               "goes on"));
    CHECK_FALSE(contains(drawn->err, "not drawn"));
    CHECK_FALSE(contains(drawn->err, "wrote"));

    Farm farm;
    farm.add_worker("one", {"-j", "2"});
    const auto there =
        run({with(with(full, words), {"-b", farm.endpoint(), "--frames", "1-2"})}, patience);
    REQUIRE(there.has_value());
    INFO(there->err);
    CHECK(there->exit == 1);
    CHECK(contains(there->err, "error: 1 of 1 frame could not be written. Once they can, the same "
                               "command with --skip-existing --resume goes on"));
    const auto taken_over = run(
        {with(words, {"-b", farm.endpoint(), "--frames", "1-2", "--resume", "--progress", "json"})},
        patience);
    REQUIRE(taken_over.has_value());
    INFO(taken_over->err);
    CHECK(taken_over->exit == 0);
    CHECK(contains(taken_over->err, "wrote " + scratch.file("2.png")));
    std::istringstream lines(taken_over->err);
    for (std::string line; std::getline(lines, line);)
        if (contains(line, "fraja.film_progress/1")) // nothing was drawn anew
            CHECK(nlohmann::json::parse(line).at("rays_per_s") == 0);
}

TEST_CASE("what is wrong with a film is said before anything is submitted, with the cure") {
    const Scratch scratch;
    std::ofstream(scratch.file("broken.raj"))
        << "[\n  raja.renderer.HorizontalCamera { focl = 1 }\n]\n";
    struct Row {
        Words words;
        std::string says;
    };
    const std::string good = scratch.file("%d.png");
    for (const Row& row : {
             Row{{"--travel", scratch.file("broken.raj"), "-o", good},
                 "broken.raj:2:36: raja.renderer.HorizontalCamera has no field 'focl' (did you "
                 "mean 'focal'?)"},
             Row{{"--travel", scratch.file("none.raj"), "-o", good}, "there is no such file"},
             Row{{"--travel", travel, "-o", good, "--frames", "5-13"},
                 "has 12 cameras, so there is no frame 13"},
             Row{{"--travel", travel, "-o", good, "--frames", "5-1"}, "written as A-B or A-BxS"},
             Row{{"--travel", travel, "-o", scratch.file("x.png")}, "as in cone%04d.png"},
             Row{{"--travel", travel, "-o", scratch.file("%d%d.png")}, "as in cone%04d.png"},
             Row{{"--travel", travel}, "-o cone%04d.png"},
             Row{{"-o", good}, "give --travel FILE"},
             Row{{"--frames", "1-2"}, "--travel FILE"},
             Row{{"--travel", travel, "-o", good, "--time-limit", "9s"}, "not with --travel"},
             Row{{"--travel", travel, "-o", good, "--schedule", "static"}, "on demand"},
         }) {
        CAPTURE(row.says);
        Words words{scene("cone"), "--local"};
        words.insert(words.end(), row.words.begin(), row.words.end());
        const auto result = submit(words);
        CHECK(result.exit == 2);
        CHECK_MESSAGE(result.err.find(row.says) != std::string::npos, result.err);
    }
    CHECK_FALSE(fs::exists(scratch.file("1.png")));
}

TEST_CASE("a film that is left goes on with what was begun, and is taken over") {
    const Scratch scratch;
    Farm farm; // nobody draws yet
    const Words words = film(scratch.file("%d.png"), {"--frames", "1-3", "--progress", "json"});
    Process left = farm.start_submit(words);
    // It looks around for as long as it lives, and says something as long as something changes.
    const auto first = left.wait_for_words(Process::Stream::err, "film_progress", patience);
    REQUIRE_MESSAGE(first.has_value(), left.story());
    const auto progress = nlohmann::json::parse(*first);
    CHECK(progress.at("schema") == "fraja.film_progress/1");
    CHECK(progress.at("film").get<std::string>().size() == 36);
    CHECK(progress.at("frames") == 3);
    CHECK(progress.at("frames_done") == 0);
    CHECK(progress.at("share_done") == 0.0);
    for (const char* name : {"cone-0001", "cone-0002"})
        (void)wait_for_frame_job(farm, name);
    const std::string third = wait_for_frame_job(farm, "cone-0003");
    left.send(SIGINT);
    CHECK(left.wait_for_exit(patience) == 128 + SIGINT);
    INFO(left.story());
    CHECK(left.err().find("of 3 frames 0 written, 0 not begun") != std::string::npos);
    CHECK(left.err().find("--skip-existing --resume") != std::string::npos);
    CHECK(left.err().find("going on:     3 frames") != std::string::npos);

    const auto timed_out = farm.submit(
        film(scratch.file("%d.png"), {"--frames", "2", "--resume", "--timeout", "300ms"}));
    CHECK(timed_out.exit == 124);
    CHECK(timed_out.err.find("the time is up; of 1 frame 0 written") != std::string::npos);

    farm.add_worker("one", {"-j", "2"});
    const auto taken_over = farm.submit(with(words, {"--resume", "--skip-existing"}));
    REQUIRE_MESSAGE(taken_over.exit == 0, taken_over.err);
    CHECK(
        taken_over.err.find(R"("frames_done":3,"frames":3,"frames_at_hand":0,"share_done":1.0)") !=
        std::string::npos);
    for (const char* name : {"1.png", "2.png", "3.png"})
        CHECK(fs::exists(scratch.file(name)));
    CHECK(frame_job(farm, "cone-0003") == third); // no second one of it
}

TEST_CASE("a film's frame that is cancelled is told, and the others are written") {
    const Scratch scratch;
    Farm farm; // nobody draws yet
    Process drawn = farm.start_submit(film(scratch.file("%d.png"), {"--frames", "1-3"}));
    const std::string id = wait_for_frame_job(farm, "cone-0002");
    const auto cancelled =
        run({{program("fraja-ctl"), "-b", farm.endpoint(), "cancel", "--yes", id}}, patience);
    REQUIRE(cancelled.has_value());
    CHECK(cancelled->exit == 0);
    farm.add_worker("one", {"-j", "2"});
    CHECK(drawn.wait_for_exit(patience) == 5);
    INFO(drawn.story());
    CHECK(drawn.err().find("frame 2: ") != std::string::npos);
    CHECK(drawn.err().find("error: 1 of 3 frames not drawn") != std::string::npos);
    CHECK(fs::exists(scratch.file("1.png")));
    CHECK_FALSE(fs::exists(scratch.file("2.png")));
    CHECK(fs::exists(scratch.file("3.png")));
}

TEST_CASE("a film outlives its broker, also where a frame is begun without one") {
    const Scratch scratch;
    const Words limits{"--heartbeat", heartbeat_option, "--state", scratch.file("state")};
    Farm farm(limits); // nobody draws yet
    Process drawn =
        farm.start_submit({scene("cone"), "--travel", six_rounds(scratch), "--frames", "1-65", "-r",
                           "32x24", "-o", scratch.file("%d.png"), "--connect-timeout", "2s"});
    const std::string first = wait_for_frame_job(farm, "cone-0001");
    (void)wait_for_frame_job(farm, "cone-0064"); // so many at a time
    // It hears that its first frame is over, and begins another, when the broker is gone.
    drawn.send(SIGSTOP);
    const auto cancelled =
        run({{program("fraja-ctl"), "-b", farm.endpoint(), "cancel", "--yes", first}}, patience);
    REQUIRE(cancelled.has_value());
    REQUIRE(cancelled->exit == 0);
    // Another answer: what it had said before that is on its way.
    REQUIRE(run({{program("fraja-ctl"), "-b", farm.endpoint(), "jobs"}}, patience).has_value());
    farm.broker().send(SIGKILL);
    REQUIRE(farm.broker().wait_for_exit(patience).has_value());
    drawn.send(SIGCONT);
    const auto said = [&](std::string_view words) {
        return drawn.wait_for_words(Process::Stream::err, words, patience);
    };
    REQUIRE_MESSAGE(said("frame 1: "), drawn.story());
    REQUIRE_MESSAGE(said("lost the broker"), drawn.story());
    CHECK_FALSE(drawn.wait_for_exit(3s).has_value()); // longer than --connect-timeout
    farm.start_broker_again();
    farm.add_worker("one", {"-j", "2"});
    CHECK(drawn.wait_for_exit(patience) == 5);
    INFO(drawn.story());
    CHECK(contains(drawn.err(), "found the broker"));
    CHECK(contains(drawn.err(), "error: 1 of 65 frames not drawn"));
    CHECK_FALSE(fs::exists(scratch.file("1.png")));
    for (int frame = 2; frame <= 65; ++frame)
        CHECK(fs::exists(scratch.file(std::to_string(frame) + ".png")));
}

TEST_CASE("a film without a broker ends with 3 and says so once") {
    const Scratch scratch;
    const auto result = submit(
        film(scratch.file("%d.png"), {"-b", "tcp://127.0.0.1:9", "--connect-timeout", "500ms"}));
    CHECK(result.exit == 3);
    CHECK(result.err.find("frame ") == result.err.rfind("frame "));
}

} // namespace
} // namespace fraja::e2e
