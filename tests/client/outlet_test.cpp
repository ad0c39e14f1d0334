#include "client/outlet.hpp"

#include <array>
#include <csignal>
#include <cstdlib>
#include <doctest/doctest.h>
#include <fcntl.h>
#include <string>
#include <unistd.h>

using namespace fraja;
using namespace fraja::client;

namespace {

class Pipe {
public:
    Pipe() { REQUIRE(::pipe2(ends_.data(), O_CLOEXEC) == 0); }
    ~Pipe() {
        for (const int end : ends_)
            ::close(end);
    }
    Pipe(const Pipe&) = delete;
    Pipe& operator=(const Pipe&) = delete;
    [[nodiscard]] int write_end() const { return ends_[1]; }
    /// What is there, up to that much.
    [[nodiscard]] std::string read(std::size_t bytes_max) const {
        std::string text(bytes_max, '\0');
        const ssize_t n = ::read(ends_[0], text.data(), text.size());
        text.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
        return text;
    }

private:
    std::array<int, 2> ends_{};
};

} // namespace

TEST_CASE("a reader that takes nothing keeps nobody waiting, and later gets all of it in order") {
    const Pipe pipe;
    Outlet outlet(pipe.write_end());
    std::string want;
    for (int i = 0; i < 50'000; ++i) { // more than a pipe holds
        const std::string line = std::to_string(i) + "\n";
        want += line;
        outlet.put(line);
        outlet.pump();
    }
    CHECK_FALSE(outlet.is_empty());
    std::string got;
    while (got.size() < want.size()) {
        got += pipe.read(10'000);
        outlet.pump();
    }
    CHECK(outlet.is_empty());
    CHECK((got == want));
    CHECK_FALSE(outlet.has_failed());
}

TEST_CASE("a signal ends the wait for a reader") {
    const Pipe pipe;
    sigset_t before;
    pthread_sigmask(SIG_BLOCK, nullptr, &before);
    {
        const net::SignalWatch signals({SIGUSR2});
        Outlet outlet(pipe.write_end());
        outlet.put(std::string(1'000'000, 'x'));
        ::raise(SIGUSR2);
        CHECK(outlet.drain(&signals) == SIGUSR2);
    }
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

TEST_CASE("what a full disk does not take is known to be lost, and nothing more is kept") {
    const int full = ::open("/dev/full", O_WRONLY | O_CLOEXEC);
    REQUIRE(full >= 0);
    Outlet outlet(full);
    outlet.put("gone");
    CHECK_FALSE(outlet.drain(nullptr).has_value());
    CHECK(outlet.has_failed());
    CHECK(outlet.is_empty());
    ::close(full);
}
