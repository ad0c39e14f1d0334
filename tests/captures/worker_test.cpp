// What a broker of the version before has said, said again to a worker as it is now.
#include "tests/captures/capture.hpp"
#include "tests/captures/kept_page.hpp"
#include "worker/session.hpp"

#include <chrono>
#include <deque>
#include <utility>

using namespace fraja;
using namespace std::chrono_literals;

namespace {

/// A worker with whom a broker speaks that says what it has said in the capture.
struct Served {
    explicit Served(const std::string& name, const worker::Identity& identity)
        : capture(read_capture(captures / last_version / "old_broker" / (name + ".txt"))),
          broker(capture, Part::Of::called), session(identity, {}) {}

    /// Until the session is over: it drains when the broker has said all. `drawn`: of each tile
    /// that is begun; none is ever done without it.
    void play(const protocol::TileRendered* drawn) {
        bool drains = false;
        for (int turns = 0; turns < 1'000 && !session.is_over(); ++turns) {
            if (events.empty()) {
                if (const Captured* words = broker.next()) {
                    broker.said(words);
                    auto message = protocol::decode(words->unpacked());
                    REQUIRE_MESSAGE(message.has_value(), (message ? "" : message.error().message));
                    events.push_back(worker::Received{std::move(*message),
                                                      *protocol::version_of(words->unpacked())});
                } else if (broker.is_over() && !std::exchange(drains, true)) {
                    events.push_back(worker::Drain{});
                } else {
                    now = now + 10ms;
                    events.push_back(worker::Tick{});
                }
            }
            std::vector<worker::Action> actions;
            session.step(now, events.front(), actions);
            events.pop_front();
            for (const worker::Action& action : actions)
                take(action, drawn);
        }
        INFO(log);
        CHECK(broker.is_over());
        REQUIRE(session.is_over());
    }
    /// A hello in its own version, and when that is refused all in the other's.
    void check_versions() const {
        REQUIRE(said.size() > 2);
        CHECK(std::holds_alternative<protocol::WorkerHello>(said[0]));
        CHECK(versions[0] == protocol::version);
        CHECK(std::holds_alternative<protocol::WorkerHello>(said[1]));
        CHECK(std::all_of(versions.begin() + 1, versions.end(), [](protocol::Version v) {
            return v == protocol::oldest_version_spoken;
        }));
        CHECK(log.find(", by protocol version " + last_version) != std::string::npos);
    }

    Capture capture;
    Part broker;
    worker::Session session;
    Instant now{1h};
    std::vector<protocol::Message> said;
    std::vector<protocol::Version> versions;
    std::string log;
    std::deque<worker::Event> events{worker::Tick{}};
    const KeptPage page{protocol::oldest_version_spoken};
    int started = 0, stopped = 0; // tiles

private:
    void take(const worker::Action& action, const protocol::TileRendered* drawn) {
        if (const auto* send = std::get_if<worker::Send>(&action)) {
            const auto frames = frames_of(protocol::encode(send->message, send->version));
            if (send->version == protocol::oldest_version_spoken)
                CHECK(page.complaint(frames) == "");
            broker.hear(send->message);
            said.push_back(send->message);
            versions.push_back(send->version);
        } else if (const auto* compile = std::get_if<worker::CompileScene>(&action)) {
            events.push_back(worker::SceneCompiled{compile->scene});
        } else if (const auto* tile = std::get_if<worker::StartTile>(&action)) {
            ++started;
            if (drawn)
                events.push_back(
                    worker::TileFinished{tile->ticket, drawn->rays, drawn->elapsed, drawn->blobs});
        } else if (std::holds_alternative<worker::StopTile>(action)) {
            ++stopped;
        } else if (const auto* line = std::get_if<worker::Log>(&action)) {
            log += line->text + "\n";
        }
    }
};

} // namespace

TEST_CASE("a worker serves a broker of the version before") {
    Served worker("worker", {WorkerId{}, "ada", 1, {"room=3"}});
    const auto drawn = all_of<protocol::TileRendered>(worker.capture);
    REQUIRE(drawn.size() == 1);
    worker.play(drawn.data());
    worker.check_versions();
    CHECK(std::holds_alternative<protocol::Goodbye>(worker.said.back()));
    const auto answer = std::ranges::find_if(worker.said, [](const protocol::Message& message) {
        return std::holds_alternative<protocol::TileRendered>(message);
    });
    REQUIRE(answer != worker.said.end());
    // It is what the old broker took, to the byte: the time apart, that is the test's own.
    CHECK(
        frames_of(protocol::encode(*answer, protocol::oldest_version_spoken)) ==
        frames_of(protocol::encode(protocol::Message(drawn[0]), protocol::oldest_version_spoken)));
}

TEST_CASE("a worker stops and leaves as a broker of the version before tells it to") {
    Served worker("stopped_worker", {WorkerId{}, "bob", 1, {}});
    worker.play(nullptr);
    worker.check_versions();
    CHECK(worker.started > 0);
    CHECK(worker.stopped == worker.started);
    const auto failed_then = all_of<protocol::TileFailed>(worker.capture);
    std::vector<protocol::TileFailed> failed;
    for (const protocol::Message& message : worker.said)
        if (const auto* tile = std::get_if<protocol::TileFailed>(&message))
            failed.push_back(*tile);
    REQUIRE(failed.size() == failed_then.size());
    for (std::size_t i = 0; i < failed.size(); ++i) {
        CHECK(failed[i].attempt == failed_then[i].attempt);
        CHECK(failed[i].code == protocol::FailureCode::cancelled);
    }
    CHECK(worker.log.find("told to leave") != std::string::npos);
}
