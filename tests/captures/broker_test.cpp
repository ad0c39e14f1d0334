// What programs of the version before have said, said again to the broker as it is now: their farm
// works, and all that they hear is as their page has it.
#include "broker/dispatcher.hpp"
#include "tests/captures/capture.hpp"
#include "tests/captures/kept_page.hpp"

#include <chrono>
#include <set>

namespace fraja::broker {

using namespace std::chrono_literals;

namespace {

class OldFarm {
public:
    OldFarm() : dispatcher_({BrokerId{}, 7, "tcp://127.0.0.1:50058", false}, Limits{}) {}

    /// `name`: of the capture.
    void join(const std::string& name) {
        captures_[name] = read_capture(captures / last_version / "all_old" / (name + ".txt"));
        parts_.insert_or_assign(name, Part(captures_.at(name), Part::Of::caller));
    }
    /// Until all has been said, or nobody says a word any more.
    void play(const std::set<std::string>& names) {
        for (int idle = 0; idle < 20;) {
            idle += !somebody_speaks(names);
            now_ = now_ + 10ms;
            step(Tick{});
        }
    }
    void subscribe_as(const std::string& name) {
        for (const Captured& said :
             read_capture(captures / last_version / "all_old" / (name + "_stream.txt")))
            if (const auto& frame = said.frames[0];
                said.from_caller && frame.data()[0] == std::byte{1})
                step(TopicSubscribed{std::string(reinterpret_cast<const char*>(frame.data()) + 1,
                                                 frame.size() - 1)});
    }
    /// It has said all that it had to, and has heard what it had heard then.
    void check_that_all_went_as_then(const std::string& name) const {
        CAPTURE(name);
        CHECK(parts_.at(name).is_over());
        std::map<std::string_view, int> then;
        for (const Captured& said : captures_.at(name))
            if (!said.from_caller)
                ++then[protocol::name_of(*protocol::decode(said.unpacked()))];
        for (const auto& [message, count] : then) {
            CAPTURE(message);
            if (message != "Beat")
                CHECK(parts_.at(name).count(message) == count);
        }
    }
    [[nodiscard]] const Capture& capture(const std::string& name) const {
        return captures_.at(name);
    }

    bool worker_stays = true; ///< its next beats say that it drains
    std::vector<protocol::Message> published;
    std::map<std::string, std::vector<protocol::Message>> heard;
    std::string log;

private:
    bool somebody_speaks(const std::set<std::string>& names) {
        for (const std::string& name : names) {
            const Captured* words = parts_.at(name).next();
            if (!words)
                continue;
            auto message = protocol::decode(words->unpacked());
            REQUIRE(message.has_value());
            if (worker_stays && std::holds_alternative<protocol::WorkerBeat>(*message))
                continue;
            parts_.at(name).said(words);
            step(PeerSaid{name, std::move(*message), {}, *protocol::version_of(words->unpacked())});
            return true;
        }
        return false;
    }

    void step(const Event& event) {
        std::vector<Action> actions;
        dispatcher_.step(now_, event, actions);
        for (const Action& action : actions) {
            if (const auto* send = std::get_if<Send>(&action)) {
                const auto frames = frames_of(protocol::encode(send->message, send->version));
                CHECK(page_.complaint(frames) == "");
                parts_.at(send->peer).hear(send->message);
                heard[send->peer].push_back(send->message);
            } else if (const auto* publish = std::get_if<Publish>(&action)) {
                CHECK(page_.complaint(frames_of(protocol::encode(
                          publish->message, protocol::oldest_version_spoken))) == "");
                published.push_back(publish->message);
            } else if (const auto* line = std::get_if<Log>(&action)) {
                log += line->text + "\n";
            }
        }
    }

    const KeptPage page_{protocol::oldest_version_spoken};
    Dispatcher dispatcher_;
    Instant now_{1h};
    std::map<std::string, Capture> captures_;
    std::map<std::string, Part> parts_;
};

Bytes pixels_of(const std::vector<Blob>& blobs) {
    Bytes all;
    for (const Blob& blob : blobs)
        all.insert(all.end(), blob.begin(), blob.end());
    return all;
}

} // namespace

TEST_CASE("a farm of the version before works at a broker of this one") {
    OldFarm farm;
    farm.join("submit");
    farm.subscribe_as("submit");
    farm.play({"submit"});
    for (const std::string name : {"prio", "prio_2"}) {
        farm.join(name);
        farm.play({name});
        farm.check_that_all_went_as_then(name);
    }
    farm.join("worker");
    farm.play({"submit", "worker"});
    INFO(farm.log);
    farm.check_that_all_went_as_then("submit");
    CHECK(farm.log.find("worker ada is here: 1 thread, credit 2, version 0.1.0, by protocol "
                        "version " +
                        last_version) != std::string::npos);

    const auto drawn = all_of<protocol::TileRendered>(farm.capture("worker"));
    REQUIRE(drawn.size() == 1);
    Bytes streamed;
    protocol::JobPhase phase{};
    for (const protocol::Message& message : farm.published) {
        if (const auto* tile = std::get_if<protocol::TileDone>(&message))
            streamed = pixels_of(tile->blobs);
        if (const auto* state = std::get_if<protocol::JobState>(&message))
            phase = state->phase;
    }
    CHECK(streamed == pixels_of(drawn[0].blobs));
    CHECK(phase == protocol::JobPhase::done);

    // Who comes later gets the same.
    farm.subscribe_as("watch_farm");
    for (const std::string name :
         {"watch", "watch_farm", "show", "drain", "no_such_job", "no_such_job_2"}) {
        farm.join(name);
        farm.play({name});
        farm.check_that_all_went_as_then(name);
    }
    Bytes repaired;
    for (const protocol::Message& message : farm.heard["watch"])
        if (const auto* tile = std::get_if<protocol::TileDone>(&message))
            repaired = pixels_of(tile->blobs);
    CHECK(repaired == pixels_of(drawn[0].blobs));
    CHECK(std::ranges::any_of(farm.published, [](const protocol::Message& message) {
        return std::holds_alternative<protocol::FarmState>(message);
    }));
    farm.worker_stays = false;
    farm.play({"worker"});
    farm.check_that_all_went_as_then("worker");
    CHECK(farm.log.find("worker ada is gone (it said goodbye)") != std::string::npos);
}

TEST_CASE(
    "what is cancelled is drawn no more by a worker of the version before, and it may be sent "
    "away") {
    OldFarm farm;
    farm.join("slow_submit");
    farm.subscribe_as("slow_submit");
    farm.play({"slow_submit"});
    farm.join("stopped_worker");
    farm.play({"slow_submit", "stopped_worker"});
    CHECK_FALSE(farm.heard["stopped_worker"].empty());
    for (const std::string name : {"cancel", "cancel_2", "kick"}) {
        farm.join(name);
        farm.play({name, "stopped_worker"});
        farm.check_that_all_went_as_then(name);
    }
    INFO(farm.log);
    farm.play({"slow_submit"});
    farm.check_that_all_went_as_then("slow_submit");
    farm.check_that_all_went_as_then("stopped_worker");
    CHECK(farm.log.find("worker bob is gone") != std::string::npos);
}

} // namespace fraja::broker
