#include "client/console.hpp"
#include "client/json.hpp"
#include "client/picture.hpp"
#include "client/settings_text.hpp"
#include "client/submit_options.hpp"
#include "client/table.hpp"
#include "common/service/json_line.hpp"
#include "tests/client/written.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <doctest/doctest.h>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <unistd.h>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;
using Json = nlohmann::json;

namespace {

protocol::TileDone tile() {
    protocol::TileDone done;
    done.job = JobId{{1, 2}};
    done.rect = {128, 64, 2, 1};
    done.worker_name = "ada";
    done.rays = {1, 2, 3, 4};
    done.elapsed = 250ms;
    return done;
}

protocol::JobState job() {
    protocol::JobState state;
    state.job = JobId{{1, 2}};
    state.number = 17;
    state.job_name = "cone";
    state.phase = protocol::JobPhase::running;
    state.cell_count = 200;
    state.done_count = 126;
    state.share_done = 0.63;
    state.in_flight_count = 8;
    state.rays = {10, 20, 30, 40, 50, 60, 70, 80, 0};
    state.elapsed = 1500ms;
    return state;
}

std::string attribute_of(const protocol::JobState& state, const char* name) {
    const auto attributes = picture_attributes(state);
    const auto found = std::ranges::find(attributes, name, &PictureAttribute::name);
    return found == attributes.end() ? "missing" : found->value;
}

} // namespace

TEST_CASE("a file tells the frame that it is, and how much is missing while it is not done") {
    protocol::JobState state = job();
    CHECK(attribute_of(state, "fraja:unfinished") == "0.6300 of it");
    CHECK(attribute_of(state, "fraja:frame") == "missing");
    state.phase = protocol::JobPhase::done;
    state.film.bytes[0] = 1;
    state.frame = 7;
    CHECK(attribute_of(state, "fraja:unfinished") == "missing");
    CHECK(attribute_of(state, "fraja:frame") == "7");
    const auto attributes = picture_attributes(state, " --frames 7-7");
    const auto options =
        std::ranges::find(attributes, std::string("fraja:options"), &PictureAttribute::name);
    REQUIRE(options != attributes.end());
    CHECK(options->value.ends_with(" --frames 7-7"));
}

TEST_CASE("a tile's JSON has the fields of the manual and no other") {
    CHECK(tile_json(tile()) ==
          R"({"schema":"fraja.tile/1","job":"01020000-0000-0000-0000-000000000000","frame":0,)"
          R"("x":128,"y":64,"w":2,"h":1,"worker":"ada","elapsed_s":0.25,"rays":10,"pass":0})");
}

TEST_CASE("names from others cannot break the JSON") {
    auto t = tile();
    t.worker_name = "\"\n\xff\x1b[2J";
    const Json json = Json::parse(tile_json(t));
    CHECK(json["worker"].get<std::string>().starts_with("\"\n"));
    CHECK(tile_json(t).find('\n') == std::string::npos);
    CHECK(tile_json(t).find('\x1b') == std::string::npos);
}

TEST_CASE("a job's JSON says its state, counts, rays and times") {
    const Json json = Json::parse(job_json(job()));
    CHECK(json["schema"] == "fraja.job/1");
    CHECK(json["number"] == 17);
    CHECK(json["state"] == "running");
    CHECK_FALSE(json.contains("reason"));
    CHECK(json["done_count"] == 126);
    CHECK(json["rays"]["traced"] == 60);
    CHECK(json["rays"]["total"] == 100);
    CHECK(json["elapsed_s"] == 1.5);
    auto failed = job();
    failed.phase = protocol::JobPhase::failed;
    failed.reason = "why";
    CHECK(Json::parse(job_json(failed))["reason"] == "why");
}

TEST_CASE("the JSON of jobs and workers says what the rays cost") {
    protocol::WorkerState worker;
    worker.rays = job().rays;
    worker.rays.truncated_pixels = 9;
    SubmissionReport report;
    report.job = job();
    report.job.rays = worker.rays;
    for (const std::string& text :
         {submit_json(report), worker_json(worker), job_json(report.job)}) {
        const Json json = Json::parse(text);
        CHECK(json["rays"] == Json{{"primary", 10},
                                   {"camera", 10},
                                   {"reflected", 20},
                                   {"refracted", 30},
                                   {"shadow", 40},
                                   {"traced", 60},
                                   {"total", 100}});
        CHECK(json["tests"] == Json{{"box", 50}, {"form", 60}});
        CHECK(json["shaded"] == 70);
        CHECK(json["pixels"] == Json{{"skipped", 80}, {"truncated", 9}});
    }
}

TEST_CASE("the counts of a job are lines of plain words, and a truncated pixel a sentence") {
    const std::string page = counts_page(job());
    CHECK(page.starts_with("rays camera       10\nrays reflected    20\n"));
    CHECK(page.find("\ntests form        60 (rays tested against a surface)\n") !=
          std::string::npos);
    CHECK(page.ends_with("\npixels truncated  0\n"));
    auto cut_short = job();
    cut_short.rays.truncated_pixels = 9;
    CHECK(counts_page(cut_short).find("\nIn 9 pixels a sample ran out of its budget of rays") !=
          std::string::npos);
    auto plain = job();
    plain.settings.kernel = protocol::KernelChoice::reference;
    CHECK(counts_page(plain).ends_with("\nrays total        100\n")); // it counts nothing else
}

TEST_CASE("a job whose tiles are to be checked says what has come of that, also when nothing has") {
    using Checks = protocol::CheckCounts;
    using enum protocol::JobPhase;
    struct Row {
        double verify;
        Checks checks;
        protocol::JobPhase phase;
        const char *page, *counts;
    };
    for (const Row& row : {
             Row{0, {}, done, "", ""},
             Row{0.1,
                 {},
                 done,
                 "checked   0 tiles (--verify 0.1: none was picked)\n",
                 "tiles checked     0 (--verify 0.1: none was picked)\ntiles unchecked   0\n"},
             Row{0.1,
                 {},
                 running,
                 "checked   0 tiles (--verify 0.1: none so far)\n",
                 "tiles checked     0 (--verify 0.1: none so far)\ntiles unchecked   0\n"},
             Row{0.1,
                 {7, 0},
                 done,
                 "checked   7 tiles\n",
                 "tiles checked     7 (drawn by two workers, the same)\ntiles unchecked   0\n"},
             Row{0.1,
                 {1, 2},
                 done,
                 "checked   1 tile; 2 had no second worker\n",
                 "tiles checked     1 (drawn by two workers, the same)\n"
                 "tiles unchecked   2 (there was no second worker)\n"},
         }) {
        auto state = job();
        state.verify = row.verify;
        state.checks = row.checks;
        state.phase = row.phase;
        CAPTURE(row.counts);
        const std::string page = job_page(state);
        CHECK((page.find("\nchecked ") != std::string::npos) == (*row.page != 0));
        CHECK(page.find(row.page) != std::string::npos);
        CHECK(counts_page(state).starts_with(std::string(row.counts) + "rays camera"));
        CHECK(Json::parse(job_json(state)).at("verify") == row.verify);
    }
}

TEST_CASE("a job's page and JSON and its picture name its kernel") {
    for (const auto& [kernel, name] : {std::pair{protocol::KernelChoice::fast, "fast"},
                                       std::pair{protocol::KernelChoice::reference, "reference"}}) {
        auto state = job();
        state.settings.kernel = kernel;
        CHECK(job_page(state).find(std::string(", kernel ") + name + "\n") != std::string::npos);
        CHECK(Json::parse(job_json(state))["settings"]["kernel"] == name);
        CHECK(attribute_of(state, "fraja:kernel") == name);
    }
}

TEST_CASE("a submission's JSON has its job only when there was one") {
    SubmissionReport report;
    report.state = "dry_run";
    Json json = Json::parse(submit_json(report));
    CHECK(json["schema"] == "fraja.submit/1");
    CHECK(json["exit_code"] == 0);
    CHECK_FALSE(json.contains("job"));
    CHECK_FALSE(json.contains("output"));
    CHECK(json["started"] == "1970-01-01T00:00:00.000Z");
    report.job = job();
    report.output = "cone.png";
    report.outcome = {ExitCode::job_failed, "why"};
    report.processor_time = 250ms;
    json = Json::parse(submit_json(report));
    CHECK(json["processor_s"] == 0.25);
    CHECK(json["job"] == "01020000-0000-0000-0000-000000000000");
    CHECK(json["output"] == "cone.png");
    CHECK(json["exit_code"] == 1);
    CHECK(json["reason"] == "why");
}

TEST_CASE("of several brokers JSON says how many of the others keep the job, of one it does not") {
    SubmissionReport report;
    report.state = "accepted";
    report.job = job();
    FilmReport film;
    film.frames = {{.number = 1, .state = "done", .reason = {}, .output = {}, .job = job()}};
    const auto objects = [&] {
        return std::array{Json::parse(submit_json(report)),
                          Json::parse(film_json(film)).at("frames").at(0),
                          Json::parse(job_json(report.job))};
    };
    for (const Json& json : objects()) {
        CHECK_FALSE(json.contains("copies"));
        CHECK_FALSE(json.contains("copies_wanted"));
    }
    report.job.copies_wanted = film.frames[0].job.copies_wanted = 2;
    report.job.copies = film.frames[0].job.copies = 1;
    for (const Json& json : objects()) {
        CHECK(json.at("copies") == 1);
        CHECK(json.at("copies_wanted") == 2);
    }
}

TEST_CASE("a dry run's JSON has the broker that would be asked, or none, and others have no such") {
    SubmissionReport report;
    report.state = "dry_run";
    CHECK_FALSE(Json::parse(submit_json(report)).contains("broker"));
    report.broker = "";
    CHECK(Json::parse(submit_json(report)).at("broker").is_null());
    report.broker = "tcp://a:1, tcp://b:1";
    CHECK(Json::parse(submit_json(report)).at("broker") == "tcp://a:1, tcp://b:1");
}

TEST_CASE("times are RFC 3339 in UTC") {
    CHECK(service::rfc3339(std::chrono::system_clock::time_point(1'700'000'000'123ms)) ==
          "2023-11-14T22:13:20.123Z");
}

TEST_CASE("tables have columns, and words where there is nothing") {
    CHECK(jobs_table({}) == "no jobs\n");
    CHECK(workers_table({}) == "no workers\n");
    const std::string table = jobs_table({job()});
    CHECK(table.starts_with("JOB  NAME  STATE    DONE  IN FLIGHT"));
    CHECK(table.find("#17  cone  running   63%          8") != std::string::npos);
    protocol::WorkerState ada, bob;
    ada.worker_name = "ada";
    bob.worker_name = "bob\x1b[2J";
    const std::string workers = workers_table({bob, ada});
    CHECK(workers.find("ada") < workers.find("bob?[2J"));
}

TEST_CASE("why a broker does not answer is told whole, and widens no column") {
    const std::string why = "not reached from here: that host is not there, or a firewall is in "
                            "between";
    protocol::FarmState farm;
    farm.broker.program_version = "0.1.0";
    const std::string table =
        brokers_table({{"tcp://127.0.0.1:1", std::nullopt, why}, {"tcp://b:1", farm, ""}});
    CHECK(table.find("tcp://127.0.0.1:1  " + why + "\n") != std::string::npos);
    CHECK(table.find("tcp://b:1          alone  0.1.0 ") != std::string::npos);
}

TEST_CASE("of several brokers it is told who leads, who stands by, and who is missed") {
    const protocol::PeerState own{.broker = {}, .endpoint = "tcp://a:1", .program_version = "1"};
    struct Row {
        bool leads, is_synced, other_is_here;
        const char* state;
    };
    for (const Row& row : {Row{true, true, true, "leads "}, Row{false, true, true, "stands by "},
                           Row{false, false, true, "fetches what the others have "},
                           Row{true, true, false, "leads, misses 1 other broker "}}) {
        CAPTURE(row.state);
        protocol::FarmState farm;
        farm.brokers = {own, own};
        farm.brokers[0].is_here = true;
        farm.brokers[0].leads = row.leads;
        farm.brokers[0].is_synced = row.is_synced;
        farm.brokers[1].is_here = row.other_is_here;
        CHECK(brokers_table({{"tcp://a:1", farm, ""}}).find(row.state) != std::string::npos);
        CHECK(broker_json({"tcp://a:1", farm, ""})
                  .find(row.leads ? "\"leads\":true" : "\"leads\":false") != std::string::npos);
    }
}

TEST_CASE("a broker's JSON has the other endpoints that lead to it, where there are") {
    const protocol::FarmState farm;
    CHECK_FALSE(Json::parse(broker_json({"tcp://a:1", farm, ""})).contains("also_at"));
    CHECK(Json::parse(broker_json({"tcp://a:1", farm, "", {"tcp://b:1"}})).at("also_at") ==
          Json{"tcp://b:1"});
}

TEST_CASE("a tile's line has its place, size, worker, time and rays") {
    CHECK(tile_line(tile()) ==
          "     128,64  2x1        ada                   0.250 s          10 rays");
}

TEST_CASE("a console speaks by level, without colour or returns off a terminal") {
    Written w({"prog", LogLevel::warning, false, service::ColorChoice::automatic});
    w.console.debug("no");
    w.console.info("no");
    w.console.warning("careful");
    w.console.error("bad");
    w.console.located_warning("a.raj:1:2: hm");
    CHECK(w.text() == "prog: warning: careful\nprog: error: bad\nwarning: a.raj:1:2: hm\n");
    Written coloured({"prog", LogLevel::info, false, service::ColorChoice::always});
    coloured.console.error("bad");
    CHECK(coloured.text() == "prog: \x1b[1;31merror: \x1b[0mbad\n");
}

TEST_CASE("a message goes above the line that is redrawn") {
    Written w({"prog", LogLevel::info, false, service::ColorChoice::never});
    w.console.redraw("50%");
    w.console.info("hello");
    w.console.redraw("60%");
    w.console.end_redraw();
    CHECK(w.text() == "\r\x1b[K50%\r\x1b[Kprog: hello\n\r\x1b[K50%\r\x1b[K60%\n");
}

TEST_CASE("a picture stands above the line that is redrawn, and messages above both") {
    Written w({"prog"});
    w.console.redraw("63%");
    w.console.show({"PICTURE", 3, "GONE"});
    const std::string drawn = "\r\n\n\n\x1b[3A\x1b"
                              "7PICTURE\x1b"
                              "8\x1b[3B\r\x1b[K63%";
    const std::string begin = "\x1b[?2026h", end = "\x1b[?2026l";
    std::string want = "\r\x1b[K63%" + begin + drawn + end;
    CHECK(w.text() == want);
    w.console.info("news");
    want += begin + "\r\x1b[3AGONE\x1b[Jprog: news\n" + drawn + end;
    CHECK(w.text() == want);
    w.console.show({"PICTURE", 3, "GONE"}); // in its own place
    want += begin + "\r\x1b[3A" + drawn + end;
    CHECK(w.text() == want);
    w.console.end_redraw();
    w.console.info("bye");
    CHECK(w.text() == want + "\nprog: bye\n");
}

TEST_CASE("a picture puts tiles together, wherever their bytes were cut") {
    protocol::PictureSettings settings;
    settings.size = {8, 4};
    settings.crop = {2, 1, 4, 2};
    Picture picture(settings);
    const std::vector<float> rgb = {0, 0.25f, 0.5f, 1, 2, 3};
    Bytes bytes(sizeof(float) * rgb.size());
    std::memcpy(bytes.data(), rgb.data(), bytes.size());
    for (std::ptrdiff_t cut = 0; cut <= static_cast<std::ptrdiff_t>(bytes.size()); ++cut) {
        protocol::TileDone t;
        t.rect = {3, 2, 2, 1};
        t.blobs = {Blob(Bytes(bytes.begin(), bytes.begin() + cut)),
                   Blob(Bytes(bytes.begin() + cut, bytes.end()))};
        picture.place(t, 1);
        const auto row = picture.film().pixels().subspan(3 * (4 + 1), 6);
        CHECK(std::equal(row.begin(), row.end(), rgb.begin()));
    }
}

/// One float for each of a picture's pixels and channels, as they travel: rgb, samples, errors.
Bytes travelling(const std::vector<float>& floats) {
    Bytes bytes(sizeof(float) * floats.size());
    std::memcpy(bytes.data(), floats.data(), bytes.size());
    return bytes;
}

/// Of 2 x 2 pixels in the middle of a larger picture.
protocol::PictureSettings adaptive_settings() {
    protocol::PictureSettings settings;
    settings.size = {8, 4};
    settings.crop = {2, 1, 2, 2};
    settings.error = 2;
    return settings;
}

TEST_CASE("an adaptive picture has its pixels' samples and errors, wherever their bytes were cut") {
    const Bytes bytes = travelling({1, 2, 3, 4, 5, 6, 16, 4, 0.25f, 0.5f});
    for (std::ptrdiff_t cut = 0; cut <= static_cast<std::ptrdiff_t>(bytes.size()); ++cut) {
        Picture picture(adaptive_settings());
        protocol::TileDone t;
        t.rect = {2, 2, 2, 1};
        t.blobs = {Blob(Bytes(bytes.begin(), bytes.begin() + cut)),
                   Blob(Bytes(bytes.begin() + cut, bytes.end()))};
        picture.place(t, 1);
        const Film& film = picture.film();
        CHECK(std::ranges::equal(film.pixels().subspan(6),
                                 std::vector{1.f, 2.f, 3.f, 4.f, 5.f, 6.f}));
        CHECK(std::ranges::equal(film.samples(), std::vector{0.f, 0.f, 16.f, 4.f}));
        CHECK(std::ranges::equal(film.error(), std::vector{0.f, 0.f, 0.25f, 0.5f}));
    }
}

TEST_CASE("what is thought of a picture is known when it is whole") {
    Picture picture(adaptive_settings());
    CHECK_FALSE(picture.estimate().has_value());
    protocol::TileDone t;
    t.rect = {2, 1, 2, 1};
    t.blobs = {Blob(travelling({0, 0, 0, 0, 0, 0, 4, 16, 0.5f, 0.5f}))};
    picture.place(t, 1);
    CHECK(picture.pixels_placed() == 2);
    CHECK_FALSE(picture.estimate().has_value());
    t.rect = {2, 2, 2, 1};
    t.blobs = {Blob(travelling({0, 0, 0, 0, 0, 0, 64, 4, 0.7f, 0.1f}))};
    picture.place(t, 1);
    REQUIRE(picture.estimate().has_value());
    CHECK(picture.estimate()->samples == 22);
    CHECK(picture.estimate()->rms_error == doctest::Approx(0.5)); // not the mean, 0.45
    CHECK(picture.estimate()->pixels_at_ceiling == 0);
}

TEST_CASE("pixels that may have no more samples and are not as good as was asked for are counted") {
    auto settings = adaptive_settings();
    settings.error = 51, settings.max_samples = 100; // 0.2; as many as 64, the power of two below
    Picture picture(settings);
    protocol::TileDone t;
    t.rect = settings.crop;
    t.blobs = {Blob(
        travelling({0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 64, 64, 32, 64, 0.3f, 0.1f, 0.3f, 0.21f}))};
    picture.place(t, 1);
    REQUIRE(picture.estimate().has_value());
    CHECK(picture.estimate()->pixels_at_ceiling == 2);
}

TEST_CASE("nothing is thought of a regular grid, nor of three samples") {
    auto settings = adaptive_settings();
    settings.error = 0, settings.aa = 8;
    Picture picture(settings);
    protocol::TileDone t;
    t.rect = settings.crop;
    t.blobs = {Blob(Bytes(48))};
    picture.place(t, 1);
    CHECK(picture.pixels_placed() == 4);
    CHECK_FALSE(picture.estimate().has_value());
    CHECK(picture.film().samples().empty());
}

TEST_CASE("a picture with a time limit is black until there is a tile of it") {
    auto settings = adaptive_settings();
    settings.error = 0, settings.time_limit = std::chrono::seconds(1);
    const Picture picture(settings);
    CHECK(picture.film().region() == settings.crop);
    CHECK(std::ranges::max(picture.film().pixels()) == 0);
}

TEST_CASE("a picture says all of how it was sampled") {
    auto state = job();
    auto& settings = state.settings;
    settings = adaptive_settings();
    settings.error = 0.5, settings.max_samples = 99, settings.filter = protocol::PixelFilter::tent;
    const auto value = [&](const char* name) { return attribute_of(state, name); };
    CHECK(value("fraja:error") == "0.5");
    CHECK(value("fraja:max_samples") == "99");
    CHECK(value("fraja:filter") == "tent");
    CHECK(value("fraja:spp") == "0");
    CHECK(value("Software").starts_with("Fraja 0."));
    CHECK(value("Software").find("x86") == std::string::npos); // the kernel's is its workers'
    CHECK(settings_text(settings) ==
          "depth 5, error 0.5 with at most 99 samples, filter tent, kernel fast");
    settings.error = 0, settings.spp = 16, settings.filter = protocol::PixelFilter::box;
    CHECK(settings_text(settings) == "depth 5, spp 16, kernel fast");
}

TEST_CASE("a picture tells the options that make it again, whatever its settings") {
    unsetenv("SOURCE_DATE_EPOCH");
    for (const char* options :
         {"-r 256x192 -d 5", "-r 640x480 -d 9 --crop 1,2,30,40 -a 4 --kernel reference --exact",
          "-r 256x192 -d 5 --spp 16 --filter tent --layers",
          "-r 256x192 -d 5 --error 0.5 --max-samples 99",
          "-r 256x192 -d 5 --time-limit 1.5s --max-samples 1024"}) {
        std::vector<std::string> words;
        std::istringstream text(options);
        for (std::string word; text >> word;)
            words.push_back(word);
        words.insert(words.end(), {"a.raj", "-o", "a.exr"});
        const auto parsed = parse_submit_options(words);
        const auto* submit = std::get_if<SubmitOptions>(&parsed);
        REQUIRE(submit != nullptr);
        auto state = job();
        state.settings = submit->settings;
        CHECK(attribute_of(state, "fraja:options") == options);
    }
}

TEST_CASE("a picture tells what it took, unless two renders are to give the same file") {
    const auto state = job();
    unsetenv("SOURCE_DATE_EPOCH");
    CHECK(attribute_of(state, "fraja:rays_camera") == std::to_string(state.rays.camera));
    CHECK(attribute_of(state, "fraja:job") == to_string(state.job));
    CHECK(attribute_of(state, "DateTime").size() == std::string("2026:11:27 16:30:00").size());
    setenv("SOURCE_DATE_EPOCH", "0", 1);
    CHECK(attribute_of(state, "fraja:rays_camera") == "missing");
    CHECK(attribute_of(state, "DateTime") == "missing");
    CHECK(attribute_of(state, "fraja:scene") == to_string(state.scene));
    unsetenv("SOURCE_DATE_EPOCH");
}

TEST_CASE("messages may be objects, whatever they say") {
    Written written({"fraja-test", LogLevel::info, true, service::ColorChoice::automatic});
    written.console.warning("line one\nline \xff two");
    written.console.located_error("a.raj:1:2: no such \"thing\"");
    written.console.debug("not told");
    std::istringstream lines(written.text());
    std::string line;
    REQUIRE(std::getline(lines, line));
    CHECK(Json::parse(line)["level"] == "warning");
    CHECK(Json::parse(line)["program"] == "fraja-test");
    REQUIRE(std::getline(lines, line));
    CHECK(Json::parse(line)["message"] == "a.raj:1:2: no such \"thing\"");
    CHECK(Json::parse(line)["level"] == "error");
}

TEST_CASE("messages that cannot be written are lost, and no more than that") {
    std::FILE* const full = std::fopen("/dev/full", "w");
    REQUIRE(full != nullptr);
    {
        Console console({"fraja-test"}, full);
        console.error("nobody hears this");
        console.redraw("nor this");
        console.line("nor this");
    }
    std::fclose(full);
}

TEST_CASE("a picture file is written when something came, and not too often") {
    const auto path =
        std::filesystem::temp_directory_path() / ("live-" + std::to_string(getpid()) + ".png");
    std::filesystem::remove(path);
    auto state = job();
    state.settings.size = {2, 1};
    state.settings.crop = {0, 0, 2, 1};
    Picture picture(state.settings);
    PictureFile live;
    live.begin(state, path);
    REQUIRE(live.finish(picture));
    CHECK_FALSE(std::filesystem::exists(path)); // there is nothing yet
    protocol::TileDone t;
    t.rect = {0, 0, 1, 1};
    t.blobs = {Blob(Bytes(12))};
    picture.place(t, 1);
    live.note_change();
    REQUIRE(*live.tick(Instant{} + 1s, picture) == Instant::never());
    CHECK(std::filesystem::exists(path));
    std::filesystem::remove(path);
    picture.place(t, 1);
    live.note_change();
    CHECK(*live.tick(Instant{} + 1400ms, picture) > Instant{} + 1499ms);
    CHECK_FALSE(std::filesystem::exists(path));
    REQUIRE(live.finish(picture));
    CHECK(std::filesystem::exists(path));
    std::filesystem::remove(path);
}
