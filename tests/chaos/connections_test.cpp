// Connections from strangers by the thousand: the broker's memory stays flat, and it goes on
// working. A million of them by tools/chaos.
#include "common/base/rng.hpp"
#include "tests/e2e/farm.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#include <vector>

using namespace fraja;
using namespace fraja::e2e;

namespace {

std::string noise(Rng& rng, std::size_t size) {
    std::string bytes(size, 0);
    for (char& c : bytes)
        c = static_cast<char>(rng.next());
    return bytes;
}

/// ZMTP 3.0 (rfc.zeromq.org/spec/23): signature, version, mechanism, and 32 bytes of nothing.
std::string greeting(const std::string& mechanism = "NULL") {
    std::string bytes("\xff\0\0\0\0\0\0\0\1\x7f\3\0", 12);
    bytes += mechanism;
    bytes.resize(64);
    return bytes;
}

std::string frame(int flags, const std::string& body) {
    if (body.size() < 256)
        return std::string{static_cast<char>(flags), static_cast<char>(body.size())} + body;
    std::string head{static_cast<char>(flags | 2)}; // its length has eight bytes
    for (int shift = 56; shift >= 0; shift -= 8)
        head += static_cast<char>(body.size() >> shift & 255);
    return head + body;
}

std::string ready(const std::string& socket_type) {
    const std::string name = "Socket-Type";
    std::string body = "\5READY";
    body += static_cast<char>(name.size());
    body += name + std::string(3, 0);
    body += static_cast<char>(socket_type.size());
    return frame(4, body + socket_type);
}

/// What a stranger says on its one connection.
std::string speech(Rng& rng) {
    switch (rng.below(6)) {
    case 0:
        return {};
    case 1:
        return noise(rng, rng.below(200));
    case 2:
        return greeting().substr(0, rng.below(64));
    case 3:
        return greeting() + noise(rng, rng.below(200));
    default: {
        std::string bytes = greeting() + ready(rng.below(2) == 0 ? "DEALER" : "SUB");
        for (std::uint64_t i = rng.below(8); i > 0; --i)
            bytes += rng.below(2) == 0
                         ? frame(static_cast<int>(rng.below(2)), noise(rng, rng.below(100)))
                         : frame(0, '\1' + noise(rng, rng.below(600))); // a topic, or too long
        return bytes;
    }
    }
}

/// Each from an address of its own, or ports would run out: all of 127.0.0.0/8 is this machine.
int connect_from_somewhere(Rng& rng, const std::string& endpoint) {
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    REQUIRE(fd >= 0);
    const int late = 1;
    ::setsockopt(fd, IPPROTO_IP, IP_BIND_ADDRESS_NO_PORT, &late, sizeof late);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr =
        htonl(INADDR_LOOPBACK + static_cast<std::uint32_t>(1 + rng.below(60'000)));
    ::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port =
        htons(static_cast<std::uint16_t>(std::stoi(endpoint.substr(endpoint.rfind(':') + 1))));
    REQUIRE(::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
    return fd;
}

/// So many, some of them at a time.
class Strangers {
public:
    Strangers(const Farm& farm, std::uint64_t seed) : farm_(farm), rng_(seed) {}
    ~Strangers() {
        while (!connections_.empty())
            drop_oldest();
    }
    Strangers(const Strangers&) = delete;
    Strangers& operator=(const Strangers&) = delete;

    void come(std::uint64_t count) {
        constexpr std::size_t at_a_time = 100;
        for (std::uint64_t i = 0; i < count; ++i) {
            const int fd = connect_from_somewhere(rng_, rng_.below(2) == 0 ? farm_.endpoint()
                                                                           : farm_.stream());
            const std::string bytes = speech(rng_);
            if (!bytes.empty())
                static_cast<void>(::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL));
            connections_.push_back(fd);
            if (connections_.size() > at_a_time)
                drop_oldest();
        }
    }

private:
    void drop_oldest() {
        ::close(connections_.front());
        connections_.pop_front();
    }

    const Farm& farm_;
    Rng rng_;
    std::deque<int> connections_;
};

} // namespace

TEST_CASE("hostile connections cost the broker no memory") {
    const char* wanted = std::getenv("FRAJA_CONNECTIONS"); // set by tools/chaos
    const std::uint64_t count = wanted ? std::strtoull(wanted, nullptr, 10) : 4'000;
    constexpr double warm_up = 0.25; // of the connections, after which memory counts
    constexpr double growth_max_mib = 16;
    const Scratch scratch;
    const Words picture = {scene("cone"), "-r", "160x120", "-a", "2"};
    const std::string want = local_picture(scratch, picture);
    Farm farm;
    farm.add_worker("one");
    Strangers strangers(farm, 1);
    strangers.come(static_cast<std::uint64_t>(warm_up * static_cast<double>(count)));
    const double before = resident_mib(farm.broker().pid());
    Words words = picture;
    words.insert(words.end(), {"-o", scratch.file("meanwhile.png")});
    Process client = farm.start_submit(words);
    for (int part = 0; part < 100; ++part) { // and the broker's log is read
        strangers.come(count / 134);
        REQUIRE(!farm.broker().wait_for_exit(0s).has_value());
    }
    const double after = resident_mib(farm.broker().pid());
    CHECK(client.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("meanwhile.png")) == want));
    words.back() = scratch.file("after.png");
    CHECK(farm.submit(words).exit == 0);
    CHECK((bytes_of(scratch.file("after.png")) == want));
    std::printf("%llu connections: %.1f MiB before, %.1f after\n",
                static_cast<unsigned long long>(count), before, after);
    if (!instrumented) // sanitizers keep freed memory
        CHECK(after - before < growth_max_mib);
    farm.broker().send(SIGTERM);
    CHECK(farm.broker().wait_for_exit(patience) == 0);
    CHECK(farm.broker().err().find("assert") == std::string::npos);
}

namespace {

/// Of a handshake of CURVE (rfc.zeromq.org/spec/26): less than the whole, or one that nobody's key
/// has made.
std::string beginning_of_handshake(Rng& rng) {
    const std::string whole =
        greeting("CURVE") +
        frame(4, "\5HELLO" + std::string("\1\0", 2) + std::string(72, 0) + noise(rng, 32 + 8 + 80));
    return rng.below(2) == 0 ? whole : whole.substr(0, rng.below(whole.size()));
}

/// Whether the other end has closed it, now or within `timeout`.
bool is_closed(int fd, Duration timeout) {
    const auto end = std::chrono::steady_clock::now() + timeout;
    std::array<char, 4096> bytes;
    for (;;) {
        const ssize_t n = ::recv(fd, bytes.data(), bytes.size(), MSG_DONTWAIT);
        if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR))
            return true;
        if (n > 0)
            continue; // there may be more, or the end
        const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
            end - std::chrono::steady_clock::now());
        if (left.count() <= 0)
            return false;
        pollfd waited{.fd = fd, .events = POLLIN, .revents = 0};
        (void)::poll(&waited, 1, static_cast<int>(left.count()));
    }
}

std::string new_key(const std::string& file) {
    const auto made = run({{program("fraja-ctl"), "keygen", "-o", file}}, patience);
    REQUIRE(made.has_value());
    REQUIRE(made->exit == 0);
    return made->out.substr(0, made->out.find('\n'));
}

} // namespace

TEST_CASE("handshakes that nobody finishes are closed, cost no memory, and keep nobody out") {
    const char* wanted = std::getenv("FRAJA_HANDSHAKES"); // set by tools/chaos
    const std::size_t count = wanted ? std::strtoull(wanted, nullptr, 10) : 3'000;
    constexpr std::size_t at_a_time = 600; // the others wait until these are closed, by the broker
    constexpr double growth_max_mib = 16;
    const Scratch scratch;
    const std::string farm_key = new_key(scratch.file("farm.key"));
    std::ofstream(scratch.file("allow"))
        << "submit " << new_key(scratch.file("ada.key")) << " ada\n";
    Farm farm({"--key-file", scratch.file("farm.key"), "--allow", scratch.file("allow")});
    Rng rng(2);
    std::deque<int> connections;
    double before = 0;
    for (std::size_t i = 0; i < count; ++i) {
        const int fd =
            connect_from_somewhere(rng, rng.below(2) == 0 ? farm.endpoint() : farm.stream());
        const std::string bytes = beginning_of_handshake(rng);
        static_cast<void>(::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL));
        connections.push_back(fd);
        if (connections.size() == at_a_time) {
            const auto asked = run({{program("fraja-ctl"), "-b", farm.endpoint(), "--key-file",
                                     scratch.file("ada.key"), "--broker-key", farm_key, "jobs"}},
                                   patience);
            REQUIRE(asked.has_value());
            CHECK(asked->exit == 0); // beside them all
            for (; !connections.empty(); connections.pop_front()) {
                CHECK(is_closed(connections.front(), patience));
                ::close(connections.front());
            }
            if (before == 0)
                before = resident_mib(farm.broker().pid());
        }
    }
    for (const int fd : connections)
        ::close(fd);
    const double after = resident_mib(farm.broker().pid());
    std::printf("%zu handshakes: %.1f MiB before, %.1f after\n", count, before, after);
    if (!instrumented)
        CHECK(after - before < growth_max_mib);
    CHECK(!farm.broker().wait_for_exit(0s).has_value());
}

namespace {

/// Words before a program's own: it may have so many descriptors, and cannot raise that.
Words with_descriptors(std::size_t count) {
    return {"/bin/sh", "-c", "ulimit -n " + std::to_string(count) + "; exec \"$@\"", "sh"};
}

std::size_t descriptors_of(pid_t pid) {
    const fs::directory_iterator open("/proc/" + std::to_string(pid) + "/fd");
    return static_cast<std::size_t>(std::distance(open, fs::directory_iterator()));
}

/// Connections that are kept open, and what is said on each of them at first.
class Idlers {
public:
    Idlers(const std::string& endpoint, std::size_t count, const std::string& words) {
        Rng rng(3);
        for (std::size_t i = 0; i < count; ++i) {
            connections_.push_back(connect_from_somewhere(rng, endpoint));
            if (!words.empty())
                static_cast<void>(
                    ::send(connections_.back(), words.data(), words.size(), MSG_NOSIGNAL));
        }
    }
    ~Idlers() {
        for (const int fd : connections_)
            ::close(fd);
    }
    Idlers(const Idlers&) = delete;
    Idlers& operator=(const Idlers&) = delete;
    [[nodiscard]] int first() const { return connections_.front(); }

private:
    std::vector<int> connections_;
};

/// Waits until the program has all that it may have.
void wait_until_full(Process& program, std::size_t descriptors) {
    const auto end = std::chrono::steady_clock::now() + patience;
    while (descriptors_of(program.pid()) < descriptors) {
        REQUIRE(std::chrono::steady_clock::now() < end);
        REQUIRE(!program.wait_for_exit(10ms).has_value());
    }
}

} // namespace

TEST_CASE("a broker whose descriptors are all taken serves who is there, and then others again") {
    constexpr std::size_t descriptors = 300, idlers = 400;
    const Scratch scratch;
    const Words small = {scene("cone"), "-r", "160x120"};
    const std::string want = local_picture(scratch, small);
    const std::string want_long = local_picture(scratch, long_picture(), "long.png");
    Farm farm({"--heartbeat", heartbeat_option, "--state", scratch.file("state")},
              with_descriptors(descriptors));
    REQUIRE(farm.broker().wait_for_words(Process::Stream::err, "there is room for ", patience));
    const auto submit_small = [&](const std::string& name, const Words& options) {
        Words words = with(small, {"-o", scratch.file(name)});
        return farm.submit(with(words, options)).exit;
    };

    SUBCASE("by connections that say nothing: they are closed, and a newcomer has its turn") {
        farm.add_worker("one");
        const Idlers silent(farm.endpoint(), idlers, "");
        wait_until_full(farm.broker(), descriptors);
        CHECK(submit_small("meanwhile.png", {"--connect-timeout", "60s"}) == 0);
        CHECK((bytes_of(scratch.file("meanwhile.png")) == want));
        CHECK(is_closed(silent.first(), 0s));
    }
    SUBCASE("by connections that are well formed, and stay") {
        const std::string job = farm.detach(long_picture());
        Process watcher = farm.watch_from_the_start(
            job, {"--json", "--preview", "none", "-o", scratch.file("watched.png")});
        farm.add_worker("one");
        wait_for_tiles(watcher, 1);
        {
            const Idlers friendly(farm.endpoint(), idlers, greeting() + ready("DEALER"));
            wait_until_full(farm.broker(), descriptors);
            CHECK(submit_small("none.png", {"--connect-timeout", "1s"}) == 3);
            CHECK(watcher.wait_for_exit(patience) == 0); // who was there noticed nothing
            CHECK((bytes_of(scratch.file("watched.png")) == want_long));
            CHECK(descriptors_of(farm.broker().pid()) == descriptors);
            CHECK(!is_closed(friendly.first(), 0s));
        }
        CHECK(submit_small("after.png", {"--connect-timeout", "60s"}) == 0);
        CHECK((bytes_of(scratch.file("after.png")) == want));
    }
    farm.broker().send(SIGTERM);
    CHECK(farm.broker().wait_for_exit(patience) == 0);
    const std::string& said = farm.broker().err();
    const std::string why = "no more file descriptors";
    CHECK(said.find(why) == said.rfind(why)); // once
    CHECK(std::count(said.begin(), said.end(), '\n') < 60);
}
