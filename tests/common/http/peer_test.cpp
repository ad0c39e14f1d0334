#include "common/http/peer.hpp"

#include <array>
#include <doctest/doctest.h>
#include <poll.h>
#include <string>
#include <sys/socket.h>
#include <unistd.h>

using namespace fraja;
using namespace fraja::http;
using namespace std::chrono_literals;

namespace {

constexpr Limits spans{.request_time_max = 5s, .idle_max = 60s, .patience = 7s};
const Instant start{100s};

/// A peer with its other end, in pretend time.
struct Pair {
    Pair() {
        REQUIRE(socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, fds.data()) ==
                0);
        peer.emplace(fds[0], spans, told, start);
    }
    ~Pair() { close(fds[1]); }
    void say(const std::string& text, Instant now) {
        REQUIRE(write(fds[1], text.data(), text.size()) == static_cast<ssize_t>(text.size()));
        peer->ready(POLLIN, now);
    }
    /// How much came, of at most so much.
    [[nodiscard]] std::size_t take(std::size_t size) const {
        std::string bytes(size, '\0');
        const ssize_t taken = read(fds[1], bytes.data(), size);
        return taken < 0 ? 0 : static_cast<std::size_t>(taken);
    }

    std::array<int, 2> fds{};
    const Refusals told = refusals(spans, {});
    std::optional<Peer> peer;
};

Reply large(bool keeps) {
    return {.head = body("head"), .body = body(std::string(50'000'000, 'x')), .keeps = keeps};
}

} // namespace

TEST_CASE("how long a peer is borne depends on what it is waited for") {
    Pair pair;
    Peer& peer = *pair.peer;
    CHECK(peer.stage() == Stage::idle);
    CHECK(peer.deadline() == start + 60s);
    pair.say("GET / HTTP/1.1\r\n", start + 1s);
    CHECK(peer.stage() == Stage::asking);
    CHECK(peer.deadline() == start + 6s);
    pair.say("A: b\r\n", start + 5s); // no more time for that
    CHECK(peer.deadline() == start + 6s);
    pair.say("\r\nGET", start + 5s);
    CHECK(peer.stage() == Stage::answering);
    CHECK(peer.deadline() == Instant::never());
    CHECK(peer.events() == 0);
    CHECK(peer.take_request() == "GET / HTTP/1.1\r\nA: b\r\n\r\n");
    CHECK(peer.take_request() == std::nullopt);
    peer.reply({.head = body("head"), .keeps = true}, start + 20s);
    CHECK(peer.stage() == Stage::asking); // the next has begun
    CHECK(peer.deadline() == start + 25s);
    peer.expire(start + 25s); // is told so
    CHECK(peer.stage() == Stage::leaving);
    CHECK(peer.deadline() == start + 32s);
    pair.say("more", start + 31s);
    CHECK(peer.deadline() == start + 32s);
    peer.expire(start + 32s);
    CHECK(peer.stage() == Stage::over);
}

TEST_CASE("an answer is under way as long as any of it is taken") {
    Pair pair;
    Peer& peer = *pair.peer;
    peer.reply(large(/*keeps=*/true), start);
    CHECK(peer.stage() == Stage::sending);
    CHECK(peer.deadline() == start + 7s);
    // Not so much that the socket is ready for more.
    CHECK(pair.take(100'000) > 0);
    peer.expire(start + 7s);
    CHECK(peer.stage() == Stage::sending);
    CHECK(peer.deadline() == start + 14s);
    while (pair.take(100'000) > 0) {
    }
    peer.ready(POLLOUT, start + 10s);
    CHECK(peer.stage() == Stage::sending);
    CHECK(peer.deadline() == start + 17s);
    peer.expire(start + 17s);
    CHECK(peer.stage() == Stage::over);
}

TEST_CASE("lines are wanted when those before are taken") {
    Pair pair;
    Peer& peer = *pair.peer;
    struct NoLines final : LineSource {
        std::string next(Instant) override { return {}; }
    };
    const auto source = std::make_shared<NoLines>();
    peer.reply({.head = body("head"), .lines = source}, start);
    CHECK(peer.stage() == Stage::streaming);
    CHECK(peer.wants_lines() == source);
    CHECK(peer.deadline() == Instant::never());
    peer.lines("", start);
    CHECK(peer.wants_lines() == source);
    peer.lines(std::string(50'000'000, 'x'), start + 1s);
    CHECK(peer.wants_lines() == nullptr);
    CHECK(peer.deadline() == start + 8s);
    peer.expire(start + 8s);
    CHECK(peer.stage() == Stage::over);
}
