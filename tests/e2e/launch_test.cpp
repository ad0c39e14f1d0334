// What starts workers on other machines: tools/ssh-farm through a true sshd, and the jobs of
// tools/slurm as Slurm would run them (tools/slurm/try has a true one).
#include "tests/e2e/farm.hpp"

#include <arpa/inet.h>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

using namespace fraja;
using namespace fraja::e2e;

namespace {

const std::string ssh_farm = FRAJA_SOURCE_DIR "/tools/ssh-farm";
const std::string slurm = FRAJA_SOURCE_DIR "/tools/slurm/";
constexpr const char* sshd_program = "/usr/sbin/sshd";

void write(const std::string& path, const std::string& text) {
    std::ofstream(path) << text;
}
/// A program of ours in the place of another one.
void write_script(const std::string& path, const std::string& text) {
    write(path, "#!/bin/sh\n" + text);
    fs::permissions(path, fs::perms::owner_all);
}

/// That nobody has just now.
std::uint16_t free_port() {
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    REQUIRE(bind(fd, reinterpret_cast<const sockaddr*>(&address), size) == 0);
    REQUIRE(getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) == 0);
    close(fd);
    return ntohs(address.sin_port);
}

std::string out_of(const Words& argv) {
    const auto ran = run({argv}, patience);
    REQUIRE(ran.has_value());
    INFO(ran->err);
    REQUIRE(ran->exit == 0);
    return ran->out;
}

/// An sshd of this user, on this machine, which is called one, two and three; nobody is at
/// `absent`. What its sessions keep is in scratch.file("there").
class Machines {
public:
    explicit Machines(const Scratch& scratch) : scratch_(scratch) {
        const auto file = [&](const char* name) { return scratch.file(name); };
        if (geteuid() == 0)
            fs::create_directories("/run/sshd"); // where it confines what nobody trusts yet
        for (const char* key : {"host_key", "user_key"})
            out_of({"ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", file(key)});
        const std::string known = bytes_of(file("host_key.pub"));
        while (!sshd_) { // somebody else may have taken the port meanwhile
            const std::string port = std::to_string(free_port());
            write(file("sshd_config"), "ListenAddress 127.0.0.1:" + port + "\nHostKey " +
                                           file("host_key") + "\nAuthorizedKeysFile " +
                                           file("user_key.pub") +
                                           "\nPidFile none\nUsePAM no\nStrictModes no\n"
                                           "PasswordAuthentication no\n"
                                           "KbdInteractiveAuthentication no\n"
                                           "SetEnv XDG_CACHE_HOME=" +
                                           file("there") + "\n");
            write(file("known"), "farm " + known);
            write(file("ssh_config"),
                  "Host one two three\n  Port " + port + "\nHost absent\n  Port " +
                      std::to_string(free_port()) +
                      "\nHost *\n  HostName 127.0.0.1\n  HostKeyAlias farm\n  IdentityFile " +
                      file("user_key") + "\n  IdentitiesOnly yes\n  UserKnownHostsFile " +
                      file("known") + "\n  GlobalKnownHostsFile /dev/null\n");
            auto started = Process::start({{sshd_program, "-D", "-e", "-f", file("sshd_config")}});
            REQUIRE(started.has_value());
            if (started->wait_for_words(Process::Stream::err, "Server listening", patience))
                sshd_ = std::move(*started);
        }
    }

    [[nodiscard]] Words command(const std::string& hosts, const Words& options) const {
        write(scratch_.file("hosts.txt"), hosts);
        return with(
            {ssh_farm, scratch_.file("hosts.txt"), "--ssh-config", scratch_.file("ssh_config")},
            options);
    }
    [[nodiscard]] Words environment() const {
        return {"XDG_RUNTIME_DIR=" + scratch_.file(""),
                "PATH=" + std::string(FRAJA_BIN_DIR) + ":" + std::getenv("PATH")};
    }
    [[nodiscard]] RunResult farm(const std::string& hosts, const Words& options) const {
        auto ran = run({command(hosts, options), environment()}, patience);
        REQUIRE(ran.has_value());
        return *std::move(ran);
    }

private:
    const Scratch& scratch_;
    std::optional<Process> sshd_;
};

/// Whether this test can be made here. CI's machines have what it needs.
bool has_sshd() {
    if (fs::exists(sshd_program))
        return true;
    REQUIRE_MESSAGE(std::getenv("CI") == nullptr, "there is no sshd: tools/packages ci");
    MESSAGE("no sshd (Debian's openssh-server): tools/ssh-farm is NOT tested");
    return false;
}

} // namespace

TEST_CASE("what ssh-farm cannot do is told before anybody is called") {
    const Scratch scratch;
    const std::string hosts = scratch.file("hosts.txt");
    struct Row {
        std::string text;
        Words options;
        std::string says;
    };
    for (const Row& row : {
             Row{"a\n", {}, "whom do they serve?"},
             Row{"# a\n\n", {"--status"}, "names no machine"},
             Row{"a\nb c\na -j 2\n", {"--status"}, "hosts.txt:3: a stands in line 1 already"},
             Row{"a;b\n", {"--status"}, "hosts.txt:1: 'a;b' is no machine"},
             Row{"-oProxyCommand=x\n", {"--status"}, "'-oProxyCommand=x' is no machine"},
             Row{"a@-b\n", {"--status"}, "'a@-b' is no machine"},
             Row{"a\n", {"--tunnel", "--broker", "x"}, "--broker x: with --tunnel one"},
             Row{"a\n", {"--parallel", "0"}, "--parallel 0"},
             Row{"a\n", {"--nonsense"}, "there is no option '--nonsense'"},
             Row{"a\n", {"--broker", "h:1", "--key-file", "/no/such"}, "/no/such: cannot be read"},
         }) {
        CAPTURE(row.says);
        write(hosts, row.text);
        const auto ran = run({with({ssh_farm, hosts}, row.options),
                              {"FRAJA_BROKER=", "XDG_RUNTIME_DIR=" + scratch.file("")}},
                             patience);
        REQUIRE(ran.has_value());
        CAPTURE(ran->err);
        CHECK(ran->exit == 2);
        CHECK(contains(ran->err, row.says));
    }
}

TEST_CASE("ssh-farm starts workers through tunnels, names who failed, and stops them") {
    if (!has_sshd())
        return;
    const Scratch scratch;
    const Machines machines(scratch);
    Farm farm;
    const std::string hosts = "one -j 1\n# nobody\ntwo -j 1 --tag x # its own\nabsent -j 1\n";
    const Words tunnel = {"--tunnel", "--broker", farm.endpoint(), "--parallel", "2"};
    const RunResult started = machines.farm(hosts, tunnel);
    INFO(started.out << started.err);
    CHECK(started.exit == 1);
    CHECK(contains(started.out, "ok   one "));
    CHECK(contains(started.out, "ok   two "));
    CHECK(contains(started.out, "FAIL absent "));
    CHECK(contains(started.err, "1 of 3 did not: absent"));

    const Words picture = {scene("cone"), "-r", "80x60"};
    const std::string drawn = scratch.file("farm.png");
    CHECK(farm.submit(with(picture, {"-o", drawn})).exit == 0);
    CHECK((bytes_of(drawn) == local_picture(scratch, picture)));

    const std::string both = "one\ntwo\n";
    const RunResult again = machines.farm(both, tunnel);
    CHECK(again.exit == 0);
    CHECK(contains(again.out, "runs already"));
    const RunResult status = machines.farm(both, {"--status"});
    CHECK(status.exit == 0);
    CHECK(contains(status.out, "serves with 1 thread") == false);
    CHECK(contains(status.out, "1 thread"));

    const RunResult stopped = machines.farm(both, {"--stop"});
    INFO(stopped.out << stopped.err);
    CHECK(stopped.exit == 0);
    CHECK(contains(stopped.out, "has finished and left"));
    for (const char* name : {"one", "two"})
        CHECK(farm.broker().wait_for_words(
            Process::Stream::err, std::string(name) + " is gone (it said goodbye)", patience));
    const RunResult nobody = machines.farm(both, {"--status"});
    CHECK(nobody.exit == 1);
    CHECK(contains(nobody.out, "no worker"));
    CHECK_FALSE(fs::exists(scratch.file("fraja-" + std::to_string(getuid())))); // no tunnel
}

TEST_CASE("Ctrl-C ends ssh-farm and all that it started") {
    if (!has_sshd())
        return;
    const Scratch scratch;
    const Machines machines(scratch);
    Farm farm;
    auto stays = Process::start(
        {machines.command("one\ntwo\nthree\n", {"--stay", "--broker", farm.endpoint(), "--binary",
                                                program("fraja-worker")}),
         machines.environment()});
    REQUIRE(stays.has_value());
    const bool ready = stays->wait_for_words(Process::Stream::out, "ready", patience).has_value();
    INFO(stays->story());
    REQUIRE(ready);
    stays->send(SIGINT);
    CHECK(stays->wait_for_exit(patience) == 130);
    for (const char* name : {"one", "two", "three"})
        CHECK(farm.broker().wait_for_words(
            Process::Stream::err, std::string(name) + " is gone (it said goodbye)", patience));
    CHECK_FALSE(fs::exists(scratch.file("fraja-" + std::to_string(getuid()))));
}

TEST_CASE("ssh-farm starts no worker of another version, and leaves none that ended") {
    if (!has_sshd())
        return;
    const Scratch scratch;
    const Machines machines(scratch);
    const std::string other = scratch.file("other");
    write_script(other, "echo 'fraja-worker 0.0.9, revision 1, x86-64-v2'\n");
    struct Row {
        Words options;
        std::string says;
    };
    for (const Row& row :
         {Row{{"--binary", other}, other + " is fraja-worker 0.0.9 there, and fraja-worker "},
          Row{{"--binary", "/no/such"}, "/no/such does not run there"},
          Row{{}, "it has ended: fraja-worker: error: there is no option '--nonsense'"}}) {
        CAPTURE(row.says);
        const RunResult ran =
            machines.farm("one --nonsense\n", with({"--broker", "127.0.0.1:1"}, row.options));
        INFO(ran.out << ran.err);
        CHECK(ran.exit == 1);
        CHECK(contains(ran.out, row.says));
        CHECK(machines.farm("one\n", {"--status"}).exit == 1);
    }
}

TEST_CASE("Slurm's jobs find each other by a file, and leave as they should") {
    const Scratch scratch;
    const std::string file = scratch.file("farm.endpoint");
    write_script(scratch.file("scontrol"), "echo \"$@\" >>" + scratch.file("said") + "\n");
    const Words env = {"FRAJA_BROKER=",
                       "FRAJA_BROKER_FILE=" + file,
                       "FRAJA_BIN=" FRAJA_BIN_DIR,
                       "FRAJA_BIND=tcp://127.0.0.1:0",
                       "FRAJA_PUBLISH=tcp://127.0.0.1:0",
                       "FRAJA_STATE=none",
                       "FRAJA_BROKER_LOOK=0.1",
                       "FRAJA_WORKER_OPTIONS=--tag room=7 --tag x",
                       "SLURMD_NODENAME=node5",
                       "SLURM_ARRAY_JOB_ID=17",
                       "SLURM_ARRAY_TASK_ID=3",
                       "SLURM_CPUS_PER_TASK=1",
                       "PATH=" + scratch.file("") + ":" + std::getenv("PATH")};
    const auto start = [&](const std::string& script) {
        auto process = Process::start({{"bash", slurm + script}, env});
        REQUIRE(process.has_value());
        return std::move(*process);
    };
    const auto err = Process::Stream::err;
    Process worker = start("fraja-worker.sbatch"); // first: it waits
    INFO(worker.story());
    REQUIRE(worker.wait_for_words(err, "waits for a broker to write " + file, patience));
    Process broker = start("fraja-broker.sbatch");
    REQUIRE(worker.wait_for_words(err, "'node5:17_3' serves with 1 thread", patience));
    REQUIRE(worker.wait_for_words(err, "connected: broker", patience));
    REQUIRE(broker.wait_for_words(err, "listens at tcp://127.0.0.1:", patience));
    const std::string endpoint = bytes_of(file).substr(0, bytes_of(file).find('\n'));

    const Words picture = {scene("cone"), "-r", "80x60", "--tag", "room=7"};
    const std::string drawn = scratch.file("farm.png");
    CHECK(submit(with(picture, {"-b", endpoint, "-o", drawn})).exit == 0);
    CHECK((bytes_of(drawn) == local_picture(scratch, {scene("cone"), "-r", "80x60"})));

    Process moved = start("fraja-broker.sbatch"); // as another job, or the same on another node
    REQUIRE(worker.wait_for_words(err, "the broker has moved to tcp://127.0.0.1:", patience));
    while (!fs::exists(scratch.file("said")))
        CHECK_FALSE(worker.wait_for_exit(10ms).has_value());
    broker.send(SIGTERM);
    CHECK(broker.wait_for_exit(patience) == 0);
    CHECK(fs::exists(file)); // it is the other one's by now
    worker.send(SIGTERM);
    CHECK(worker.wait_for_exit(patience) == 0);
    CHECK(bytes_of(scratch.file("said")) == "requeue 17_3\n");
    moved.send(SIGTERM);
    CHECK(moved.wait_for_exit(patience) == 0);
    CHECK_FALSE(fs::exists(file));

    const auto late = run(
        {{"bash", slurm + "fraja-worker.sbatch"}, with(env, {"FRAJA_BROKER_WAIT=0"})}, patience);
    REQUIRE(late.has_value());
    CHECK(late->exit == 3);
    CHECK(contains(late->err, "no broker has written " + file));
    const auto busy = run({{"bash", slurm + "fraja-broker.sbatch", "--nonsense"}, env}, patience);
    REQUIRE(busy.has_value());
    CHECK(busy->exit == 2);
    CHECK_FALSE(fs::exists(file));
}

TEST_CASE("slurm/submit gives Slurm the jobs of a farm") {
    const Scratch scratch;
    // Says what it was told, and a job's id as sbatch does where there are several clusters.
    write_script(scratch.file("sbatch"), "echo \"$@\" | sed 's|/[^ ]*/||' >>" +
                                             scratch.file("said") +
                                             "\nenv | grep ^FRAJA_ | sort >>" +
                                             scratch.file("said") + "\necho '41;cluster'\n");
    const std::string file = scratch.file("farm.endpoint"), keys = scratch.file("keys");
    const auto submit_farm = [&](const Words& options, const Words& env = {}) {
        fs::remove(scratch.file("said"));
        auto ran = run(
            {with({slurm + "submit", "--bin", FRAJA_BIN_DIR}, options),
             with({"FRAJA_BROKER=", "PATH=" + scratch.file("") + ":" + std::getenv("PATH")}, env)},
            patience);
        REQUIRE(ran.has_value());
        return *std::move(ran);
    };
    const auto said = [&] { return bytes_of(scratch.file("said")); };

    const RunResult both =
        submit_farm({"--workers", "9", "--cpus", "4", "--time", "1:00", "--insecure",
                     "--broker-file", file, "--", "--partition=p"});
    INFO(both.err);
    CHECK(both.out == "broker 41\nworkers 41\n");
    CHECK(contains(said(), "--parsable --export=ALL --time=1:00 --partition=p fraja-broker.sbatch "
                           "--insecure\n"));
    CHECK(contains(said(), "--array=1-9 --cpus-per-task=4 --time=1:00 --partition=p "
                           "fraja-worker.sbatch\n"));
    CHECK(contains(said(), "FRAJA_BROKER_FILE=" + file + "\n"));
    CHECK(contains(said(), "FRAJA_STATE=" + file + ".state\n"));
    CHECK_FALSE(contains(said(), "FRAJA_BROKER="));

    write(keys, "not looked into\n");
    fs::permissions(keys, fs::perms::owner_read);
    const RunResult workers = submit_farm(
        {"--broker", "tcp://h:1", "--key-file", keys, "--worker-options", "--tag a --once"});
    CHECK(workers.out == "workers 41\n");
    CHECK(contains(said(), "FRAJA_BROKER=tcp://h:1\n"));
    CHECK(contains(said(), "FRAJA_KEY_FILE=" + keys + "\n"));
    CHECK(contains(said(), "FRAJA_WORKER_OPTIONS=--tag a --once\n"));
    CHECK_FALSE(contains(said(), "fraja-broker.sbatch"));

    // The broker's keys are not the workers'.
    const std::string own = scratch.file("broker.key"), allow = scratch.file("allow");
    write(own, "not looked into\n");
    write(allow, "not looked into\n");
    fs::permissions(own, fs::perms::owner_read);
    const RunResult keyed = submit_farm(
        {"--broker-file", file, "--key-file", keys, "--broker-key-file", own, "--allow", allow});
    INFO(keyed.err);
    CHECK(keyed.out == "broker 41\nworkers 41\n");
    const std::string parts = said();
    const std::size_t middle = parts.find("fraja-worker.sbatch");
    REQUIRE(middle != std::string::npos);
    CHECK(parts.find("FRAJA_KEY_FILE=" + own + "\n") < middle);
    CHECK(parts.find("FRAJA_ALLOW=" + allow + "\n") < middle);
    CHECK(parts.find("FRAJA_KEY_FILE=" + keys + "\n") > middle);
    CHECK(parts.find("FRAJA_ALLOW=", middle) == std::string::npos);

    write(file, "tcp://h:2\n");
    const std::string open = scratch.file("open");
    write(open, "");
    struct Row {
        Words options;
        std::string says;
    };
    for (const Row& row :
         {Row{{"--insecure", "--broker-file", file}, "says that a broker runs at tcp://h:2"},
          Row{{"--workers", "2"}, "or --insecure, only on a network that you trust"},
          Row{{"--broker", "h:1", "--broker-file", file}, "exclude each other"},
          Row{{"--workers", "0"}, "--workers 0"},
          Row{{"--partition=p"}, "those of sbatch stand behind --"},
          Row{{"--insecure", "--broker-file", "/no/such/file"}, "there is no such directory"},
          Row{{"--key-file", keys}, "--broker-key-file and --allow"},
          Row{{"--broker", "h:1", "--allow", allow}, "names one that runs"},
          Row{{"--broker", "h:1", "--key-file", open}, "others may read it"}}) {
        CAPTURE(row.says);
        const RunResult refused = submit_farm(row.options);
        CHECK(refused.exit == 2);
        CHECK(refused.out.empty());
        CAPTURE(refused.err);
        CHECK(contains(refused.err, row.says));
        CHECK_FALSE(fs::exists(scratch.file("said")));
    }
    // Nobody else reaches it there, so it starts without keys as well; at one of the two they do.
    const std::string other = scratch.file("other.endpoint");
    const Words bind{"FRAJA_BIND=tcp://127.0.0.1:0"};
    CHECK(submit_farm({"--broker-file", other}, bind).exit == 2);
    CHECK(submit_farm({"--broker-file", other}, with(bind, {"FRAJA_PUBLISH=tcp://[::1]:0"})).exit ==
          0);
}
