#include "client/page/routes.hpp"

#include "client/page/assets.hpp"
#include "tests/client/page/small_job.hpp"

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>
#include <set>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

/// The small job, done, and a page about it.
struct Page {
    explicit Page(Control control = {}, JobViewLimits limits = {})
        : views(limits,
                [](JobView& view) {
                    view.hear(Instant{}, Accepted{small_job()});
                    for (std::uint32_t x = 0; x < 4; ++x)
                        view.hear(Instant{}, TileArrived{small_tile(x, 0.5f), 4});
                    return Outcome{};
                }),
          board({}, views), routes(Door({}, ""), board, views, std::move(control)) {}

    [[nodiscard]] http::Answer ask(std::string method, std::string path,
                                   std::map<std::string, std::string> query = {}) const {
        http::Request request{.method = std::move(method),
                              .path = std::move(path),
                              .query = std::move(query),
                              .host = "localhost:50060"};
        request.origin = "http://" + request.host;
        return routes.answer(request);
    }
    [[nodiscard]] http::Answer get(std::string path,
                                   std::map<std::string, std::string> query = {}) const {
        return ask("GET", std::move(path), std::move(query));
    }

    JobViews views;
    FarmBoard board;
    Routes routes;
};

const std::string small_id = to_string(small_job().job);

} // namespace

TEST_CASE("the page's files are there, and name no other place") {
    const Page page;
    CHECK(page.get("/").type == "text/html; charset=utf-8");
    CHECK(page.get("/page.js").type == "text/javascript; charset=utf-8");
    CHECK(page.get("/page.css").type == "text/css; charset=utf-8");
    CHECK(page_assets().size() >= 5);
    for (const Asset& asset : page_assets()) {
        CAPTURE(asset.name);
        const http::Answer answer = page.get("/" + std::string(asset.name));
        CHECK(answer.status == 200);
        CHECK(*answer.body == asset.text);
        for (const std::string_view there :
             {"https:", "http://127", "http://l", "src=\"//", "@import", "innerHTML"})
            CHECK(asset.text.find(there) == std::string::npos);
    }
}

TEST_CASE("every answer says that nothing from elsewhere is let in") {
    std::map<std::string, std::string> headers;
    for (const auto& [name, value] : page_headers())
        headers[name] = value;
    const std::string policy = headers["Content-Security-Policy"];
    for (const char* part : {"default-src 'none'", "script-src 'self'", "frame-ancestors 'none'"})
        CHECK(policy.find(part) != std::string::npos);
    CHECK(policy.find("unsafe") == std::string::npos);
    CHECK(headers["X-Content-Type-Options"] == "nosniff");
    CHECK(headers["Referrer-Policy"] == "no-referrer");
    CHECK(headers["Cross-Origin-Resource-Policy"] == "same-origin");
}

TEST_CASE("what is not there is not found, and other methods are not understood") {
    const Page page;
    for (const std::string& path :
         {std::string(), std::string("/nothing"), std::string("/../CMakeLists.txt"),
          std::string("/job/"), std::string("/job/1/picture.jpg"), "/job/" + small_id,
          "/job/" + small_id + "/", "/job/" + small_id + "/nothing", std::string(8000, '/')}) {
        CAPTURE(path);
        CHECK(page.get(path).status == 404);
        CHECK(page.ask("POST", path).status == 404);
    }
    for (const char* method : {"PUT", "DELETE", "OPTIONS", "TRACE"})
        CHECK(page.ask(method, "/").status == 405);
    CHECK(page.ask("PUT", "/").allow == "GET, HEAD, POST");
    CHECK(page.ask("HEAD", "/events").status == 405); // it has no end
    CHECK(page.ask("HEAD", "/events").allow == "GET");
    CHECK(page.ask("HEAD", "/").status == 200);
}

TEST_CASE("who looks at a job is sent lines about the farm and the job when they change") {
    const Page page;
    CHECK(page.get("/events", {{"job", "cone"}}).status == 400);
    const http::Answer alone = page.get("/events");
    REQUIRE(alone.lines);
    CHECK(alone.lines->next(Instant{}).starts_with("{\"farm\":"));

    const http::Answer answer = page.get("/events", {{"job", small_id}});
    REQUIRE(answer.lines);
    CHECK(answer.type == "application/x-ndjson");
    while (!page.views.find(small_job().job)->ended())
        std::this_thread::yield();
    const std::string lines = answer.lines->next(Instant{});
    CHECK(lines.starts_with("{\"farm\":"));
    CHECK(lines.find("\n{\"job\":") != std::string::npos);
    CHECK(lines.ends_with("}\n"));
    CHECK(answer.lines->next(Instant{} + 2s).empty());
    CHECK(answer.lines->next(Instant{} + 3s) == "{}\n"); // still there
    CHECK(answer.lines->next(Instant{} + 4s).empty());
}

TEST_CASE("a revision's picture may be kept for ever, what is newer may not") {
    const Page page;
    CHECK(page.get("/job/" + small_id + "/picture.jpg").status == 404); // nobody looks
    const http::Answer events = page.get("/events", {{"job", small_id}});
    while (!page.views.find(small_job().job)->ended())
        std::this_thread::yield();
    const auto line = nlohmann::json::parse(*page.views.find(small_job().job)->shown().text);
    const std::string revision = line.at("job").at("revision").dump();
    struct Row {
        const char* path;
        const char* type;
    };
    for (const Row& row : {Row{"/picture.jpg", "image/jpeg"}, Row{"/picture.png", "image/png"},
                           Row{"/cost.png", "image/png"}, Row{"/workers.png", "image/png"}}) {
        CAPTURE(row.path);
        const http::Answer first = page.get("/job/" + small_id + row.path, {{"rev", revision}});
        CHECK(first.status == 200);
        CHECK(first.type == row.type);
        CHECK(first.caching.find("immutable") != std::string::npos);
        CHECK(page.get("/job/" + small_id + row.path, {{"rev", "0"}}).caching == "no-store");
        CHECK(page.get("/job/" + small_id + row.path, {{"rev", "x"}}).caching == "no-store");
        CHECK(page.get("/job/" + small_id + row.path).body == first.body);
    }
    CHECK(page.get("/job/" + small_id + "/part.jpg", {{"rect", "1,0,2,1"}}).status == 200);
    for (const char* bad : {"", "1,0,4,1", "0,0,0,0", "all"})
        CHECK(page.get("/job/" + small_id + "/part.jpg", {{"rect", bad}}).status == 400);
}

TEST_CASE("whoever is one too many is told to come again") {
    const Page page({}, {.views_max = 1});
    const http::Answer one = page.get("/events", {{"job", small_id}});
    const http::Answer other = page.get("/events", {{"job", to_string(JobId{{9}})}});
    CHECK(other.status == 503);
    CHECK(other.retry_after_s.has_value());
    CHECK(other.body->find("1 jobs at a time") != std::string::npos);
}

TEST_CASE(
    "a job is paused, resumed and cancelled where that is allowed, and else nothing happens") {
    std::set<protocol::JobDeed> done;
    ExitCode answer = ExitCode::done;
    const Page allowed([&](const JobId& job, protocol::JobDeed deed) {
        CHECK(job == small_job().job);
        done.insert(deed);
        return Outcome{answer, "so it is"};
    });
    const Page shows;
    for (const char* deed : {"/pause", "/resume", "/cancel"}) {
        CHECK(allowed.ask("POST", "/job/" + small_id + deed).status == 200);
        CHECK(allowed.get("/job/" + small_id + deed).status == 404); // a link does nothing
        const http::Answer refused = shows.ask("POST", "/job/" + small_id + deed);
        CHECK(refused.status == 403);
        CHECK(refused.body->find("--allow-control") != std::string::npos);
    }
    using enum protocol::JobDeed;
    CHECK(done == std::set{pause, resume, cancel});
    CHECK(allowed.ask("POST", "/job/" + small_id + "/retry").status == 404);
    for (const auto& [code, status] :
         {std::pair{ExitCode::no_such_job, 404}, std::pair{ExitCode::usage, 409},
          std::pair{ExitCode::unreachable, 502}}) {
        answer = code;
        CHECK(allowed.ask("POST", "/job/" + small_id + "/pause").status == status);
    }
}
