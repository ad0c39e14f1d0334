// systemd's units: what they start, under a service manager that listens as systemd does.
#include "tests/e2e/farm.hpp"

#include <array>
#include <csignal>
#include <cstring>
#include <poll.h>
#include <sstream>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

using namespace fraja;
using namespace fraja::e2e;

namespace {

/// The socket that services tell how they are.
class Manager {
public:
    explicit Manager(std::string path) : path_(std::move(path)) {
        sockaddr_un address{};
        address.sun_family = AF_UNIX;
        REQUIRE(path_.size() < sizeof address.sun_path);
        path_.copy(address.sun_path, path_.size());
        REQUIRE(bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
    }
    ~Manager() { close(fd_); }
    Manager(const Manager&) = delete;
    Manager& operator=(const Manager&) = delete;

    /// What a service is started with. Its watchdog would bite after three seconds.
    [[nodiscard]] Words environment() const {
        return {"NOTIFY_SOCKET=" + path_, "WATCHDOG_USEC=3000000"};
    }
    /// Waits for these words; all that was said up to them.
    /// Drops what has been said so far.
    void forget() const {
        std::array<char, 4096> bytes;
        while (recv(fd_, bytes.data(), bytes.size(), MSG_DONTWAIT) > 0) {
        }
    }
    std::string wait_for(std::string_view words) const {
        std::string all;
        for (;;) {
            pollfd readable{fd_, POLLIN, 0};
            const auto timeout = std::chrono::duration_cast<std::chrono::milliseconds>(patience);
            INFO(all);
            REQUIRE(poll(&readable, 1, static_cast<int>(timeout.count())) == 1);
            std::array<char, 4096> bytes;
            const auto size = recv(fd_, bytes.data(), bytes.size(), 0);
            REQUIRE(size > 0);
            const std::string said(bytes.data(), static_cast<std::size_t>(size));
            all += said + "\n";
            if (contains(said, words))
                return all;
        }
    }

private:
    std::string path_;
    int fd_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
};

std::string replaced(std::string text, const std::string& what, const std::string& by) {
    for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size())
        text.replace(at, what.size(), by);
    return text;
}

/// The value of a key that a unit has once.
std::string value(const std::string& unit, const std::string& key) {
    std::istringstream lines(
        bytes_of(std::string(FRAJA_SOURCE_DIR) + "/tools/systemd/" + unit + ".service"));
    std::string found;
    int times = 0;
    for (std::string line; std::getline(lines, line);)
        if (line.starts_with(key + "=")) {
            found = line.substr(key.size() + 1);
            ++times;
        }
    CAPTURE(key);
    REQUIRE(times == 1);
    return found;
}

/// A unit's command as systemd would run it, with the built programs in the place of those
/// installed, by a shell.
Process start(const std::string& command, const Words& environment) {
    auto process = Process::start(
        {{"sh", "-c", "exec " + replaced(command, "/usr/bin/", program(""))}, environment});
    REQUIRE(process.has_value());
    return std::move(*process);
}

} // namespace

TEST_CASE("the broker's unit starts one that is ready, alive, and says that it stops") {
    const Scratch scratch;
    const Manager manager(scratch.file("notify"));
    CHECK(value("fraja-broker", "Type") == "notify");
    const std::string command =
        replaced(value("fraja-broker", "ExecStart"), "127.0.0.1:50059", "127.0.0.1:0");
    Process broker = start(command, with(manager.environment(),
                                         {"STATE_DIRECTORY=" + scratch.file("state"),
                                          "FRAJA_BROKER_OPTIONS=--bind tcp://127.0.0.1:0 --publish "
                                          "tcp://127.0.0.1:0"}));
    INFO(broker.story());
    CHECK(contains(manager.wait_for("READY=1"), "STATUS=0 workers"));
    CHECK(fs::exists(scratch.file("state")));
    manager.wait_for("WATCHDOG=1");
    manager.wait_for("WATCHDOG=1"); // again and again
    broker.send(SIGTERM);
    manager.wait_for("STOPPING=1");
    CHECK(broker.wait_for_exit(patience) == 0);
}

TEST_CASE("the broker's unit reloads it, and the journal gets lines with its own levels") {
    const Scratch scratch;
    const Manager manager(scratch.file("notify"));
    const std::string command =
        replaced(value("fraja-broker", "ExecStart"), "127.0.0.1:50059", "127.0.0.1:0");
    Process broker = start(
        "env JOURNAL_STREAM=$(stat -L -c %d:%i /proc/self/fd/2) " + command, // systemd.exec(5)
        with(manager.environment(), {"STATE_DIRECTORY=" + scratch.file("state"),
                                     "FRAJA_BROKER_OPTIONS=--bind tcp://127.0.0.1:0 "
                                     "--publish tcp://127.0.0.1:0"}));
    manager.wait_for("READY=1");
    INFO(broker.story());
    const auto says = [&](std::string_view words) {
        return broker.wait_for_words(Process::Stream::err, words, patience).has_value();
    };
    CHECK(says("<6>jobs are kept in " + scratch.file("state") + ", for 7 days after they end"));
    Process reload = start(replaced(value("fraja-broker", "ExecReload"), "$$", "$"),
                           {"MAINPID=" + std::to_string(broker.pid())});
    CHECK(reload.wait_for_exit(patience) == 0);
    CHECK(says("<6>read its options again"));
    broker.send(SIGTERM);
    CHECK(broker.wait_for_exit(patience) == 0);
}

TEST_CASE("the worker's unit drains to stop, and hands back at a second TERM") {
    const Scratch scratch;
    Farm farm({"--heartbeat", "2s"}); // a worker that has lost its broker has no tiles
    const Manager manager(scratch.file("notify"));
    CHECK(value("fraja-worker", "Type") == "notify");
    CHECK(value("fraja-worker", "SuccessExitStatus") == "143");
    const Words environment = with(
        manager.environment(), {"FRAJA_BROKER=" + farm.endpoint(), "FRAJA_WORKER_OPTIONS=-j 1"});
    const std::string command = value("fraja-worker", "ExecStart");
    const auto stop = [&](const Process& worker, const std::string& patience_of_unit) {
        std::string by = value("fraja-worker", "ExecStop");
        REQUIRE(contains(by, "timeout 5m "));
        by = replaced(replaced(by, "timeout 5m", "timeout " + patience_of_unit), "$$", "$");
        return start(by, {"MAINPID=" + std::to_string(worker.pid())});
    };

    Process idle = start(command, environment);
    CHECK(contains(manager.wait_for("READY=1"), "serves with 1 thread "));
    manager.wait_for("WATCHDOG=1");
    REQUIRE(farm.broker().wait_for_words(Process::Stream::err, " is here: ", patience));
    Process stopping = stop(idle, "5m");
    manager.wait_for("STOPPING=1");
    CHECK(idle.wait_for_exit(patience) == 0);
    CHECK(stopping.wait_for_exit(patience) == 0); // so systemd goes on

    // One that has a tile which takes longer than anybody waits.
    Process busy = start(command + " --emulate 1@0.001", environment);
    manager.wait_for("READY=1");
    (void)farm.detach({scene("cone"), "-r", "20x15"});
    const auto has_tiles = [&] { // as many as it takes: a single one may be a probe, soon answered
        farm.broker().send(SIGUSR1);
        return farm.broker().wait_for_words(Process::Stream::err, ": 2 of ", 100ms).has_value();
    };
    while (!has_tiles()) {
    }
    manager.forget();
    manager.wait_for("WATCHDOG=1"); // by then the worker knows of them, too:
    manager.wait_for("WATCHDOG=1"); // its loop has turned
    Process impatient = stop(busy, "0.5");
    CHECK(impatient.wait_for_exit(patience) == 0);
    CHECK_FALSE(busy.wait_for_exit(0s).has_value()); // it drains
    busy.send(SIGTERM);                              // as systemd does then
    CHECK(busy.wait_for_exit(patience) == 143);
}
