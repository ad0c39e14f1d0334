// What a broker of the version before has said, said again to a worker as it is now.
#include "tests/captures/capture.hpp"
#include "tests/captures/kept_page.hpp"
#include "worker/session.hpp"

#include <chrono>
#include <deque>
#include <utility>

using namespace fraja;
using namespace std::chrono_literals;

TEST_CASE("a worker serves a broker of the version before") {
    const Capture capture = read_capture(captures / last_version / "old_broker" / "worker.txt");
    const auto drawn = all_of<protocol::TileRendered>(capture);
    REQUIRE(drawn.size() == 1);
    const KeptPage page(protocol::oldest_version_spoken);
    Part broker(capture, Part::Of::called);
    worker::Session session({WorkerId{}, "ada", 1, {"room=3"}}, {});
    Instant now{1h};
    std::vector<protocol::Message> said;
    std::vector<protocol::Version> versions;
    std::string log;
    bool drains = false;
    std::deque<worker::Event> events{worker::Tick{}};
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
        for (const worker::Action& action : actions) {
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
                events.push_back(worker::TileFinished{tile->ticket, drawn[0].rays, drawn[0].elapsed,
                                                      drawn[0].blobs});
            } else if (const auto* line = std::get_if<worker::Log>(&action)) {
                log += line->text + "\n";
            }
        }
    }
    INFO(log);
    CHECK(broker.is_over());
    REQUIRE(session.is_over());
    // A hello in its own version, and when that is refused all in the other's.
    REQUIRE(said.size() > 4);
    CHECK(std::holds_alternative<protocol::WorkerHello>(said[0]));
    CHECK(versions[0] == protocol::version);
    CHECK(std::holds_alternative<protocol::WorkerHello>(said[1]));
    CHECK(std::all_of(versions.begin() + 1, versions.end(),
                      [](protocol::Version v) { return v == protocol::oldest_version_spoken; }));
    CHECK(log.find(", by protocol version " + last_version) != std::string::npos);
    CHECK(std::holds_alternative<protocol::Goodbye>(said.back()));
    const auto answer = std::ranges::find_if(said, [](const protocol::Message& message) {
        return std::holds_alternative<protocol::TileRendered>(message);
    });
    REQUIRE(answer != said.end());
    // It is what the old broker took, to the byte: the time apart, that is the test's own.
    CHECK(
        frames_of(protocol::encode(*answer, protocol::oldest_version_spoken)) ==
        frames_of(protocol::encode(protocol::Message(drawn[0]), protocol::oldest_version_spoken)));
}
