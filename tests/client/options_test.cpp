#include "client/ctl_options.hpp"
#include "client/submit_options.hpp"
#include "client/watch_options.hpp"
#include "common/base/version.hpp"

#include <cstdlib>
#include <doctest/doctest.h>
#include <sstream>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

std::vector<std::string> words(const std::string& line) {
    std::istringstream stream(line);
    std::vector<std::string> result;
    for (std::string word; stream >> word;)
        result.push_back(word);
    return result;
}

/// A variable of the environment, for the length of a test.
class Variable {
public:
    Variable(const char* name, const char* value) : name_(name) { setenv(name, value, 1); }
    ~Variable() { unsetenv(name_); }
    Variable(const Variable&) = delete;
    Variable& operator=(const Variable&) = delete;

private:
    const char* name_;
};

SubmitOptions submit(const std::string& line) {
    auto parsed = parse_submit_options(words(line));
    INFO(line);
    if (const auto* early = std::get_if<EarlyExit>(&parsed))
        FAIL(early->text);
    return std::get<SubmitOptions>(parsed);
}

std::string many_sources(int count) {
    std::string all = "auto";
    for (int i = 1; i < count; ++i)
        all += ",srv:farm" + std::to_string(i);
    return all;
}

} // namespace

TEST_CASE("fraja-submit's defaults are Raja's") {
    const SubmitOptions o = submit("scenes/cone.raj");
    CHECK(o.scene_file == "scenes/cone.raj");
    CHECK(o.output == "cone.png");
    CHECK(o.job_name == "cone");
    CHECK(o.settings == protocol::PictureSettings{});
    CHECK(o.settings.kernel == protocol::KernelChoice::fast);
    CHECK(o.tile_side == 0);
    CHECK(o.shared.brokers == std::vector<std::string>{"tcp://127.0.0.1:50057"});
    CHECK(o.shared.connect_timeout == 10s);
    CHECK_FALSE(o.timeout.has_value());
}

TEST_CASE("fraja-submit reads every option") {
    const SubmitOptions o =
        submit("a.raj -o b.exr -r 640x480 -d 9 -a 4 -e --crop 1,2,30,40 --tile 16 "
               "--order spiral --kernel reference -p -3 -n name --timeout 5m "
               "--stats --json --skip-existing --wait -b h1 -b h2:99,h3 "
               "--connect-timeout 250ms --log-level debug --color never");
    CHECK(o.output == "b.exr");
    CHECK(o.settings == protocol::PictureSettings{.size = {640, 480},
                                                  .crop = {1, 2, 30, 40},
                                                  .depth = 9,
                                                  .aa = 4,
                                                  .exact = true,
                                                  .kernel = protocol::KernelChoice::reference});
    const auto adaptive = submit("a.raj --error 0.5 --max-samples 256 --filter tent").settings;
    CHECK(adaptive.error == 0.5);
    CHECK(adaptive.max_samples == 256);
    CHECK(adaptive.filter == protocol::PixelFilter::tent);
    CHECK(submit("a.raj --spp 7").settings.spp == 7);
    const auto limited = submit("a.raj --time-limit 1m30s --max-samples 64 --filter tent").settings;
    CHECK(limited.time_limit == 90s);
    CHECK(limited.max_samples == 64);
    CHECK(limited.limited_in_time());
    CHECK_FALSE(submit("a.raj").settings.limited_in_time());
    CHECK(submit("a.raj --kernel fast").settings.kernel == protocol::KernelChoice::fast);
    CHECK(o.tile_side == 16);
    CHECK(o.order == protocol::TileOrder::spiral);
    CHECK(o.priority == -3);
    CHECK(o.job_name == "name");
    CHECK(o.timeout == 5min);
    CHECK(o.stats);
    CHECK(o.skip_existing);
    CHECK(o.shared.json);
    CHECK(o.shared.progress == ProgressMode::none); // --wait
    CHECK(o.shared.brokers ==
          std::vector<std::string>{"tcp://h1:50057", "tcp://h2:99", "tcp://h3:50057"});
    CHECK(o.shared.connect_timeout == 250ms);
    CHECK(o.shared.console.level == LogLevel::debug);
    CHECK(o.shared.console.color == service::ColorChoice::never);
    CHECK(submit("a.raj -r 64x48").settings.crop == PixelRect{0, 0, 64, 48});
    CHECK(submit("a.raj --local -j 3").local_threads == 3);
    CHECK(submit("a.raj --detach").output.empty());
    const auto direct = submit("a.raj --direct h1:1,tcp://h2:2 --direct [::1]:3");
    CHECK(direct.direct == std::vector<std::string>{"tcp://h1:1", "tcp://h2:2", "tcp://[::1]:3"});
    CHECK(direct.own_farm());
    CHECK(submit("a.raj --local").own_farm());
    CHECK_FALSE(o.own_farm());
}

TEST_CASE("a new job is what the options ask for") {
    const SubmitOptions o =
        submit("a.raj -r 640x480 -a 4 --tile 16 --order spiral -p -3 --max-workers 7 --tag gpu "
               "--resume");
    ContentHash scene;
    scene.bytes[0] = 5;
    const protocol::SubmitJob job = new_job(o, "the name", scene, 123);
    CHECK(job.job != JobId{});
    CHECK(job.job != new_job(o, "the name", scene, 123).job);
    CHECK(job.job_name == "the name");
    CHECK(job.scene == scene);
    CHECK(job.scene_bytes == 123);
    CHECK(job.settings == o.settings);
    CHECK(job.settings.aa == 4);
    CHECK(job.tile_side == 16);
    CHECK(job.order == protocol::TileOrder::spiral);
    CHECK(job.priority == -3);
    CHECK(job.wishes == o.wishes);
    CHECK(job.wishes.workers_max == 7);
    CHECK(job.resume);
}

namespace {

std::string repeated(int count, const std::string& text) {
    std::string all;
    for (int i = 0; i < count; ++i)
        all += text;
    return all;
}

std::string endpoints(int count) {
    std::string all = "h:1";
    for (int port = 2; port <= count; ++port)
        all += ",h:" + std::to_string(port);
    return all;
}

} // namespace

TEST_CASE("a mistake on fraja-submit's command line ends with 2 and names the option") {
    struct Row {
        std::string line, named;
    };
    for (const Row& row : {Row{"", "SCENE.raj is missing: fraja-submit SCENE.raj"},
                           Row{"a.raj b.raj", "b.raj"},
                           Row{"a.raj --bogus", "--bogus"},
                           Row{"a.raj --local -b h", "--local and -b/--broker contradict"},
                           Row{"a.raj -r 640", "-r 640"},
                           Row{"a.raj -r 0x1", "-r 0x1"},
                           Row{"a.raj -r 65537x1", "-r 65537x1"},
                           Row{"a.raj -r 65536x65536", "-r 65536x65536"},
                           Row{"a.raj --crop 0,0,0,1", "--crop"},
                           Row{"a.raj --crop 200,0,57,1", "--crop"},
                           Row{"a.raj --crop 1,2,3", "--crop 1,2,3"},
                           Row{"a.raj -d 1000001", "-d"},
                           Row{"a.raj -d -1", "-d"},
                           Row{"a.raj -a 257", "-a"},
                           Row{"a.raj -a x", "-a"},
                           Row{"a.raj --spp 0", "--spp"},
                           Row{"a.raj --spp 65537", "--spp"},
                           Row{"a.raj --spp 4 -a 2", "--spp"},
                           Row{"a.raj --error 0", "--error"},
                           Row{"a.raj --error 256", "--error"},
                           Row{"a.raj --error nan", "--error"},
                           Row{"a.raj --error 1 -a 2", "--error"},
                           Row{"a.raj --error 1 --spp 4", "--error"},
                           Row{"a.raj --time-limit 0", "--time-limit 0"},
                           Row{"a.raj --time-limit soon", "--time-limit soon"},
                           Row{"a.raj --time-limit 1s --spp 4", "--time-limit"},
                           Row{"a.raj --time-limit 1s -a 4", "--time-limit"},
                           Row{"a.raj --time-limit 1s --error 4", "--time-limit"},
                           Row{"a.raj --time-limit 1s --tile 1 -r 1024x1024", "--tile 1"},
                           Row{"a.raj --max-samples 64", "--max-samples"},
                           Row{"a.raj --error 1 --max-samples 3", "--max-samples"},
                           Row{"a.raj --filter tent", "--filter"},
                           Row{"a.raj -a 2 --filter tent", "--filter"},
                           Row{"a.raj --spp 2 --filter gauss", "--filter"},
                           Row{"a.raj --tile 0", "--tile 0"},
                           Row{"a.raj --tile 1025", "--tile 1025"},
                           Row{"a.raj --tile 1 -r 4096x4096", "--tile 1"},
                           Row{"a.raj --order up", "--order"},
                           Row{"a.raj --kernel slow", "--kernel"},
                           Row{"a.raj --detach -o b.png", "--detach"},
                           Row{"a.raj --detach --local", "--detach"},
                           Row{"a.raj --local --tag gpu", "--tag chooses among"},
                           Row{"a.raj --detach --wait", "--detach"},
                           Row{"a.raj --direct h", "--direct: endpoint 'h': a port"},
                           Row{"a.raj --direct h:0", "--direct: endpoint 'h:0': a port"},
                           Row{"a.raj --direct h:x", "--direct"},
                           Row{"a.raj --direct *:1", "--direct: endpoint '*:1': host *"},
                           Row{"a.raj --direct ipc:///x", "--direct ipc:///x"},
                           Row{"a.raj --direct pgm://h:1", "--direct"},
                           Row{"a.raj --direct h:1,i:1,tcp://h:1", "twice"},
                           Row{"a.raj --direct h:1 -b h:2", "--direct and --broker"},
                           Row{"a.raj -b h:2 --direct h:1", "--direct and --broker"},
                           Row{"a.raj --direct h:1 --local", "--direct and --local"},
                           Row{"a.raj --direct h:1 -j 2", "-j"},
                           Row{"a.raj --direct h:1 --detach", "not with --direct"},
                           Row{"a.raj --direct h:1 --resume", "not with --direct"},
                           Row{"a.raj --direct", "--direct"},
                           Row{"a.raj -j 2", "-j"},
                           Row{"a.raj --local -j 0", "-j"},
                           Row{"a.raj --overwrite --skip-existing", "--overwrite"},
                           Row{"a.raj --timeout 5x", "--timeout 5x"},
                           Row{"a.raj -p 3000000000", "-p"},
                           Row{"a.raj -b srv:", "-b: srv:: srv: and a domain name"},
                           Row{"a.raj -b " + many_sources(9), "-b: of auto and srv: at most 8"},
                           Row{"a.raj -b tcp://h:0", "-b: endpoint 'tcp://h:0': a port"},
                           Row{"a.raj -b pgm://h:1", "-b: endpoint 'pgm://h:1': the transport"},
                           Row{"a.raj --connect-timeout soon", "--connect-timeout soon"},
                           Row{"a.raj --progress fancy", "--progress"},
                           Row{"a.raj --local -j 2049", "-j"},
                           Row{"a.raj --max-workers 1000001", "--max-workers"},
                           Row{"a.raj --verify 10", "--verify 10: a share of the tiles"},
                           Row{"a.raj --verify 1 --local", "--verify and --local"},
                           Row{"a.raj --verify 1 --time-limit 5s", "--verify and --time-limit"},
                           Row{"a.raj --verify 1 --max-workers 1", "--verify needs two workers"},
                           Row{"a.raj --direct " + endpoints(10'001), "--direct: at most 10000"},
                           Row{"a.raj -b " + endpoints(65), "-b: at most 64"},
                           Row{"a.raj" + repeated(65, " --tag t"), "--tag: at most 64"},
                           Row{"a.raj --tag " + std::string(201, 't'), "--tag"},
                           Row{"a.raj --half -o a.hdr", "--half is for .exr"},
                           Row{"a.raj --layers -o a.hdr", "--layers are for .exr"},
                           Row{"a.raj --transfer srgb -o a.hdr", "--transfer srgb: a.hdr"},
                           Row{"a.raj -o a.gif", "a.gif: this format is not written: "},
                           Row{"a.raj -n " + std::string(201, 'n'), "-n"}}) {
        CAPTURE(row.line);
        const auto parsed = parse_submit_options(words(row.line));
        const auto* early = std::get_if<EarlyExit>(&parsed);
        REQUIRE(early);
        CHECK(early->code == 2);
        CAPTURE(early->text);
        CHECK(early->text.find(row.named) != std::string::npos);
        CHECK(early->text.starts_with("fraja-submit: error: "));
        CHECK(early->text.find('\n') == early->text.size() - 1);
    }
}

TEST_CASE("a film is not detached from, with or without names for its frames") {
    for (const char* line :
         {"a.raj --travel t.raj --detach", "a.raj --travel t.raj --detach -o f%04d.png"}) {
        CAPTURE(line);
        const auto early = parse_submit_options(words(line));
        REQUIRE(std::holds_alternative<EarlyExit>(early));
        CHECK(std::get<EarlyExit>(early).code == 2);
        const std::string& text = std::get<EarlyExit>(early).text;
        CHECK(text.find("--detach and --travel contradict each other") != std::string::npos);
        CHECK(text.find("--skip-existing --resume") != std::string::npos);
    }
    const SubmitOptions again =
        submit("a.raj --travel t.raj -o f%04d.png --skip-existing --resume");
    CHECK(again.skip_existing);
    CHECK(again.resume);
}

TEST_CASE("brokers may be given as those that are to be found, each once") {
    CHECK(submit("a.raj -b auto,srv:example.org -b h:1,auto,tcp://h:1").shared.brokers ==
          std::vector<std::string>{"auto", "srv:_fraja._tcp.example.org", "tcp://h:1"});
    CHECK(submit("a.raj -b " + many_sources(8)).shared.brokers.size() == 8);
}

TEST_CASE("an option goes before the environment, that before the default") {
    const Variable broker("FRAJA_BROKER", "tcp://env:1,other:2");
    CHECK(submit("a.raj").shared.brokers ==
          std::vector<std::string>{"tcp://env:1", "tcp://other:2"});
    CHECK(submit("a.raj -b option:3").shared.brokers == std::vector<std::string>{"tcp://option:3"});
    CHECK(submit("a.raj --direct h:1").direct.size() == 1); // it does not contradict what is typed
    const Variable level("FRAJA_LOG_LEVEL", "error");
    CHECK(submit("a.raj").shared.console.level == LogLevel::error);
    CHECK(submit("a.raj --log-level info").shared.console.level == LogLevel::info);
}

TEST_CASE("help opens with examples, and both help and version are no mistakes") {
    for (const auto& [text, opening] :
         {std::pair{std::get<EarlyExit>(parse_submit_options({"--help"})), "fraja-submit --local"},
          std::pair{std::get<EarlyExit>(parse_watch_options({"-h"})), "fraja-watch "},
          std::pair{std::get<EarlyExit>(parse_ctl_options({"-h"})), "fraja-ctl jobs"}}) {
        CHECK(text.code == 0);
        CHECK(text.text.starts_with("Examples:\n  " + std::string(opening)));
    }
    const auto version = std::get<EarlyExit>(parse_submit_options({"--version"}));
    CHECK(version.code == 0);
    CHECK(version.text.starts_with("fraja-submit " + std::string(fraja::version)));
}

TEST_CASE("fraja-watch reads its options") {
    const auto farm = std::get<WatchOptions>(parse_watch_options({"--once", "--json"}));
    CHECK_FALSE(farm.job.has_value());
    CHECK(farm.until.once);
    CHECK(farm.shared.json);
    const auto job =
        std::get<WatchOptions>(parse_watch_options({"#17", "-o", "now.EXR", "--until", "50%"}));
    CHECK(job.job == "#17");
    CHECK(job.output == "now.EXR");
    CHECK(job.until.share == 0.5);
    CHECK(std::get<WatchOptions>(parse_watch_options({""})).job == ""); // the newest job
    for (const std::vector<std::string>& bad : {std::vector<std::string>{"-o", "a.png"},
                                                {"--until", "first"},
                                                {"j", "--until", "soon"},
                                                {"j", "-o", "a.doc"},
                                                {"j", "k"},
                                                {std::string(5000, 'j')}}) {
        const auto parsed = parse_watch_options(bad);
        const auto* early = std::get_if<EarlyExit>(&parsed);
        REQUIRE(early);
        CHECK(early->code == 2);
    }
}

TEST_CASE("fraja-watch may be asked for a preview and for tev, which needs no place") {
    const auto watch = [](const std::string& line) {
        auto parsed = parse_watch_options(words(line));
        INFO(line);
        if (const auto* early = std::get_if<EarlyExit>(&parsed))
            FAIL(early->text);
        return std::get<WatchOptions>(parsed);
    };
    CHECK(watch("cone").preview == PreviewMode::automatic);
    CHECK(watch("cone --preview sixel").preview == PreviewMode::sixel);
    CHECK_FALSE(watch("cone").tev.has_value());
    struct Row {
        std::string line, tev;
    };
    for (const Row& row :
         {Row{"cone --tev", "127.0.0.1:14158"}, Row{"--tev cone", "127.0.0.1:14158"},
          Row{"--tev --json cone", "127.0.0.1:14158"}, Row{"--tev host:1 cone", "host:1"},
          Row{"cone --tev=host", "host"}, Row{"--tev [::1]:14158 cone", "[::1]:14158"}}) {
        CAPTURE(row.line);
        const WatchOptions o = watch(row.line);
        CHECK(o.job == "cone");
        CHECK(o.tev == row.tev);
    }
    for (const char* line : {"--tev", "--preview blocks", "cone --preview lines"}) {
        CAPTURE(line);
        const auto early = parse_watch_options(words(line));
        REQUIRE(std::holds_alternative<EarlyExit>(early));
        CHECK(std::get<EarlyExit>(early).code == 2);
    }
}

TEST_CASE("fraja-submit shows no preview unless it is asked to, and then the best there is") {
    CHECK(submit("a.raj").preview == PreviewMode::none);
    CHECK(submit("--preview a.raj").preview == PreviewMode::automatic);
    CHECK(submit("a.raj --preview=kitty").preview == PreviewMode::kitty);
    CHECK(submit("--preview blocks a.raj").preview == PreviewMode::blocks);
    CHECK(submit("--preview a.raj").scene_file == "a.raj");
    for (const char* line : {"a.raj --preview=lines", "a.raj --preview --detach",
                             "a.raj --preview --travel t.raj -o f%02d.png"}) {
        CAPTURE(line);
        CHECK(std::holds_alternative<EarlyExit>(parse_submit_options(words(line))));
    }
}

TEST_CASE("fraja-watch serves a page where that is asked for") {
    using Words = std::vector<std::string>;
    CHECK_FALSE(std::get<WatchOptions>(parse_watch_options({"cone"})).serve);
    struct Row {
        Words words;
        std::string at;
        std::optional<std::string> job;
    };
    for (const Row& row :
         {Row{{"--serve"}, "", std::nullopt},
          Row{{"--serve", "127.0.0.1:80"}, "127.0.0.1:80", std::nullopt},
          Row{{"cone", "--serve"}, "", "cone"}, Row{{"cone", "--serve", "*:80"}, "*:80", "cone"},
          Row{{"--serve", "--allow-control"}, "", std::nullopt},
          Row{{"--serve", "-b", "host"}, "", std::nullopt}}) {
        const auto options = std::get<WatchOptions>(parse_watch_options(row.words));
        REQUIRE(options.serve);
        CHECK(options.serve->at == row.at);
        CHECK(options.job == row.job);
        CHECK(options.serve->allow_control == (row.words.back() == "--allow-control"));
    }
    CHECK(std::get<WatchOptions>(parse_watch_options({"--serve", "--token-file", "f"}))
              .serve->token_file == "f");
    for (const Words& bad :
         {Words{"--allow-control"}, Words{"--serve", "--json"}, Words{"--serve", "--once"},
          Words{"j", "-o", "a.png", "--serve"}, Words{"j", "--until", "first", "--serve"}})
        CHECK(std::get<EarlyExit>(parse_watch_options(bad)).code == 2);
}

TEST_CASE("an option that may stand alone is not given nothing either") {
    for (const std::vector<std::string>& typed :
         {std::vector<std::string>{"--serve", ""}, {"--tev="}, {"cone", "-o", ""}}) {
        const auto parsed = parse_watch_options(typed);
        REQUIRE(std::holds_alternative<EarlyExit>(parsed));
        CHECK(std::get<EarlyExit>(parsed).code == 2);
        CHECK(std::get<EarlyExit>(parsed).text.find(" '': empty, and ") != std::string::npos);
    }
}

TEST_CASE("parse_until takes done, first and a share, and nothing else") {
    struct Row {
        std::string_view text;
        std::optional<double> want;
    };
    for (const Row& row :
         {Row{"done", 1.0}, Row{"first", 0.0}, Row{"0%", 0.0}, Row{"50%", 0.5}, Row{"100%", 1.0},
          Row{"101%", std::nullopt}, Row{"50", std::nullopt}, Row{"", std::nullopt},
          Row{"%", std::nullopt}, Row{"-1%", std::nullopt}}) {
        CAPTURE(row.text);
        CHECK(parse_until(row.text) == row.want);
    }
}

TEST_CASE("fraja-ctl reads its commands, with shared options on either side") {
    const auto command = [](const std::string& line) {
        return std::get<CtlOptions>(parse_ctl_options(words(line)));
    };
    CHECK(std::holds_alternative<ListJobs>(command("jobs").command));
    CHECK(std::holds_alternative<ListWorkers>(command("workers").command));
    CHECK(std::get<ShowJob>(command("show #1").command).job == "#1");
    CHECK(std::get<ControlJob>(command("cancel cone --yes").command).yes);
    CHECK_FALSE(std::get<ControlJob>(command("cancel cone").command).yes);
    CHECK(std::get<GetPicture>(command("get cone -o a.png").command).output == "a.png");
    for (const char* line : {"-b h:1 jobs", "jobs -b h:1"})
        CHECK(command(line).shared.brokers == std::vector<std::string>{"tcp://h:1"});
    for (const char* line :
         {"", "dance", "show", "get cone", "get cone -o a.doc", "jobs workers"}) {
        CAPTURE(line);
        const auto parsed = parse_ctl_options(words(line));
        const auto* early = std::get_if<EarlyExit>(&parsed);
        REQUIRE(early);
        CHECK(early->code == 2);
    }
    for (const std::vector<std::string>& typed : {std::vector<std::string>{"cancel", "--yes", ""},
                                                  {"get", "", "-o", "a.png"},
                                                  {"kick", ""}}) {
        const auto parsed = parse_ctl_options(typed); // not the newest that there is
        REQUIRE(std::holds_alternative<EarlyExit>(parsed));
        CHECK(std::get<EarlyExit>(parsed).text.find(typed[0] + " '': empty, and a name is ") !=
              std::string::npos);
    }
}
