#include "client/submission.hpp"

#include "tests/client/fake_farm.hpp"
#include "tests/support/seeds.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

Bytes scene_of(std::size_t size) {
    Bytes bytes(size);
    for (std::size_t i = 0; i < size; ++i)
        bytes[i] = static_cast<std::byte>(i * 7 + i / 251);
    return bytes;
}

SubmissionRequest request_for(const FakeJob& job, Bytes scene) {
    SubmissionRequest request;
    request.job.job = JobId{{5, 5}};
    request.job.job_name = "cone";
    request.job.scene = protocol::content_hash(scene);
    request.job.scene_bytes = scene.size();
    request.job.settings = job.settings;
    request.scene_text = Blob(std::move(scene));
    request.session = {{"tcp://127.0.0.1:50057"}, 10s, "test"};
    return request;
}

void check_whole(const FakeFarm& farm) {
    CHECK(farm.outcome == Outcome{});
    CHECK(farm.pixels_right);
    CHECK(farm.delivered.size() == farm.cell_count());
    for (const auto& [tile, times] : farm.delivered) {
        CAPTURE(tile);
        CHECK(times == 1);
    }
}

/// What a core answers to a few broker's words, without a farm.
struct Dialogue {
    Submission submission;
    std::vector<Action> actions;
    Instant now{};

    explicit Dialogue(SubmissionRequest request) : submission(std::move(request), Rng(1)) {
        submission.start(now, actions);
        say(protocol::Welcome{BrokerId{{1}}, 1, 1s, 3, "tcp://h:1", "test"});
    }
    void say(protocol::Message message) {
        actions.clear();
        submission.step(now, FromBroker{std::move(message)}, actions);
    }
    [[nodiscard]] std::optional<Outcome> outcome() const {
        for (const Action& action : actions)
            if (const auto* news = std::get_if<News>(&action))
                if (const auto* finished = std::get_if<Finished>(news))
                    return finished->outcome;
        return std::nullopt;
    }
    template <class M>
    [[nodiscard]] std::optional<M> sent() const {
        for (const Action& action : actions)
            if (const auto* send = std::get_if<Send>(&action))
                if (const auto* m = std::get_if<M>(&send->message))
                    return *m;
        return std::nullopt;
    }
};

} // namespace

TEST_CASE("a scene travels in chunks, the job is acknowledged, its tiles come") {
    const FakeJob job;
    for (const std::size_t size : {std::size_t{1}, protocol::chunk_bytes - 1, protocol::chunk_bytes,
                                   3 * protocol::chunk_bytes + 17}) {
        CAPTURE(size);
        FakeFarm farm(job, {}, 1);
        Submission submission(request_for(job, scene_of(size)), Rng(1));
        REQUIRE(farm.run(submission, 60s));
        check_whole(farm);
        CHECK(farm.scene_received == scene_of(size));
        CHECK(farm.submissions == 1);
        CHECK(farm.accepted_count == 1);
    }
}

TEST_CASE("a detached submission ends with the acknowledgement") {
    const FakeJob job;
    FakeFarm farm(job, {}, 1);
    auto request = request_for(job, scene_of(100));
    request.detach = true;
    Submission submission(std::move(request), Rng(1));
    REQUIRE(farm.run(submission, 60s));
    CHECK(farm.outcome == Outcome{});
    CHECK(farm.accepted_count == 1);
    CHECK(farm.state().phase == protocol::JobPhase::queued);
    CHECK(farm.delivered.empty());
    CHECK(farm.nonces.empty());
}

TEST_CASE("whatever is lost on the way, the picture becomes whole") {
    for_each_seed(300, [](Rng& rng) {
        Faults faults{.stream_drop = rng.unit() * 0.8,
                      .stream_repeat = rng.unit() * 0.3,
                      .session_drop = rng.below(2) == 0 ? rng.unit() * 0.3 : 0,
                      .rubbish = rng.below(2) == 0 ? 0 : 0.3,
                      .delay_max = std::chrono::milliseconds(1 + rng.below(300)),
                      .stream_delay_max = std::chrono::milliseconds(1 + rng.below(800)),
                      .heal_after = std::chrono::seconds(rng.below(8))};
        for (std::uint64_t i = rng.below(3); i > 0; --i)
            faults.forgets_sessions.push_back(std::chrono::milliseconds(rng.below(6000)));
        for (std::uint64_t i = rng.below(3); i > 0; --i)
            faults.forgets_all.push_back(std::chrono::milliseconds(rng.below(6000)));
        for (std::uint64_t i = rng.below(2); i > 0; --i) {
            const auto from = std::chrono::milliseconds(1000 + rng.below(6000));
            faults.partitions.emplace_back(from, from + std::chrono::milliseconds(rng.below(6000)));
        }
        FakeJob job;
        job.repair_tiles_max = static_cast<std::uint32_t>(1 + rng.below(40));
        FakeFarm farm(job, faults, rng.next());
        Submission submission(request_for(job, scene_of(1 + rng.below(2 * protocol::chunk_bytes))),
                              Rng(rng.next()));
        REQUIRE(farm.run(submission, 120s));
        check_whole(farm);
    });
}

TEST_CASE("an unanswered submission is repeated after two seconds") {
    Dialogue d(request_for({}, scene_of(10)));
    CHECK(d.sent<protocol::SubmitJob>().has_value());
    d.actions.clear();
    for (d.now = Instant{} + 100ms; d.now < Instant{} + 2s; d.now = d.now + 100ms)
        d.submission.step(d.now, Tick{}, d.actions);
    CHECK_FALSE(d.sent<protocol::SubmitJob>().has_value());
    d.submission.step(Instant{} + 2s, Tick{}, d.actions);
    CHECK(d.sent<protocol::SubmitJob>().has_value());
}

TEST_CASE("a time limit is what is left of it when the job is first sent, and then stays") {
    SubmissionRequest request = request_for({}, scene_of(10));
    request.job.settings.time_limit = 5s;
    request.ends_at = Instant{} + 4500ms;
    Dialogue d(request);
    REQUIRE(d.sent<protocol::SubmitJob>().has_value());
    CHECK(d.sent<protocol::SubmitJob>()->settings.time_limit == 4500ms);
    d.actions.clear();
    d.submission.step(Instant{} + 2s, Tick{}, d.actions); // the same job again
    REQUIRE(d.sent<protocol::SubmitJob>().has_value());
    CHECK(d.sent<protocol::SubmitJob>()->settings.time_limit == 4500ms);
    request.ends_at = Instant{} - 1s; // too late: the first pass all the same
    CHECK(Dialogue(request).sent<protocol::SubmitJob>()->settings.time_limit == 1ms);
}

TEST_CASE("refusals of the submission have their exit codes") {
    using enum protocol::RefusalCode;
    struct Row {
        protocol::RefusalCode code;
        std::optional<ExitCode> want;
    };
    for (const Row& row :
         {Row{limit_exceeded, ExitCode::usage}, Row{invalid, ExitCode::usage},
          Row{conflict, ExitCode::usage}, Row{unexpected, ExitCode::usage},
          Row{malformed, ExitCode::usage}, Row{version_mismatch, ExitCode::refused},
          Row{unknown_peer, std::nullopt}, Row{no_such_job, std::nullopt}}) {
        CAPTURE(static_cast<int>(row.code));
        Dialogue d(request_for({}, scene_of(10)));
        d.say(protocol::Refused{row.code, JobId{}, "because"});
        CHECK(d.outcome().has_value() == row.want.has_value());
        if (row.want)
            CHECK(d.outcome()->code == *row.want);
    }
    Dialogue d(request_for({}, scene_of(10)));
    d.say(protocol::Refused{invalid, JobId{{77}}, "another job's"});
    CHECK_FALSE(d.outcome().has_value());
}

TEST_CASE("a chunk that the scene does not have is refused, not invented") {
    const Bytes scene = scene_of(10);
    const ContentHash hash = protocol::content_hash(scene);
    Dialogue d(request_for({}, scene));
    for (const protocol::NeedChunk& bad :
         {protocol::NeedChunk{hash, 1}, protocol::NeedChunk{hash, protocol::chunk_bytes},
          protocol::NeedChunk{hash, UINT64_MAX / protocol::chunk_bytes * protocol::chunk_bytes},
          protocol::NeedChunk{ContentHash{}, 0}}) {
        d.say(bad);
        CHECK_FALSE(d.sent<protocol::Chunk>().has_value());
        CHECK(d.sent<protocol::Refused>()->code == protocol::RefusalCode::invalid);
    }
    d.say(protocol::NeedChunk{hash, 0});
    REQUIRE(d.sent<protocol::Chunk>().has_value());
    CHECK(d.sent<protocol::Chunk>()->blobs.at(0) == Blob(scene));
}

TEST_CASE("another job's state is no acknowledgement") {
    const auto request = request_for({}, scene_of(10));
    protocol::JobState state;
    state.job = request.job.job;
    state.scene = request.job.scene;
    state.settings = request.job.settings;
    state.phase = protocol::JobPhase::queued;
    state.cell_side = 20; // of 40 x 30 pixels
    state.cell_count = 4;
    std::vector<protocol::JobState> wrong(4, state);
    wrong[0].job = JobId{{6}};
    wrong[1].scene = ContentHash{};
    wrong[2].settings.depth += 1;
    wrong[3].cell_count = UINT32_MAX;
    for (const auto& bad : wrong) {
        Dialogue d(request);
        d.say(bad);
        CHECK_FALSE(d.submission.is_accepted());
    }
    Dialogue d(request);
    d.say(state);
    CHECK(d.submission.is_accepted());
}

TEST_CASE("who resumes takes over another job of the same picture, and no other") {
    auto request = request_for({}, scene_of(10));
    request.job.resume = true;
    protocol::JobState state;
    state.job = JobId{{6}};
    state.scene = request.job.scene;
    state.settings = request.job.settings;
    state.phase = protocol::JobPhase::running;
    state.cell_side = 20; // of 40 x 30 pixels
    state.cell_count = 4;
    protocol::JobState wrong = state;
    wrong.settings.depth += 1;
    Dialogue d(request);
    d.say(wrong);
    CHECK_FALSE(d.submission.is_accepted());
    d.say(state);
    REQUIRE(d.submission.is_accepted());
    CHECK(d.submission.follower()->state().job == state.job);
}

TEST_CASE("when the time is up the client leaves, before and after the acknowledgement") {
    for (const Duration timeout : {Duration(0s), Duration(1ms), Duration(500ms)}) {
        const FakeJob job;
        FakeFarm farm(job, {}, 1);
        auto request = request_for(job, scene_of(100));
        request.timeout = timeout;
        Submission submission(std::move(request), Rng(1));
        REQUIRE(farm.run(submission, 60s));
        CHECK(farm.outcome->code == ExitCode::timed_out);
        CHECK(farm.now() <= Instant{} + timeout + 100ms);
    }
}

TEST_CASE("a broker that dies before the acknowledgement is given up, one after is waited for") {
    const FakeJob job;
    Faults silent;
    silent.partitions = {{0s, 60s}};
    FakeFarm never(job, silent, 1);
    Submission hopeless(request_for(job, scene_of(100)), Rng(1));
    REQUIRE(never.run(hopeless, 60s));
    CHECK(never.outcome->code == ExitCode::unreachable);
    CHECK(never.now() == Instant{} + 10s);

    silent.partitions = {{1s, 60s}};
    FakeFarm later(job, silent, 1);
    Submission patient(request_for(job, scene_of(100)), Rng(1));
    REQUIRE(later.run(patient, 120s));
    check_whole(later);
    CHECK(later.lost_count == 1);
}
