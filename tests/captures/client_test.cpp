// What a broker of the version before has said, said again to clients as they are now.
#include "client/asking.hpp"
#include "client/submission.hpp"
#include "client/watching.hpp"
#include "tests/captures/capture.hpp"
#include "tests/captures/kept_page.hpp"

#include <chrono>

namespace fraja::client {

using namespace std::chrono_literals;

namespace {

const SessionOptions at_broker{
    .brokers = {"tcp://127.0.0.1:50057"}, .connect_timeout = 10s, .client_name = "test"};

/// A client's core with the broker that a capture is of.
class OldBroker {
public:
    explicit OldBroker(const std::string& name)
        : capture_(read_capture(captures / last_version / "old_broker" / (name + ".txt"))),
          part_(capture_, Part::Of::called) {
        const auto stream = captures / last_version / "old_broker" / (name + "_stream.txt");
        if (std::filesystem::exists(stream))
            for (Captured& said : read_capture(stream))
                if (!said.from_caller)
                    stream_.push_back(std::move(said));
    }
    [[nodiscard]] const Capture& capture() const { return capture_; }

    Outcome talk_to(Core& core) {
        std::vector<Action> actions;
        core.start(now_, actions);
        take(actions);
        for (int turns = 0; turns < 2'000 && !outcome_; ++turns) {
            if (const Captured* words = part_.next()) {
                part_.said(words);
                say(core, words->unpacked(), false);
            } else if (part_.is_over() && at_ < stream_.size()) {
                say(core, stream_[at_++].published(), true);
            }
            now_ = now_ + 10ms;
            actions.clear();
            core.step(now_, Tick{}, actions);
            take(actions);
        }
        REQUIRE(outcome_.has_value());
        return *outcome_;
    }

    std::vector<TileArrived> tiles;
    std::vector<protocol::Version> versions; ///< of what the client has said

private:
    void say(Core& core, const std::vector<Blob>& frames, bool on_stream) {
        auto message = protocol::decode(frames);
        REQUIRE_MESSAGE(message.has_value(), (message ? "" : message.error().message));
        std::vector<Action> actions;
        if (on_stream)
            core.step(now_, FromStream{std::move(*message)}, actions);
        else
            core.step(now_, FromBroker{std::move(*message), *protocol::version_of(frames)},
                      actions);
        take(actions);
    }
    void take(const std::vector<Action>& actions) {
        for (const Action& action : actions) {
            if (const auto* speak = std::get_if<Speak>(&action)) {
                spoken_ = speak->version;
            } else if (const auto* send = std::get_if<Send>(&action)) {
                const auto frames = frames_of(protocol::encode(send->message, spoken_));
                if (spoken_ == protocol::oldest_version_spoken)
                    CHECK(page_.complaint(frames) == "");
                part_.hear(send->message);
                versions.push_back(spoken_);
            } else if (const auto* news = std::get_if<News>(&action)) {
                if (const auto* tile = std::get_if<TileArrived>(news))
                    tiles.push_back(*tile);
                if (const auto* finished = std::get_if<client::Finished>(news))
                    outcome_ = finished->outcome;
            }
        }
    }

    const KeptPage page_{protocol::oldest_version_spoken};
    const Capture capture_;
    Part part_;
    std::vector<Captured> stream_;
    std::size_t at_ = 0;
    Instant now_{1h};
    protocol::Version spoken_ = protocol::version;
    std::optional<Outcome> outcome_;
};

void check_that_it_came_down(const OldBroker& broker) {
    REQUIRE(broker.versions.size() > 1);
    CHECK(broker.versions[0] == protocol::version);
    CHECK(std::all_of(broker.versions.begin() + 1, broker.versions.end(),
                      [](protocol::Version v) { return v == protocol::oldest_version_spoken; }));
}

SubmissionRequest request_of(const Capture& capture) {
    SubmissionRequest request;
    request.job = all_of<protocol::SubmitJob>(capture).at(0);
    request.scene_text = all_of<protocol::Chunk>(capture).at(0).blobs.at(0);
    request.session = at_broker;
    return request;
}

} // namespace

TEST_CASE("a job is submitted to a broker of the version before, and its picture comes") {
    OldBroker broker("submit");
    Submission submission(request_of(broker.capture()), Rng(1));
    CHECK(broker.talk_to(submission).code == ExitCode::done);
    check_that_it_came_down(broker);
    REQUIRE(broker.tiles.size() == 1);
    CHECK(broker.tiles[0].tile.worker_name == "ada");
    CHECK(broker.tiles[0].tile.worker == WorkerId{});
}

TEST_CASE("what a broker of the version before cannot do is not asked of it") {
    OldBroker broker("submit");
    SubmissionRequest request = request_of(broker.capture());
    request.job.wishes.verify = 0.5;
    Submission submission(request, Rng(1));
    const Outcome outcome = broker.talk_to(submission);
    CHECK(outcome.code == ExitCode::refused);
    CHECK(outcome.reason == "tcp://127.0.0.1:50057: the broker is too old to have tiles checked "
                            "(--verify): it speaks protocol version " +
                                last_version + ", and must be updated");
}

TEST_CASE("a job at a broker of the version before is watched") {
    OldBroker broker("watch");
    JobWatching watching({"solid", at_broker, {}}, Rng(1));
    CHECK(broker.talk_to(watching).code == ExitCode::done);
    check_that_it_came_down(broker);
    REQUIRE(broker.tiles.size() == 1);
}

TEST_CASE("a broker of the version before is asked for a job and a worker") {
    {
        OldBroker broker("show");
        Asking asking(JobQuestion{"solid"}, at_broker);
        CHECK(broker.talk_to(asking).code == ExitCode::done);
        check_that_it_came_down(broker);
    }
    {
        OldBroker broker("drain");
        Asking asking(WorkerQuestion{"ada", protocol::WorkerDeed::drain}, at_broker);
        CHECK(broker.talk_to(asking).code == ExitCode::done);
    }
    {
        OldBroker broker("no_such_job");
        Asking asking(JobQuestion{"nothing"}, at_broker);
        CHECK(broker.talk_to(asking).code == ExitCode::no_such_job);
    }
}

} // namespace fraja::client
