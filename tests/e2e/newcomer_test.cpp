// The first hour with Fraja: whatever goes wrong says what happened, where, and what to do.
#include "common/net/sockets.hpp"
#include "tests/e2e/farm.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <csignal>
#include <fstream>
#include <netinet/in.h>
#include <nlohmann/json.hpp>
#include <sstream>
#include <sys/socket.h>
#include <unistd.h>

using namespace fraja;
using namespace fraja::e2e;

namespace {

/// A mistake, and what must be said of it.
struct Mistake {
    Words argv; ///< the program's name first
    int exit;
    Words says;
    int lines = 1;
};

/// So many lines, on standard error alone, in words of ours.
void check(const Mistake& mistake, const std::string& launcher = {}) {
    Words argv = mistake.argv;
    argv[0] = program(argv[0].c_str());
    Words whole = launcher.empty() ? Words{} : Words{"sh", "-c", launcher + " \"$@\"", "sh"};
    std::string typed;
    for (const std::string& word : mistake.argv)
        typed += word + " ";
    CAPTURE(typed);
    const auto result = run({with(std::move(whole), argv)}, patience);
    REQUIRE(result.has_value());
    CAPTURE(result->err);
    CHECK(result->exit == mistake.exit);
    CHECK(result->out.empty());
    CHECK(std::ranges::count(result->err, '\n') == mistake.lines);
    for (const std::string& words : mistake.says) {
        CAPTURE(words);
        CHECK(contains(result->err, words));
    }
    for (const char* jargon : {"TEXT", "UINT", "FLOAT", "not in {", "Run with", "not expected",
                               "terminate", "what()", "std::", "zmq", "Errno"})
        CHECK_FALSE(contains(result->err, jargon));
}

void check(const std::vector<Mistake>& mistakes) {
    for (const Mistake& mistake : mistakes)
        check(mistake);
}

/// A port where something listens that never says anything.
class OtherProgram {
public:
    OtherProgram() : fd_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof address;
        REQUIRE(bind(fd_, reinterpret_cast<const sockaddr*>(&address), size) == 0);
        REQUIRE(listen(fd_, 8) == 0);
        REQUIRE(getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size) == 0);
        endpoint_ = "tcp://127.0.0.1:" + std::to_string(ntohs(address.sin_port));
    }
    ~OtherProgram() { close(fd_); }
    OtherProgram(const OtherProgram&) = delete;
    OtherProgram& operator=(const OtherProgram&) = delete;
    [[nodiscard]] const std::string& endpoint() const { return endpoint_; }

private:
    int fd_;
    std::string endpoint_;
};

const Words soon = {"--connect-timeout", "300ms"};
const Words any_ports = {"--bind", "tcp://127.0.0.1:0", "--publish", "tcp://127.0.0.1:0"};

} // namespace

TEST_CASE("no broker: what is there instead, and the ways on") {
    const OtherProgram other;
    for (const Words& argv : {Words{"fraja-submit", scene("cone"), "-o", "/tmp/never.png"},
                              Words{"fraja-watch"}, Words{"fraja-ctl", "jobs"}}) {
        // Who has no scene to draw is not told how to draw it here.
        const Words cures = {"(fraja-broker starts one, -b HOST:PORT names another",
                             argv[0] == "fraja-submit" ? "; fraja-submit --local does without)"
                                                       : "names another)"};
        check({{with(with(argv, soon), {"-b", "tcp://127.0.0.1:1"}), 3,
                with(cures, {"tcp://127.0.0.1:1", "nothing listens there"})},
               {with(with(argv, soon), {"-b", other.endpoint()}), 3,
                with(cures, {other.endpoint(), "does not answer as a broker does"})},
               {with(with(argv, soon), {"-b", "no-such-host.invalid"}), 3,
                with(cures, {"no-such-host.invalid:50057: ", "host 'no-such-host.invalid'"})}});
    }
}

TEST_CASE("a worker without a broker goes on asking, and says what to do") {
    auto started =
        Process::start({{program("fraja-worker"), "-j", "1", "-b", "tcp://127.0.0.1:1"}});
    REQUIRE(started.has_value());
    Process& worker = *started;
    CHECK(worker
              .wait_for_words(Process::Stream::err,
                              "tcp://127.0.0.1:1: the broker does not answer; asking again until "
                              "it does (fraja-broker starts one, -b names another, fraja-ctl "
                              "doctor says what is wrong)",
                              patience)
              .has_value());
    worker.send(SIGTERM);
    CHECK(worker.wait_for_exit(patience) == 0);
}

TEST_CASE("while a broker is looked for, that is said") {
    const auto said = [](const Words& words) {
        const auto result = run(
            {with(words, {"-b", "tcp://127.0.0.1:1", "--connect-timeout", "1500ms"})}, patience);
        REQUIRE(result.has_value());
        CHECK(result->exit == 3);
        CHECK(result->out.empty());
        return result->err;
    };
    const std::string looking =
        ": looking for a broker at tcp://127.0.0.1:1 (nothing listens there) ...\n";
    for (const Words& argv :
         {Words{program("fraja-submit"), scene("cone"), "-o", "/tmp/never.png"},
          Words{program("fraja-submit"), scene("cone"), "--travel",
                FRAJA_SOURCE_DIR "/scenes/travels/cone.raj", "-o", "/tmp/never%d.png"},
          Words{program("fraja-watch")}, Words{program("fraja-watch"), "cone"},
          Words{program("fraja-ctl"), "jobs"}, Words{program("fraja-ctl"), "show", "cone"}}) {
        CAPTURE(argv[0]);
        CHECK(contains(said(argv), looking));
    }
    const Words jobs = {program("fraja-ctl"), "jobs", "--progress"};
    CHECK(said(with(jobs, {"json"})).starts_with(R"({"schema":"fraja.event/1","event":"looking)"));
    CHECK_FALSE(contains(said(with(jobs, {"none"})), "looking"));
}

TEST_CASE("a job that waits for a worker says so, with the cure, and what was written in the end") {
    const Scratch scratch;
    Farm farm;
    const std::string output = scratch.file("x.png");
    Process client = farm.start_submit({scene("cone"), "-r", "8x6", "-o", output});
    REQUIRE(client.wait_for_words(Process::Stream::err, ": job ", patience).has_value());
    Process watcher = farm.watch("cone", {});
    for (Process* process : {&client, &watcher})
        CHECK(process
                  ->wait_for_words(Process::Stream::err,
                                   "cone #1 is waiting: no worker is connected; fraja-worker -b " +
                                       farm.endpoint() + " starts one",
                                   patience)
                  .has_value());
    farm.add_worker("ada");
    for (Process* process : {&client, &watcher}) {
        CHECK(process->wait_for_exit(patience) == 0);
        INFO(process->story());
        CHECK(contains(process->err(), "a worker is here: cone #1 goes on\n"));
    }
    CHECK(client.err().ends_with("fraja-submit: wrote " + output + "\n"));
    const RunResult again = farm.submit({scene("cone"), "-r", "8x6", "-o", output, "--resume"});
    CHECK(contains(again.err, "fraja-submit: resumes cone #1: 100% of it was there\n"));
    const RunResult quiet =
        farm.submit({scene("cone"), "-r", "8x6", "-o", output, "--log-level", "warning", "--wait"});
    CHECK(quiet.exit == 0);
    CHECK(quiet.err.empty());
    const RunResult kept = farm.submit(
        {scene("cone"), "-r", "8x6", "-o", output, "--time-limit", "1h", "--max-samples", "4"});
    CHECK(contains(kept.err, "each pixel has its 4 samples, and --max-samples 4 lets it have no"));
}

TEST_CASE("a scene that is none") {
    const Scratch scratch;
    const auto file = [&](const std::string& name, const std::string& text) {
        std::ofstream(scratch.file(name)) << text;
        return scratch.file(name);
    };
    const auto local = [&](const std::string& path) {
        return Words{"fraja-submit", "--local", path, "-o", scratch.file("x.png")};
    };
    std::string typo = bytes_of(scene("overlapping_spheres"));
    typo.replace(typo.find("radius"), 6, "raduis");
    const std::string picture = FRAJA_SOURCE_DIR "/scenes/overlapping_spheres.png";
    check({
        {local("no-such.raj"),
         2,
         {"no-such.raj: there is no such file in " + fs::current_path().string()}},
        {local(FRAJA_SOURCE_DIR "/scenes/coen.raj"),
         2,
         {"/coen.raj: there is no such file (did you mean '" + scene("cone") + "'?)"}},
        {local(FRAJA_SOURCE_DIR "/scenes/cone"), 2, {"(did you mean '" + scene("cone") + "'?)"}},
        {{"fraja-submit", "--local", scene("cone"), "--travel",
          FRAJA_SOURCE_DIR "/scenes/travels/con.raj", "-o", scratch.file("%d.png")},
         2,
         {"/travels/con.raj: there is no such file (did you mean '"}},
        {local(scratch.file("")), 2, {"this is a directory", "scenes/cone.raj"}},
        {local(picture), 2, {picture + ": this is no scene", "raja.renderer.Scene"}},
        {local(file("empty.raj", "")), 2, {"empty.raj:1:1: unexpected end of the file"}},
        {local(file("words.raj", "hello")), 2, {"words.raj:1:1: ", "hello"}},
        {local(file("README.md", "# Fraja")),
         2,
         {"README.md:1:1: expected a number", "found '#'", "is this a scene?",
          "raja.renderer.Scene {"}},
        {local(file("typo.raj", typo)),
         2,
         {"typo.raj:", "no field 'raduis'", "did you mean 'radius'?"}},
    });
}

TEST_CASE("an output that cannot be written, before anything is rendered") {
    const Scratch scratch;
    const auto into = [&](const std::string& path) {
        return Words{"fraja-submit", "--local", scene("cone"), "-o", path};
    };
    check({
        {into("/no/such/directory/x.png"), 2, {"x.png: there is no directory /no/such/directory"}},
        {into("/proc/x.png"), 2, {"/proc/x.png: no file can be made there"}},
        {into(scratch.file("")), 2, {"extension", ".png"}},
        {into(scratch.file("x.pgn")), 2, {"x.pgn: unknown extension", "did you mean '.png'?"}},
        {into(scratch.file("x")), 2, {"extension", ".png", ".exr"}},
        {into(scratch.file("x%04d.png")), 2, {"error: -o ", "--travel FILE"}},
    });
    fs::create_directory(scratch.file("d.png"));
    check({{into(scratch.file("d.png")), 2, {"d.png: this is a directory"}}});
}

TEST_CASE("a picture never replaces the scene that it is made of") {
    const Scratch scratch;
    const std::string own = scratch.file("own.png"), link = scratch.file("link.png"),
                      travel = scratch.file("c3.png");
    fs::copy_file(scene("cone"), own);
    fs::create_symlink("own.png", link);
    fs::copy_file(FRAJA_SOURCE_DIR "/scenes/travels/cone.raj", travel);
    const auto size = fs::file_size(own);
    check({
        {{"fraja-submit", "--local", own, "-o", own},
         2,
         {"the picture would replace what it is made of: " + own + ";", "-o"}},
        {{"fraja-submit", "--local", own, "-o", link}, 2, {"link.png is ", "own.png", "-o"}},
        {{"fraja-submit", "--dry-run", link, "-o", own}, 2, {"would replace"}},
        {{"fraja-submit", "--local", scene("cone"), "--travel", travel, "-o",
          scratch.file("c%d.png")},
         2,
         {"would replace", "c3.png"}},
    });
    CHECK(fs::file_size(own) == size);
}

TEST_CASE("an option with a typing slip, or without what it needs") {
    const std::string cone = scene("cone");
    check({
        {{"fraja-submit", cone, "--prioritty", "3"},
         2,
         {"'--prioritty'", "did you mean '--priority'?", "fraja-submit --help"}},
        {{"fraja-submit", "--locl", cone}, 2, {"'--locl'", "did you mean '--local'?"}},
        {{"fraja-submit", "--local", "--preview", "block", cone},
         2,
         {"--preview block: there is no scene of that name, and the modes are auto, kitty",
          "did you mean 'blocks'?"}},
        {{"fraja-watch", "cone", "--token-file", "t"}, 2, {"--token-file needs --serve"}},
        {{"fraja-watch", "cone", "-o", "old%d.png"}, 2, {"-o old%d.png: % is for the numbers"}},
        {{"fraja-ctl", "get", "cone", "-o", "old%d.png"},
         2,
         {"old%d.png: % is for the numbers of a film's frames", "--travel"}},
        {{"fraja-watch", "--serve", "127.0.0.1:0", "--token-file", "nosuch"},
         2,
         {"--token-file nosuch: there is no such file; to make one, type: (umask 077; "}},
        {{"fraja-submit"}, 2, {"SCENE.raj is missing: fraja-submit SCENE.raj"}},
        {{"fraja-submit", cone, "x.png"}, 2, {"'x.png' is one argument too many"}},
        {{"fraja-submit", cone, "--size"}, 2, {"--size needs a value: WxH"}},
        {{"fraja-submit", cone, "--detach", "-o", "x.png"},
         2,
         {"--detach", "fraja-ctl get JOB -o FILE"}},
        {{"fraja-submit", cone, "--key-file", "nosuch"},
         2,
         {"--key-file nosuch: No such file or directory"}},
        {{"fraja-submit", cone, "--broker-key", "k"},
         2,
         {"--broker-key is of no use without a key of one's own: --key-file FILE"}},
        {{"fraja-broker", "--key-file", "k"}, 2, {"--key-file: ", "--allow FILE"}},
        {{"fraja-broker", "--allow", "a"}, 2, {"--allow is of no use without", "--key-file"}},
        {{"fraja-worker", "--thread", "2"}, 2, {"'--thread'", "did you mean '--threads'?"}},
        {{"fraja-watch", "--onec"}, 2, {"'--onec'", "did you mean '--once'?"}},
        {{"fraja-ctl", "cancle", "cone"},
         2,
         {"there is no command 'cancle'", "did you mean 'cancel'?"}},
        {{"fraja-ctl"}, 2, {"a command is needed: jobs, "}},
        {{"fraja-ctl", "show"}, 2, {"JOB is missing: fraja-ctl show JOB"}},
    });
}

TEST_CASE("a value of the wrong kind: as it was typed, and as it is written") {
    const auto with_scene = [](const Words& words) {
        return with({"fraja-submit", scene("cone")}, words);
    };
    check({{"fraja-ctl", "jobs"},
           2,
           {"FRAJA_BROKER in the environment: --broker: endpoint 'foo:bar:1'"}},
          "FRAJA_BROKER=foo:bar:1");
    check({
        {with_scene({"--timeout", "soon"}), 2, {"--timeout soon: ", "90, 90s, 5m or 1h30m"}},
        {with_scene({"--size", "640"}), 2, {"error: --size 640: ", "640x480"}},
        {with_scene({"-r", "640"}), 2, {"error: -r 640: ", "640x480"}},
        {with_scene({"-d", "-1"}), 2, {"error: -d -1: ", "0 to 1000000"}},
        {with_scene({"-j", "2"}), 2, {"error: -j is for --local"}},
        {with_scene({"--crop", "1,2"}), 2, {"--crop 1,2: ", "X,Y,W,H"}},
        {with_scene({"--depth", "-1"}), 2, {"--depth -1: a number is needed, 0 to 1000000"}},
        {with_scene({"--error", "little"}), 2, {"--error little: a number is needed"}},
        {with_scene({"--kernel", "quick"}), 2, {"--kernel quick: fast or reference"}},
        {with_scene({"--spp", "4", "--aa", "2"}), 2, {"--aa and --spp exclude each other"}},
        {with_scene({"--name", "#3"}), 2, {"--name #3: so a JOB is called by its number"}},
        {{"fraja-ctl", "get", "cone"}, 2, {"--output is missing: fraja-ctl get JOB -o FILE"}},
        {with_scene({"-b", "http://farm"}), 2, {"-b: endpoint 'http://farm'", "tcp, ipc"}},
        {with_scene({"-b", "farm:99999"}), 2, {"-b: endpoint 'farm:99999'", "0 to 65535"}},
        {{"fraja-broker", "--heartbeat", "often"}, 2, {"--heartbeat often: ", "as 1s"}},
        {{"fraja-broker", "--quarantine", "3"}, 2, {"--quarantine 3: ", "as 3/10m"}},
        {{"fraja-broker", "--keep", "forever"}, 2, {"--keep forever: ", "as 7d"}},
        {{"fraja-broker", "--bind", "tcp://127.0.0.1:80x", "--state", "none"},
         2,
         {"--bind: endpoint ", "0 to 65535"}},
        {{"fraja-worker", "--threads", "0"}, 2, {"--threads 0: a number is needed, 1 to 2048"}},
        {{"fraja-worker", "--emulate", "3"}, 2, {"--emulate 3: COUNT@SPEED", "16@3.5k"}},
        {{"fraja-watch", "cone", "--until", "later"},
         2,
         {"--until later: done, first, or a share as 50%"}},
        {{"fraja-ctl", "prio", "cone", "high"}, 2, {"N 'high': a number is needed"}},
    });
}

TEST_CASE("what is typed goes before a settings file that says the contrary") {
    const Scratch scratch;
    fs::create_directories(scratch.file("fraja"));
    const std::string file = scratch.file("fraja/config.toml");
    const auto plan = [&](const std::string& settings, const Words& typed) {
        std::ofstream(file) << "[fraja-submit]\n" << settings;
        const auto result = run({with({program("fraja-submit"), "--dry-run", scene("cone")}, typed),
                                 {"XDG_CONFIG_HOME=" + scratch.file("")}},
                                patience);
        REQUIRE(result.has_value());
        return *result;
    };
    const std::string png = scratch.file("x.png"), exr = scratch.file("x.exr");
    struct Row {
        const char* settings;
        Words typed;
    };
    for (const Row& row : {
             Row{"skip-existing = true\n", {"--overwrite", "-o", png}},
             Row{"transfer = 'srgb'\n", {"-o", exr}},
             Row{"half = true\nlayers = true\n", {"-o", png}},
             Row{"detach = true\n", {"-o", png}},
             Row{"detach = true\n", {"--local", "-o", png}},
             Row{"local = true\nthreads = 2\n", {"--detach"}},
             Row{"tag = 'gpu'\n", {"--local", "-o", png}},
             Row{"output = 'y.png'\n", {"--detach"}},
             Row{"time-limit = '9s'\nmax-samples = 64\nfilter = 'tent'\n", {"-a", "2", "-o", png}},
             Row{"stats = true\ntime-limit = '9s'\npreview = 'auto'\n",
                 {"--travel", FRAJA_SOURCE_DIR "/scenes/travels/cone.raj", "-o",
                  scratch.file("%d.png")}},
         }) {
        const RunResult planned = plan(row.settings, row.typed);
        CAPTURE(row.settings);
        CAPTURE(planned.err);
        CHECK(planned.exit == 0);
        CHECK(planned.err.empty());
    }
    for (const char* settings : {"local = true\nthreads = 2\n", "direct = 'one:7001'\n"}) {
        const RunResult there = plan(settings, {"-b", "tcp://farm:1", "-o", png});
        CAPTURE(there.err);
        CHECK(there.exit == 0);
        CHECK(contains(there.out, "broker    tcp://farm:1\n"));
    }
    const Words local = {"--local", "-o", png}; // a broker that is set is for other jobs
    for (const RunResult& here :
         {plan("broker = 'farm'\nlocal = true\n", {"-o", png}), plan("broker = 'farm'\n", local)})
        CHECK(contains(here.out, "broker    none: in this process\n"));
    const RunResult wrong = plan("\nsize = '640'\n", {"-o", png});
    CHECK(wrong.exit == 2);
    CHECK(contains(wrong.err, "fraja-submit: error: " + file + ":3:1: --size 640: "));
    const RunResult both = plan("detach = true\nlocal = true\n", {});
    CHECK(both.exit == 2);
    CHECK(
        contains(both.err, file + ":3:1: local and detach (" + file + ":2:1) exclude each other"));
}

TEST_CASE("a doctor finds the mistakes in settings files, whosever they are, and goes on") {
    const Scratch scratch;
    const Farm farm;
    fs::create_directories(scratch.file("fraja"));
    const std::string file = scratch.file("fraja/config.toml");
    struct Row {
        const char* settings;
        Words says;
    };
    for (const Row& row :
         {Row{"borker = 'a'\n",
              {":1:1: programs share no option 'borker' (did you mean 'broker'?)"}},
          Row{"[fraja-broker]\nbnid = 'x'\n[fraja-worker]\nthreads = 0\n",
              {":2:1: fraja-broker has no option 'bnid' (did you mean 'bind'?)",
               ":4:1: --threads 0: a number is needed, 1 to 2048"}},
          Row{"connect-timeout = 'soon'\n[fraja-broker]\nbnid = 'x'\n",
              {":1:1: --connect-timeout soon: ", ":3:1: fraja-broker has no option 'bnid'"}}}) {
        CAPTURE(row.settings);
        std::ofstream(file) << row.settings;
        const auto found = run({{program("fraja-ctl"), "doctor", "-b", farm.endpoint()},
                                {"XDG_CONFIG_HOME=" + scratch.file("")}},
                               patience);
        REQUIRE(found.has_value());
        INFO(found->out << found->err);
        CHECK(found->exit == 2);
        for (const std::string& words : row.says)
            CHECK(contains(found->out, file + words));
        CHECK(contains(found->out, "-> correct it there"));
        CHECK(contains(found->out, "pictures"));
        CHECK(contains(found->out, "reached in"));
    }
}

TEST_CASE("a broker that cannot start") {
    const OtherProgram other;
    const Scratch scratch;
    Farm farm({"--state", scratch.file("kept")});
    const Words unkept = {"--state", "none"};
    check({
        {with({"fraja-broker", "--bind", other.endpoint()}, unkept),
         75,
         {"--bind: cannot listen at " + other.endpoint(), "perhaps a broker that runs already",
          "another port"}},
        {with({"fraja-broker", "--bind", "tcp://127.0.0.1:0", "--publish", other.endpoint()},
              unkept),
         75,
         {"--publish: cannot publish at " + other.endpoint(), "another port"}},
        {with({"fraja-broker", "--bind", "tcp://192.0.2.1:50057", "--insecure"}, unkept),
         2,
         {"--bind: ", "tcp://192.0.2.1:50057", "no such address"}},
        {with({"fraja-broker", "--bind", "tcp://*:0"}, unkept),
         2,
         {"tcp://*:0", "--insecure", "loopback"}},
        {with(with({"fraja-broker"}, any_ports), {"--state", scratch.file("kept")}),
         75,
         {scratch.file("kept"),
          "another fraja-broker is using it (process " + std::to_string(farm.broker().pid()) + ")",
          "another --state"}},
        {with(with({"fraja-broker"}, any_ports), {"--state", scene("cone")}),
         2,
         {scene("cone"), "no directory", "--state"}},
        {{"fraja-worker", "--listen", "tcp://*:0"}, 2, {"--listen: ", "--insecure", "loopback"}},
        {{"fraja-worker", "--listen", other.endpoint()},
         75,
         {"cannot listen at " + other.endpoint(), "another port"}},
    });
}

TEST_CASE("who has no permission is told where, and what else there is") {
    const std::string nobody =
        geteuid() == 0 ? "exec setpriv --reuid 65534 --regid 65534 --clear-groups" : "exec";
    const auto can_run =
        run({{"sh", "-c", nobody + " " + program("fraja-broker") + " --version"}}, patience);
    if (!can_run.has_value() || can_run->exit != 0) {
        MESSAGE("nobody cannot run the programs here: permissions are NOT tested");
        return;
    }
    const Scratch scratch; // another's
    fs::permissions(scratch.file(""), fs::perms::owner_exec | fs::perms::others_exec);
    check({with(with({"fraja-broker"}, any_ports), {"--state", scratch.file("kept")}),
           2,
           {scratch.file("kept"), "Permission denied", "--state"}},
          nobody);
    check({{"fraja-submit", "--local", scene("cone"), "-o", scratch.file("x.png")},
           2,
           {scratch.file("x.png"), "no file can be made there: Permission denied"}},
          nobody);
    check(
        {{"fraja-submit", "--local", "/proc/1/mem", "-o", "/dev/null/x.png"}, 2, {"/proc/1/mem: "}},
        nobody);
    fs::permissions(scratch.file(""), fs::perms::owner_all);
}

TEST_CASE("jobs and workers that are not there, or are several") {
    Farm farm;
    const auto ctl = [&](const Words& words) {
        return with({"fraja-ctl", "-b", farm.endpoint()}, words);
    };
    check({
        {ctl({"show", "nope"}), 6, {"there is no job 'nope'"}},
        {ctl({"get", "nope", "-o", "/tmp/never.png"}), 6, {"there is no job 'nope'"}},
        {ctl({"drain", "nope"}), 6, {"there is no worker 'nope'"}},
        {{"fraja-watch", "-b", farm.endpoint(), "nope"}, 6, {"there is no job 'nope'"}},
    });
    std::string twice; // of seventeen ids two begin alike
    std::set<char> begun;
    while (twice.empty())
        if (const char first = farm.detach({scene("cone"), "-r", "8x6"})[0];
            !begun.insert(first).second)
            twice = first;
    check({
        {ctl({"show", twice}), 2, {"'" + twice + "' fits ", " jobs: give more of the id"}},
        {ctl({"show", "coen"}), 6, {"there is no job 'coen' (did you mean 'cone'?)"}},
        {ctl({"cancel", "--yes", "con"}), 6, {"there is no job 'con' (did you mean 'cone'?)"}},
        {ctl({"get", "cnoe", "-o", "/tmp/never.png"}), 6, {"(did you mean 'cone'?)"}},
        {{"fraja-watch", "-b", farm.endpoint(), "conne"}, 6, {"'conne' (did you mean 'cone'?)"}},
        {ctl({"cancel", "cone"}), 2, {"--yes", "cancel cone #"}},
        {ctl({"kick", "ada"}), 2, {"--yes", "kick ada"}},
        {ctl({"get", "cone", "-o", "/no/such/x.png"}), 2, {"there is no directory /no/such"}},
        {ctl({"get", "cone"}), 2, {"--output is missing"}},
    });
    farm.add_worker("ada");
    check({{ctl({"drain", "adda"}), 6, {"there is no worker 'adda' (did you mean 'ada'?)"}}});
}

TEST_CASE("a broker of another release") {
    const net::Context context;
    auto broker = net::RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(broker.has_value());
    for (const Words& words : {Words{"fraja-ctl", "jobs"}, Words{"fraja-worker"}}) {
        CAPTURE(words[0]);
        auto process = Process::start({with({program(words[0].c_str()), "-b", broker->endpoint()},
                                            {words.begin() + 1, words.end()})});
        REQUIRE(process.has_value());
        protocol::Packet answer = protocol::encode(protocol::Beat{});
        answer.header[4] ^= std::byte{0x40}; // the version's low byte
        const auto end = std::chrono::steady_clock::now() + patience;
        while (!process->wait_for_exit(0s) && std::chrono::steady_clock::now() < end) {
            net::wait({*broker}, 10ms);
            while (const auto hello = broker->receive()) // also late ones of whoever was before
                broker->send(hello->peer, answer);
        }
        CHECK(process->wait_for_exit(patience) == 4);
        INFO(process->story());
        for (const char* said :
             {"speaks protocol version ", ", this program versions ", "must be updated"})
            CHECK(contains(process->err(), said));
    }
}

TEST_CASE("a client that is told to end says so by its exit code, and the job goes on") {
    const Scratch scratch;
    Farm farm;
    for (const auto& [signal, code] : {std::pair{SIGINT, 130}, std::pair{SIGTERM, 143}}) {
        Process client =
            farm.start_submit({scene("cone"), "-r", "8x6", "-o", scratch.file("x.png")});
        REQUIRE(client.wait_for_words(Process::Stream::err, ": job ", patience).has_value());
        client.send(signal);
        CHECK(client.wait_for_exit(patience) == code);
        CHECK(contains(client.err(), "fraja-watch"));
        CHECK(contains(client.err(), "fraja-ctl"));
    }
    Process read = farm.start_submit(
        {scene("cone"), "-r", "8x6", "-o", scratch.file("x.png"), "--progress", "json"});
    REQUIRE(read.wait_for_words(Process::Stream::err, "\"accepted\"", patience).has_value());
    read.send(SIGINT);
    CHECK(read.wait_for_exit(patience) == 130);
    CHECK(contains(read.err(), "\"goes_on\""));
    std::istringstream lines(read.err());
    for (std::string line; std::getline(lines, line);)
        CHECK(nlohmann::json::accept(line));
}
