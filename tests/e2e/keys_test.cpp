// A farm with keys: who is let in, what each may do, and that no secret shows.
#include "tests/e2e/ring.hpp"

#include <csignal>
#include <fstream>
#include <sys/stat.h>
#include <utility>

using namespace fraja;
using namespace fraja::e2e;

namespace {

RunResult ask(const Words& words) {
    auto ran = run({words}, patience);
    REQUIRE(ran.has_value());
    return *std::move(ran);
}

/// A worker with the farm's key that waits to be called, and where.
std::pair<Process, std::string> start_listening(const Ring& ring) {
    auto worker = Process::start({with(
        {program("fraja-worker"), "--listen", "tcp://127.0.0.1:0", "-j", "1", "--name", "one"},
        ring.farm_options())});
    REQUIRE(worker.has_value());
    const auto line = worker->wait_for_words(Process::Stream::out, "listening ", patience);
    REQUIRE(line.has_value());
    return {std::move(*worker), line->substr(10)};
}

} // namespace

TEST_CASE("a farm with keys draws the same picture, and everybody may do what the list says") {
    const Ring ring;
    ring.allow({{"worker", "worker"}, {"ada", "submit,admin"}, {"eve", "watch"}});
    Farm farm(ring.broker_options());
    farm.add_worker("one", {"-j", "1", "--key-file", ring.file("worker")});
    const Scratch scratch;
    const Words picture = {scene("cone"), "-r", "40x30", "--tile", "8"};
    const auto as = [&](const std::string& name, const std::string& prog, const Words& words) {
        return ask(
            with({program(prog), "-b", farm.endpoint(), "--key-file", ring.file(name)}, words));
    };
    const auto submit = [&](const std::string& name) {
        return as(name, "fraja-submit", with(picture, {"-o", scratch.file("x.png")}));
    };
    CHECK(submit("ada").exit == 0);
    CHECK((bytes_of(scratch.file("x.png")) == local_picture(scratch, picture)));
    CHECK(as("eve", "fraja-ctl", {"jobs"}).exit == 0);
    CHECK(as("eve", "fraja-watch", {"cone", "--json"}).exit == 0);

    struct Row {
        std::string name, prog;
        Words words;
        const char* says;
    };
    for (const Row& row :
         {Row{"eve", "fraja-submit", with(picture, {"-o", scratch.file("y.png")}),
              "lacks the role submit"},
          Row{"eve", "fraja-ctl", {"prio", "cone", "5"}, "lacks the role submit or admin"},
          Row{"eve", "fraja-ctl", {"drain", "one"}, "lacks the role admin"},
          Row{"worker", "fraja-ctl", {"jobs"}, "lacks the role submit or watch or admin"},
          Row{"worker", "fraja-ctl", {"cancel", "--yes", "cone"}, "lacks the role"},
          Row{"stranger", "fraja-ctl", {"jobs"}, "refuses our key"},
          Row{"stranger", "fraja-worker", {"--idle-exit", "1s"}, "every broker has refused it"},
          Row{"stranger", "fraja-submit", with(picture, {"-o", scratch.file("y.png")}),
              "refuses our key"}}) {
        CAPTURE(row.name);
        CAPTURE(row.prog);
        const RunResult refused = as(row.name, row.prog, row.words);
        CAPTURE(refused.err);
        CHECK(refused.exit == 4);
        CHECK(contains(refused.err, row.says));
        CHECK(as(row.name, row.prog, row.words).exit == 4); // logged no second time
    }
    // Who has no key, and who takes it for another farm, are told as well, and soon.
    const RunResult keyless = ask({program("fraja-ctl"), "-b", farm.endpoint(), "jobs"});
    CHECK(keyless.exit == 4);
    CHECK(contains(keyless.err, "--key-file"));
    REQUIRE(farm.broker().wait_for_words(Process::Stream::err, "nobody knows it", patience));
    const std::string& log = farm.broker().err();
    const auto count = [&log](std::string_view words) {
        std::size_t n = 0;
        for (std::size_t at = log.find(words); at != std::string::npos;
             at = log.find(words, at + 1))
            ++n;
        return n;
    };
    CHECK(count("nobody knows it") == 1);
    CHECK(count("refused SubmitJob: the key of eve lacks") == 1);
    CHECK(count("refused ClientHello: the key of worker lacks") == 1);
}

TEST_CASE(
    "a list that is read again takes rights away and gives them, and a bad one changes nothing") {
    const Ring ring;
    ring.allow({{"worker", "worker"}, {"ada", "submit"}});
    Farm farm(ring.broker_options());
    Process& worker = farm.add_worker("one", {"-j", "1", "--key-file", ring.file("worker")});
    const auto jobs = [&](const std::string& name) {
        return ask({program("fraja-ctl"), "-b", farm.endpoint(), "--key-file", ring.file(name),
                    "jobs"})
            .exit;
    };
    const auto reread = [&](const char* words) {
        farm.broker().send(SIGHUP);
        REQUIRE(farm.broker().wait_for_words(Process::Stream::err, words, patience));
    };
    std::ofstream(ring.allow_file()) << "nonsense\n";
    reread("stay as they were: ");
    CHECK(contains(farm.broker().err(), ring.allow_file() + ":1: there is no role 'nonsense'"));
    CHECK(jobs("ada") == 0);
    ring.allow({});
    reread("it names no key, and so would shut out everybody");
    CHECK(jobs("ada") == 0);
    ring.allow({{"ada", "submit"}, {"farm", "admin"}});
    reread("'farm' has the key of the farm's brokers");
    CHECK(jobs("ada") == 0);

    ring.allow({{"ada", "submit"}});
    reread("knows 1 key of");
    REQUIRE(farm.broker().wait_for_words(Process::Stream::err, "its key has lost the role worker",
                                         patience));
    REQUIRE(worker.wait_for_words(Process::Stream::err, "refused by the broker, will ask again",
                                  patience));
    ring.allow({{"worker", "worker"}, {"eve", "watch"}, {"stranger", "submit"}});
    reread("knows 3 keys of");
    int connected = 0; // it asks again by itself
    REQUIRE(worker.wait_for_line(
        Process::Stream::err,
        [&](std::string_view line) { return contains(line, "connected: ") && ++connected == 2; },
        patience));
    CHECK(jobs("ada") == 4);
    CHECK(jobs("stranger") == 0);
}

TEST_CASE("a key that names a farm's is not told to be one itself") {
    const Scratch scratch;
    const auto farm = run({{program("fraja-ctl"), "keygen", "-o", scratch.file("farm")}}, patience);
    REQUIRE(farm.has_value());
    REQUIRE(farm->exit == 0);
    CHECK(contains(farm->err, "lets it in, as the key of a farm it is what --broker-key names\n"));
    const std::string key = farm->out.substr(0, farm->out.find('\n'));
    const auto own =
        run({{program("fraja-ctl"), "keygen", "-o", scratch.file("ada"), "--broker-key", key}},
            patience);
    REQUIRE(own.has_value());
    CHECK(own->exit == 0);
    CHECK(contains(own->err, "in the allow-list of fraja-broker lets it in\n"));
}

TEST_CASE("no secret shows in arguments, logs, errors or core dumps") {
    const Ring ring;
    ring.allow({{"worker", "worker"}, {"ada", "submit,admin"}});
    Farm farm(with(ring.broker_options(), {"--log-level", "debug"}));
    Process& worker = farm.add_worker(
        "one", {"-j", "1", "--log-level", "debug", "--key-file", ring.file("worker")});
    std::string said;
    for (const Words& words : {Words{"fraja-ctl", "doctor"}, Words{"fraja-ctl", "--json", "jobs"},
                               Words{"fraja-ctl", "keygen", "-o", ring.file("ada")},
                               Words{"fraja-submit", scene("cone"), "-r", "8x6", "--stats", "-o",
                                     ring.scratch("s.png")}}) {
        const RunResult ran = ask(with({program(words[0]), "-b", farm.endpoint(), "--key-file",
                                        ring.file("ada"), "--log-level", "debug"},
                                       Words(words.begin() + 1, words.end())));
        said += ran.out + ran.err;
    }
    said += ask({program("fraja-submit"), "--check-settings"}).out;
    farm.broker().send(SIGUSR1);
    REQUIRE(farm.broker().wait_for_words(Process::Stream::err, "1 job, ", patience));
    for (Process* process : {&farm.broker(), &worker}) {
        const std::string proc = "/proc/" + std::to_string(process->pid());
        std::ifstream arguments(proc + "/cmdline");
        said += std::string(std::istreambuf_iterator<char>(arguments), {});
        struct stat status {};
        REQUIRE(stat((proc + "/mem").c_str(), &status) == 0);
        CHECK(status.st_uid == 0); // it cannot be dumped, so it is root's
        std::ifstream limits(proc + "/limits");
        const std::string text(std::istreambuf_iterator<char>(limits), {});
        CHECK(contains(text, "Max core file size        0"));
        said += process->out() + process->err();
    }
    for (const char* name : {"farm", "worker", "ada"}) {
        // Any eight characters of it would be too much.
        const std::string secret = ring.secret(name);
        for (std::size_t at = 0; at + 8 <= secret.size(); ++at)
            CHECK(!contains(said, secret.substr(at, 8)));
    }
    // A file that others may read is not read.
    REQUIRE(chmod(ring.file("ada").c_str(), 0644) == 0);
    const RunResult refused =
        ask({program("fraja-ctl"), "-b", farm.endpoint(), "--key-file", ring.file("ada"), "jobs"});
    CHECK(refused.exit == 2);
    CHECK(contains(refused.err, "chmod 600 "));
}

TEST_CASE("workers that listen are called by whoever may submit, and a list that is read again "
          "holds for them, too") {
    const Ring ring;
    ring.allow({{"ada", "submit"}, {"eve", "watch"}});
    auto [worker, endpoint] = start_listening(ring);
    const Scratch scratch;
    const Words picture = {scene("cone"), "-r", "40x30"};
    const std::string want = local_picture(scratch, picture);
    const auto draw = [&](const Words& keys, const char* timeout) {
        return submit(with(with(picture, {"--direct", endpoint, "--connect-timeout", timeout, "-o",
                                          scratch.file("direct.png")}),
                           keys));
    };
    const auto as = [&](const char* name) { return Words{"--key-file", ring.file(name)}; };
    const auto reread = [&](const char* words) {
        worker.send(SIGHUP);
        INFO(worker.story());
        REQUIRE(worker.wait_for_words(Process::Stream::err, words, patience));
    };
    for (const Words& nobody : {Words{}, as("eve"), as("stranger")})
        CHECK(draw(nobody, "2s").exit == 3);
    const RunResult drawn = draw(as("ada"), "60s");
    INFO(drawn.err);
    REQUIRE(drawn.exit == 0);
    CHECK((bytes_of(scratch.file("direct.png")) == want));

    std::ofstream(ring.allow_file()) << "nonsense\n";
    reread("stay as they were: ");
    ring.allow({{"eve", "submit"}});
    reread("knows 1 key of");
    CHECK(draw(as("ada"), "2s").exit == 3);
    CHECK(draw(as("eve"), "60s").exit == 0);
    worker.send(SIGTERM);
    CHECK(worker.wait_for_exit(patience) == 0);
}

TEST_CASE("a caller that loses the right in the middle of a job is heard no more") {
    const Ring ring;
    ring.allow({{"ada", "submit"}, {"eve", "submit"}});
    auto [worker, endpoint] = start_listening(ring);
    const Scratch scratch;
    const Words direct = {"--direct", endpoint, "--key-file"};
    auto endless = Process::start(
        {with({program("fraja-submit"), scene("overlapping_spheres"), "-r", "640x480", "-a", "16",
               "--tile", "4", "-o", scratch.file("endless.png")},
              with(direct, {ring.file("ada")}))});
    REQUIRE(endless.has_value());
    REQUIRE(worker.wait_for_words(Process::Stream::err, "connected: ", patience));
    ring.allow({{"eve", "submit"}});
    worker.send(SIGHUP);
    INFO(worker.story());
    REQUIRE(worker.wait_for_words(Process::Stream::err, "the caller is gone", patience));
    CHECK(submit(with({scene("cone"), "-r", "8x6", "-o", scratch.file("next.png")},
                      with(direct, {ring.file("eve")})))
              .exit == 0);
    endless->send(SIGKILL);
    CHECK(endless->wait_for_exit(patience) == -SIGKILL);
}

TEST_CASE("a tree of brokers with keys: a branch has a key of its own, or the farm's") {
    const Ring ring;
    ring.allow({{"branch", "worker"}, {"worker", "worker"}, {"ada", "submit"}});
    ring.allow({{"worker", "worker"}}, "allow-below");
    Farm root(ring.broker_options());
    const Words below = {"--heartbeat", heartbeat_option, "--upstream", root.endpoint()};
    Farm own(
        with(below, {"--key-file", ring.file("branch"), "--allow", ring.scratch("allow-below")}));
    Farm same(with(below, ring.farm_options()));
    Farm unknown(
        with(below, {"--key-file", ring.file("eve"), "--allow", ring.scratch("allow-below")}));
    for (const auto& [farm, key] :
         {std::pair(&own, "branch"), std::pair(&same, "farm"), std::pair(&unknown, "eve")})
        farm->add_worker(
            "leaf", {"-j", "1", "--key-file", ring.file("worker"), "--broker-key", ring.key(key)});
    for (Farm* farm : {&own, &same})
        REQUIRE(root.broker().wait_for_words(
            Process::Stream::err, ":" + std::to_string(farm->broker().pid()) + " is here",
            patience));
    REQUIRE(unknown.broker().wait_for_words(Process::Stream::err,
                                            "the broker does not let this worker in", patience));
    const Scratch scratch;
    const Words picture = long_picture();
    const RunResult drawn = root.submit(
        with(picture, {"--key-file", ring.file("ada"), "-o", scratch.file("tree.png")}));
    INFO(drawn.err);
    REQUIRE(drawn.exit == 0);
    CHECK((bytes_of(scratch.file("tree.png")) == local_picture(scratch, picture)));
    CHECK(
        !contains(root.broker().err(), ":" + std::to_string(unknown.broker().pid()) + " is here"));
}
