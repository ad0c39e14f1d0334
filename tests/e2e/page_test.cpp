// fraja-watch --serve over HTTP. A browser looks at it in tests/browser.
#include "tests/e2e/farm.hpp"
#include "tests/support/connection.hpp"

#include <atomic>
#include <httplib.h>
#include <sys/stat.h>
#include <thread>

using namespace fraja;
using namespace fraja::e2e;
using nlohmann::json;

namespace {

struct Served {
    Process process;
    std::string url; ///< as it was printed
    int port = 0;

    [[nodiscard]] httplib::Client client() const {
        httplib::Client client("127.0.0.1", port);
        client.set_read_timeout(patience);
        return client;
    }
    [[nodiscard]] httplib::Headers own() const {
        return {{"Origin", "http://127.0.0.1:" + std::to_string(port)}};
    }
};

Process start_page(const std::string& broker, const Words& options) {
    auto process = Process::start({.argv = with({program("fraja-watch"), "-b", broker}, options)});
    REQUIRE(process);
    return *std::move(process);
}

Served serve(const Farm& farm, const Words& options) {
    Served served{start_page(farm.endpoint(), options), {}};
    const auto line = served.process.wait_for_words(Process::Stream::out, "page http://", patience);
    INFO(served.process.story());
    REQUIRE(line);
    served.url = line->substr(5);
    const auto colon = served.url.find(':', 7);
    served.port = std::stoi(served.url.substr(colon + 1));
    return served;
}

/// Looks at a job until `enough` holds for a line about it; the line.
template <class Enough>
json look(const Served& served, const std::string& job, Enough enough) {
    std::string rest;
    json found;
    const auto result = served.client().Get("/events?job=" + job, [&](const char* data,
                                                                      std::size_t size) {
        rest.append(data, size);
        for (std::size_t end; (end = rest.find('\n')) != std::string::npos && found.is_null();) {
            const json line = json::parse(rest.substr(0, end));
            rest.erase(0, end + 1);
            if (line.contains("job") && enough(line.at("job")))
                found = line.at("job");
        }
        return found.is_null();
    });
    INFO(rest << ", " << to_string(result.error()));
    REQUIRE_FALSE(found.is_null());
    return found;
}

bool is_done(const json& job) {
    return job.at("complete") && job.at("state") == "done";
}

} // namespace

TEST_CASE("the page serves the picture that a local render draws") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one");
    const Words picture = {scene("cone"), "-r", "64x48"};
    const std::string want = local_picture(scratch, picture);
    const std::string job = farm.detach(picture);
    const Served served = serve(farm, {"cone", "--serve", "127.0.0.1:0"});
    CHECK(served.url == "http://127.0.0.1:" + std::to_string(served.port) + "/");
    const json done = look(served, job, is_done);
    CHECK(done.at("share_done") == 1.0);
    CHECK(done.at("map").at("workers")[0].at("name") == "one");
    const auto got = served.client().Get("/job/" + job + "/picture.png");
    REQUIRE(got);
    CHECK((got->body == want));
    const auto kept = served.client().Get("/job/" + job + "/picture.jpg?rev=" +
                                          std::to_string(done.at("revision").get<std::uint64_t>()));
    CHECK(kept->get_header_value("Cache-Control").find("immutable") != std::string::npos);
}

TEST_CASE("thirty look at a job that goes on, and all see its end") {
    Farm farm;
    const std::string job = farm.detach({scene("cone"), "-r", "64x48", "--tile", "8"});
    const Served served = serve(farm, {"--serve", "127.0.0.1:0"});
    std::atomic<int> looking = 0;
    std::vector<std::jthread> lookers;
    std::atomic<int> saw_the_end = 0;
    for (int i = 0; i < 30; ++i)
        lookers.emplace_back([&] {
            bool counted = false;
            (void)look(served, job, [&](const json& line) {
                if (!std::exchange(counted, true))
                    ++looking;
                return is_done(line);
            });
            ++saw_the_end;
        });
    while (looking < 30)
        std::this_thread::yield();
    CHECK(served.client().Get("/")->status == 200);
    farm.add_worker("one");
    lookers.clear();
    CHECK(saw_the_end == 30);
}

TEST_CASE("however many say nothing to a page, or speak slowly, nobody else waits") {
    Farm farm;
    const Served served = serve(farm, {"--serve", "127.0.0.1:0"});
    const auto port = static_cast<std::uint16_t>(served.port);
    std::vector<Connection> idle, trickling;
    for (int i = 0; i < 200; ++i)
        idle.emplace_back(port);
    for (int i = 0; i < 50; ++i)
        trickling.emplace_back(port);
    for (const char byte : std::string_view("GET /page.js")) {
        for (Connection& connection : trickling)
            connection.say({&byte, 1}); // or it was given up
        const auto begin = std::chrono::steady_clock::now();
        const auto got = served.client().Get("/");
        REQUIRE(got);
        CHECK(got->status == 200);
        CHECK(contains(got->get_header_value("Content-Security-Policy"), "default-src 'none'"));
        CHECK(std::chrono::steady_clock::now() - begin < 4s); // a request may take 5 to come
    }
    CHECK(served.client().Post("/", std::string(100, 'x'), "text/plain")->status == 413);
}

TEST_CASE("a page cancels a job where control is allowed, and else nothing") {
    Farm farm;
    const std::string job = farm.detach(with({scene("cone")}, {"-r", "64x48"})); // without workers
    const Served shows = serve(farm, {"--serve", "127.0.0.1:0"});
    const std::string path = "/job/" + job + "/cancel";
    CHECK(shows.client().Post(path, shows.own(), "", "text/plain")->status == 403);
    const Served controls = serve(farm, {"--serve", "127.0.0.1:0", "--allow-control"});
    CHECK(controls.client()
              .Post(path, {{"Origin", "http://evil.example"}}, "", "text/plain")
              ->status == 403);
    CHECK(controls.client().Get(path)->status == 404);
    const auto done = controls.client().Post(path, controls.own(), "", "text/plain");
    CHECK(done->status == 200);
    CHECK(done->body == "#1 is cancelled\n");
    const auto none = controls.client().Post("/job/00000000-0000-4000-8000-000000000000/cancel",
                                             controls.own(), "", "text/plain");
    CHECK(none->status == 404);
    Process watcher = farm.watch(job);
    CHECK(watcher.wait_for_exit(patience) == 5);
}

TEST_CASE("off loopback the page is shown to whoever has its token") {
    const Scratch scratch;
    Farm farm;
    Served made = serve(farm, {"--serve", "0.0.0.0:0"});
    const auto token = made.url.find("/?token=");
    REQUIRE(token != std::string::npos);
    CHECK(made.process.wait_for_words(Process::Stream::err, "ssh -L", patience));
    CHECK(made.client().Get("/")->status == 401);
    CHECK(made.client().Get("/events")->status == 401);
    const auto first = made.client().Get(made.url.substr(token));
    CHECK(first->status == 200);
    const std::string cookie = first->get_header_value("Set-Cookie");
    CHECK(contains(cookie, "HttpOnly; SameSite=Strict"));
    CHECK(made.client().Get("/page.js", {{"Cookie", cookie.substr(0, cookie.find(';'))}})->status ==
          200);

    const std::string file = scratch.file("token");
    std::ofstream(file) << "a-token-of-ones-own\n";
    REQUIRE(chmod(file.c_str(), 0600) == 0);
    const Served given = serve(farm, {"--serve", "127.0.0.1:0", "--token-file", file});
    CHECK_FALSE(contains(given.url, "token")); // who has the file knows it
    CHECK(given.client().Get("/")->status == 401);
    CHECK(given.client().Get("/?token=a-token-of-ones-own")->status == 200);
}

TEST_CASE("a page ends as it is told to, and says why it cannot begin") {
    Farm farm;
    Served served = serve(farm, {"--serve", "127.0.0.1:0"});
    Process second =
        start_page(farm.endpoint(), {"--serve", "127.0.0.1:" + std::to_string(served.port)});
    CHECK(second.wait_for_exit(patience) == 2);
    CHECK(contains(second.err(), "Address already in use"));
    served.process.send(SIGTERM);
    CHECK(served.process.wait_for_exit(patience) == 143);
    struct Row {
        Words options;
        int exit;
        const char* says;
    };
    for (const Row& row :
         {Row{{"--serve", "cone"}, 2, "a JOB goes before --serve"},
          Row{{"cone", "--serve", "127.0.0.1:0"}, 6, "cone"},
          Row{{"--serve", "127.0.0.1:0", "--token-file", "/nowhere"}, 2, "/nowhere"}}) {
        Process ends = start_page(farm.endpoint(), row.options);
        CHECK(ends.wait_for_exit(patience) == row.exit);
        CHECK(contains(ends.err(), row.says));
    }
    farm.broker().send(SIGTERM);
    CHECK(farm.broker().wait_for_exit(patience) == 0);
    Process alone =
        start_page(farm.endpoint(), {"--serve", "127.0.0.1:0", "--connect-timeout", "200ms"});
    CHECK(alone.wait_for_exit(patience) == 3);
    CHECK(alone.out().empty()); // no address of a page that is gone at once
}
