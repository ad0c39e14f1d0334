// Lines without end.
#include "tests/common/http/running.hpp"

#include <atomic>
#include <doctest/doctest.h>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

using namespace fraja;
using namespace fraja::http;
using namespace std::chrono_literals;

namespace {

constexpr const char* lines_request = "GET /lines HTTP/1.1\r\n\r\n";

/// Says a text each time it is asked. Counts those there are.
class Words final : public LineSource {
public:
    Words(std::string text, std::atomic<int>& count) : text_(std::move(text)), count_(count) {
        ++count_;
    }
    ~Words() override { --count_; }
    std::string next(Instant) override {
        if (text_.empty())
            throw std::runtime_error("no words");
        return text_;
    }

private:
    std::string text_;
    std::atomic<int>& count_;
};

/// Says so at /lines; a word at /word.
Answerer words(std::string text, std::atomic<int>& count) {
    return [text = std::move(text), &count](const Request& request) -> Answer {
        if (request.path == "/lines")
            return {.lines = std::make_shared<Words>(text, count)};
        if (request.path == "/word")
            return {.lines = std::make_shared<Words>("word\n", count)};
        return one_page(request);
    };
}

/// One thread answers, for all.
constexpr Limits viewed{.threads = 1,
                        .connections_max = 200,
                        .streams_max = 100,
                        .idle_max = 1h,
                        .patience = 1h,
                        .look_pause = 10ms};

} // namespace

TEST_CASE("as many as may look are told lines while others ask, and one more is told so") {
    std::atomic<int> count = 0;
    const Running server(viewed, words("word\n", count));
    std::vector<Connection> viewers;
    for (std::size_t i = 0; i < viewed.streams_max; ++i) {
        viewers.emplace_back(server.port).say(lines_request);
        REQUIRE(viewers.back().read_until("word\n", patience).has_value());
    }
    CHECK(server.ask() == 200);
    for (Connection& viewer : viewers)
        CHECK(viewer.read_until("word\n", patience).has_value()); // again
    const HttpAnswer refused = ask_http(server.port, "GET", "/lines", patience);
    CHECK(refused.status == 503);
    CHECK(refused.body.find(std::to_string(viewed.streams_max)) != std::string::npos);
    while (count > static_cast<int>(viewed.streams_max))
        std::this_thread::yield();

    viewers.pop_back(); // goes, and there is room
    while (count == static_cast<int>(viewed.streams_max))
        std::this_thread::yield();
    CHECK(server.ask() == 200);
    Connection next(server.port);
    next.say(lines_request);
    CHECK(next.read_until("word\n", patience).has_value());
}

TEST_CASE("lines are asked for at once, and then after each look_pause") {
    struct Counted final : LineSource {
        explicit Counted(std::atomic<int>& c) : count(c) {}
        std::string next(Instant) override { return std::to_string(++count) + "\n"; }
        std::atomic<int>& count;
    };
    std::atomic<int> count = 0;
    Limits rare = viewed;
    rare.look_pause = 1h;
    const Running server(rare, [&](const Request& request) {
        return request.path == "/lines" ? Answer{.lines = std::make_shared<Counted>(count)}
                                        : one_page(request);
    });
    Connection viewer(server.port);
    viewer.say(lines_request);
    CHECK(viewer.read_until("\r\n\r\n1\n", patience).has_value());
    for (int i = 0; i < 20; ++i)
        CHECK(server.ask() == 200);
    CHECK(count == 1);
}

TEST_CASE("who does not take its lines is given up after `patience`, and others go on") {
    Limits hasty = viewed;
    hasty.patience = 300ms;
    std::atomic<int> count = 0;
    const Running server(hasty, words(std::string(1'000'000, 'x') + "\n", count));
    Connection slow(server.port), quick(server.port);
    slow.say(lines_request);
    quick.say("GET /word HTTP/1.1\r\n\r\n");
    while (count < 2)
        std::this_thread::yield();
    while (count == 2)
        CHECK(quick.read_until("word\n", patience).has_value());
    for (int i = 0; i < 10; ++i)
        CHECK(quick.read_until("word\n", patience).has_value());
    CHECK(count == 1);
    CHECK(slow.read_to_end(patience).has_value());
}

TEST_CASE("a source that fails ends its lines alone") {
    std::atomic<int> count = 0;
    const Running server(viewed, words("", count));
    CHECK(ask_http(server.port, "GET", "/lines", patience).status == 200);
    CHECK(server.ask() == 200);
}

TEST_CASE("a server that ends lets its viewers go, those as well who take nothing") {
    std::atomic<int> count = 0;
    std::optional<Running> server(std::in_place, viewed,
                                  words(std::string(1'000'000, 'x') + "\n", count));
    std::vector<Connection> viewers;
    for (int i = 0; i < 20; ++i)
        viewers.emplace_back(server->port).say(lines_request);
    while (count < 20)
        std::this_thread::yield();
    CHECK(viewers.front().read_until("x\n", patience).has_value());
    server.reset();
    CHECK(count == 0);
    for (Connection& viewer : viewers)
        CHECK(viewer.read_to_end(patience).has_value());
}
