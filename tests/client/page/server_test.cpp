#include "client/page/server.hpp"

#include "client/page/routes.hpp"

#include <atomic>
#include <doctest/doctest.h>
#include <httplib.h>
#include <thread>
#include <vector>

using namespace fraja;
using namespace fraja::client;

namespace {

/// Says a word each time it is asked.
struct Words final : LineSource {
    std::string next(Instant) override { return "word\n"; }
};

HttpAnswer answer(const HttpRequest& request) {
    if (request.path == "/events")
        return {.lines = std::make_shared<Words>()};
    if (request.path == "/later")
        return {.status = 503, .body = http_body("later"), .retry_after_s = 7};
    return {.type = "text/html; charset=utf-8",
            .body = http_body(request.method + " " + request.path + " " + request.host + " " +
                              request.origin + " " + request.cookies + " " +
                              (request.query.contains("a") ? request.query.at("a") : "-")),
            .cookie = "a=b"};
}

struct Served {
    explicit Served(std::function<HttpAnswer(const HttpRequest&)> with = answer)
        : server(std::move(with)) {
        const auto bound = server.bind({"127.0.0.1", 0, true});
        REQUIRE(bound);
        port = bound->port;
        server.start();
    }
    [[nodiscard]] httplib::Client client() const { return httplib::Client("127.0.0.1", port); }
    Server server;
    int port = 0;
};

/// Looks until it is told to go.
class Looker {
public:
    explicit Looker(int port)
        : thread_([this, port](const std::stop_token& stop) {
              httplib::Client client("127.0.0.1", port);
              const auto result = client.Get("/events", [&](const char*, std::size_t) {
                  hears = true;
                  return !stop.stop_requested();
              });
              refused = result && result->status == 503;
              over = true;
          }) {}
    void go() { thread_.request_stop(); }
    std::atomic<bool> hears = false, refused = false, over = false;

private:
    std::jthread thread_;
};

} // namespace

TEST_CASE("every answer says that nothing from elsewhere is let in") {
    const Served served;
    auto client = served.client();
    for (const char* path : {"/", "/later"}) {
        const auto got = client.Get(path);
        REQUIRE(got);
        const std::string policy = got->get_header_value("Content-Security-Policy");
        for (const char* part :
             {"default-src 'none'", "script-src 'self'", "frame-ancestors 'none'"})
            CHECK(policy.find(part) != std::string::npos);
        CHECK(policy.find("unsafe") == std::string::npos);
        CHECK(got->get_header_value("X-Content-Type-Options") == "nosniff");
        CHECK(got->get_header_value("Referrer-Policy") == "no-referrer");
        CHECK(got->get_header_value("Cross-Origin-Resource-Policy") == "same-origin");
    }
    CHECK(client.Get("/later")->get_header_value("Retry-After") == "7");
    CHECK(client.Get("/later")->status == 503);
}

TEST_CASE("a request arrives as it was sent") {
    const Served served;
    const auto got = served.client().Get("/x?a=b%20c", {{"Origin", "http://o"}, {"Cookie", "k=v"}});
    REQUIRE(got);
    CHECK(got->body == "GET /x 127.0.0.1:" + std::to_string(served.port) + " http://o k=v b c");
    CHECK(got->get_header_value("Set-Cookie") == "a=b");
    CHECK(got->get_header_value("Content-Type") == "text/html; charset=utf-8");
    CHECK(served.client().Head("/x")->status == 200);
    CHECK(served.client().Post("/x", "", "text/plain")->body.starts_with("POST /x"));
    CHECK(served.client().Post("/x", std::string(100, 'x'), "text/plain")); // is not read
}

TEST_CASE("as many as may look are served while others ask, and one more is told so") {
    const Served served;
    std::vector<std::unique_ptr<Looker>> lookers;
    for (std::size_t i = 0; i < viewers_max; ++i)
        lookers.push_back(std::make_unique<Looker>(served.port));
    for (const auto& looker : lookers)
        while (!looker->hears)
            std::this_thread::yield();
    CHECK(served.client().Get("/")->status == 200);
    const auto refused = served.client().Get("/events");
    REQUIRE(refused);
    CHECK(refused->status == 503);
    CHECK(refused->body.find(std::to_string(viewers_max)) != std::string::npos);
    lookers.pop_back(); // goes: there is room again, as soon as the server has seen it
    const auto comes = [&served] {
        const Looker next(served.port);
        while (!next.hears && !next.over)
            std::this_thread::yield();
        return !next.refused;
    };
    while (!comes())
        std::this_thread::yield();
    for (const auto& looker : lookers)
        looker->go();
}

TEST_CASE("a server that ends lets its viewers go") {
    auto served = std::make_unique<Served>();
    const Looker looker(served->port);
    while (!looker.hears)
        std::this_thread::yield();
    served.reset();
    while (!looker.over)
        std::this_thread::yield();
    CHECK_FALSE(looker.refused);
}

TEST_CASE("an address that is taken is refused, with the cure") {
    const Served served;
    Server second(answer);
    const auto bound = second.bind({"127.0.0.1", static_cast<std::uint16_t>(served.port), true});
    REQUIRE_FALSE(bound);
    CHECK(bound.error().message.find("port 0") != std::string::npos);
}
