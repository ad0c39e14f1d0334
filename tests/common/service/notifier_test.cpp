#include "common/service/notifier.hpp"

#include <array>
#include <cstddef>
#include <cstdlib>
#include <doctest/doctest.h>
#include <string>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

using namespace fraja;
using namespace fraja::service;
using namespace std::chrono_literals;

namespace {

/// A service manager that listens in the abstract namespace, and the environment it gives.
class Manager {
public:
    Manager() {
        sockaddr_un address{};
        address.sun_family = AF_UNIX;
        const std::string name = "@fraja-notifier-test-" + std::to_string(getpid());
        name.copy(address.sun_path, name.size());
        address.sun_path[0] = '\0';
        const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
        REQUIRE(bind(fd_, reinterpret_cast<const sockaddr*>(&address), size) == 0);
        setenv("NOTIFY_SOCKET", name.c_str(), 1);
    }
    ~Manager() {
        close(fd_);
        for (const char* variable : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"})
            unsetenv(variable);
    }
    /// Empty: nothing was said.
    std::string heard() const {
        std::array<char, 4096> words{};
        const auto size = recv(fd_, words.data(), words.size(), MSG_DONTWAIT);
        return {words.data(), size > 0 ? static_cast<std::size_t>(size) : 0};
    }

private:
    int fd_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
};

} // namespace

TEST_CASE("a service manager hears one datagram for each word, and a status of one line") {
    const Manager manager;
    const Notifier notifier;
    notifier.ready("2 workers");
    CHECK(manager.heard() == "READY=1\nSTATUS=2 workers");
    notifier.status("a name\nWATCHDOG=trigger");
    CHECK(manager.heard() == "STATUS=a name WATCHDOG=trigger");
    notifier.stopping("writes");
    CHECK(manager.heard() == "STOPPING=1\nSTATUS=writes");
    CHECK(manager.heard().empty());
}

TEST_CASE("the watchdog hears as often as it wants to, if there is one") {
    const Manager manager;
    Instant now{1h};
    {
        Notifier notifier;
        notifier.alive(now);
        CHECK(manager.heard().empty());
    }
    setenv("WATCHDOG_USEC", "30000000", 1);
    Notifier notifier;
    int words = 0;
    for (const Instant end = now + 30s; now < end; now = now + 1s) {
        notifier.alive(now);
        words += manager.heard() == "WATCHDOG=1";
    }
    CHECK(words == 3);
}

TEST_CASE("a watchdog of another process, and nonsense, are none") {
    const Manager manager;
    const std::string own = std::to_string(getpid());
    struct Row {
        const char *usec, *pid;
        bool heard;
    };
    for (const Row& row :
         {Row{"1000", own.c_str(), true}, Row{"1000", "1", false}, Row{"0", own.c_str(), false},
          Row{"soon", own.c_str(), false}, Row{"18446744073709551615", own.c_str(), true}}) {
        CAPTURE(row.usec);
        CAPTURE(row.pid);
        setenv("WATCHDOG_USEC", row.usec, 1);
        setenv("WATCHDOG_PID", row.pid, 1);
        Notifier notifier;
        notifier.alive(Instant{24h * 365});
        CHECK(manager.heard().empty() != row.heard);
    }
}

TEST_CASE("without a service manager, and with one that does not read, nothing happens") {
    for (const char* where : {"", "/", "nonsense", "/no/such/socket", "@fraja-nobody-listens",
                              "vsock:1:2", "/dev/null"}) {
        CAPTURE(where);
        setenv("NOTIFY_SOCKET", where, 1);
        Notifier notifier;
        notifier.ready("");
        notifier.alive(Instant{1h});
    }
    const std::string too_long(200, '/');
    setenv("NOTIFY_SOCKET", too_long.c_str(), 1);
    const Notifier unheard;
    unheard.ready("");
    const Manager manager;
    const Notifier notifier;
    for (int i = 0; i < 10'000; ++i) // more than a socket holds
        notifier.status("still here");
    CHECK(manager.heard() == "STATUS=still here");
}
