// The session under a broker, render threads and a clock that do what they like.
#include "tests/support/seeds.hpp"
#include "tests/worker/session_driver.hpp"

#include <doctest/doctest.h>
#include <map>
#include <set>
#include <tuple>

using namespace fraja;
using namespace fraja::worker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

namespace {

using Key = std::tuple<JobId, TileIndex, AttemptNumber>;

template <class M>
Key key_of(const M& m) {
    return {m.job, m.tile, m.attempt};
}

/// Knows what was promised, and checks every action against it.
class Watch {
public:
    explicit Watch(std::uint32_t credit) : credit_(credit) {}

    void before(const Event& event) {
        if (const auto* received = std::get_if<Received>(&event)) {
            if (std::holds_alternative<Welcome>(received->message)) {
                connected_ = !over_;
            } else if (const auto* tile = std::get_if<RenderTile>(&received->message);
                       tile && tile->attempt > last_attempt_) { // or it has come before
                last_attempt_ = tile->attempt;
                if (connected_)
                    owed_.insert(key_of(*tile));
            }
        } else if (const auto* finished = std::get_if<TileFinished>(&event)) {
            running_.erase(finished->ticket);
        } else if (const auto* broken = std::get_if<TileBroken>(&event)) {
            running_.erase(broken->ticket);
        } else if (const auto* compiled = std::get_if<SceneCompiled>(&event)) {
            if (compiling.erase(compiled->scene))
                compiled_.insert(compiled->scene);
        } else if (const auto* failed = std::get_if<SceneFailed>(&event)) {
            compiling.erase(failed->scene);
        }
    }

    void check(const Action& action) {
        REQUIRE_FALSE(over_);
        std::visit([&](const auto& a) { on(a); }, action);
    }

    [[nodiscard]] bool connected() const { return connected_; }
    [[nodiscard]] bool over() const { return over_; }
    [[nodiscard]] AttemptNumber last_attempt() const { return last_attempt_; }
    [[nodiscard]] const std::set<Key>& owed() const { return owed_; }
    [[nodiscard]] const std::set<Ticket>& running() const { return running_; }
    std::set<ContentHash> compiling;
    std::vector<NeedChunk> asked;

private:
    void on(const Send& send) {
        if (std::holds_alternative<WorkerHello>(send.message)) {
            connected_ = false;
            owed_.clear();
            return;
        }
        REQUIRE(connected_); // nothing but hellos without a session
        if (const auto* rendered = std::get_if<TileRendered>(&send.message))
            REQUIRE(owed_.erase(key_of(*rendered)) == 1);
        else if (const auto* failed = std::get_if<TileFailed>(&send.message))
            REQUIRE(owed_.erase(key_of(*failed)) == 1);
        else if (const auto* need = std::get_if<NeedChunk>(&send.message))
            asked.push_back(*need);
        else if (const auto* beat = std::get_if<WorkerBeat>(&send.message))
            check_beat(*beat);
        else
            REQUIRE(std::holds_alternative<Goodbye>(send.message));
        if (std::holds_alternative<Goodbye>(send.message))
            REQUIRE(owed_.empty());
    }
    void check_beat(const WorkerBeat& beat) const {
        REQUIRE(beat.in_flight.size() == owed_.size());
        for (const TileInFlight& tile : beat.in_flight)
            REQUIRE(owed_.contains(key_of(tile)));
    }
    void on(const StartTile& start) {
        REQUIRE(tickets_.insert(start.ticket).second);
        REQUIRE(compiled_.contains(start.scene));
        running_.insert(start.ticket);
        REQUIRE(running_.size() <= credit_);
    }
    void on(const StopTile& stop) { REQUIRE(running_.erase(stop.ticket) == 1); }
    void on(const CompileScene& compile) {
        REQUIRE_FALSE(compiled_.contains(compile.scene));
        REQUIRE(compiling.insert(compile.scene).second);
    }
    void on(const ForgetScene& forget) { REQUIRE(compiled_.erase(forget.scene) == 1); }
    void on(const HangUp&) { FAIL("nobody has called"); }
    void on(const Log&) {}
    void on(const Finished&) {
        REQUIRE(running_.empty());
        over_ = true;
        connected_ = false;
    }

    std::uint32_t credit_;
    bool connected_ = false, over_ = false;
    AttemptNumber last_attempt_{};
    std::set<Key> owed_; // tiles of this session not yet answered
    std::set<Ticket> tickets_, running_;
    std::set<ContentHash> compiled_;
};

const std::vector<TestScene>& test_scenes() {
    static const std::vector<TestScene> scenes = [] {
        std::vector<TestScene> made;
        for (const std::size_t size :
             {std::size_t{0}, std::size_t{3}, chunk_bytes, 2 * chunk_bytes + 1})
            for (const char filling : {'a', 'b'})
                if (size > 0 || filling == 'a')
                    made.emplace_back(size, filling);
        return made;
    }();
    return scenes;
}

/// What a broker might send, sound or not.
Message random_message(Rng& rng, const Watch& watch) {
    const auto& scenes = test_scenes();
    const TestScene& scene = scenes[rng.below(scenes.size())];
    const auto tile = static_cast<std::uint32_t>(rng.below(6));
    const auto last = static_cast<std::uint32_t>(watch.last_attempt());
    const auto attempt = rng.below(2) == 0
                             ? last + 1
                             : static_cast<std::uint32_t>(1 + rng.below(last + 1)); // or it was
    const std::uint64_t kind = rng.below(100);
    if (kind < 35) {
        RenderTile message = order(scene, tile, attempt);
        if (rng.below(10) == 0)
            message.rect.x = static_cast<std::uint32_t>(rng.below(300));
        if (rng.below(20) == 0)
            message.scene_bytes += rng.below(3);
        return message;
    }
    if (kind < 60) {
        if (!watch.asked.empty() && rng.below(5) > 0) {
            const NeedChunk& need = watch.asked[rng.below(watch.asked.size())];
            for (const TestScene& s : scenes)
                if (s.hash == need.blob)
                    return s.chunk(need.offset_bytes);
        }
        Chunk chunk = scene.chunk(0);
        chunk.offset_bytes = rng.below(2) * chunk_bytes;
        chunk.total_bytes += rng.below(2);
        return chunk;
    }
    if (kind < 65 && !watch.owed().empty()) {
        auto at = watch.owed().begin();
        std::advance(at, static_cast<std::ptrdiff_t>(rng.below(watch.owed().size())));
        const auto& [job, owed, of] = *at;
        return CancelTile{job, owed, of};
    }
    if (kind < 70)
        return CancelTile{job_id(1), TileIndex{tile}, AttemptNumber{attempt}};
    if (kind < 80)
        return Beat{};
    if (kind < 90) {
        Welcome message = welcome();
        if (rng.below(10) == 0)
            message.heartbeat = rng.below(2) ? Duration::min() : Duration::max();
        if (rng.below(10) == 0)
            message.liveness = rng.below(2) ? 0 : UINT32_MAX;
        return message;
    }
    if (kind < 97) {
        const auto code = static_cast<RefusalCode>(rng.below(8));
        const bool kept = code == RefusalCode::version_mismatch && rng.below(20) > 0;
        return Refused{kept ? RefusalCode::invalid : code, {}, "no"};
    }
    return rng.below(2) ? Message(JobState{}) : Message(Goodbye{});
}

Error random_error(Rng& rng) {
    constexpr ErrorCode codes[] = {ErrorCode::invalid_scene, ErrorCode::unresolved_overlap,
                                   ErrorCode::limit_exceeded, ErrorCode::cancelled, ErrorCode::io};
    return {codes[rng.below(std::size(codes))], std::string(rng.below(9000), 'e')};
}

template <class T>
T one_of(Rng& rng, const std::set<T>& set) {
    return *std::next(set.begin(), static_cast<std::ptrdiff_t>(rng.below(set.size())));
}

/// What render threads might say: of what they were asked, or of what nobody asked (any more).
Event random_result(Rng& rng, const Watch& watch) {
    if (!watch.compiling.empty() && rng.below(2)) {
        const ContentHash scene = one_of(rng, watch.compiling);
        if (rng.below(4) == 0)
            return SceneFailed{scene, random_error(rng)};
        return SceneCompiled{scene};
    }
    const Ticket ticket =
        watch.running().empty() ? Ticket{rng.below(50)} : one_of(rng, watch.running());
    if (rng.below(4) == 0)
        return TileBroken{ticket, random_error(rng)};
    return TileFinished{ticket, Rays{rng.below(100), 0, 0, 0}, 1ms, {Blob(Bytes(12))}};
}

Event random_event(Rng& rng, const Watch& watch) {
    const std::uint64_t kind = rng.below(1000);
    if (kind < 600)
        return Received{random_message(rng, watch)};
    if (kind < 850)
        return random_result(rng, watch);
    if (kind < 870)
        return Undecodable{{ErrorCode::malformed_frame, "rubbish"}};
    if (kind < 871)
        return Undecodable{{ErrorCode::version_mismatch, "version 9"}};
    if (kind < 872)
        return Drain{};
    if (kind < 873)
        return StopNow{};
    return Tick{{{Ticket{rng.below(50)}, rng.below(1000)}}};
}

struct Run {
    SessionDriver driver;
    Watch watch;

    explicit Run(const Limits& limits)
        : driver(test_identity(), limits), watch(credit_for(2, limits)) {}

    void step(const Event& event) {
        watch.before(event);
        for (const Action& action : driver.step(event))
            watch.check(action);
        REQUIRE(driver.session.next_deadline() > driver.now); // or the shell would spin
    }
};

/// A broker and threads that do as they should; false when a tile is still owed in the end.
bool settles(Run& run, Rng& rng) {
    run.driver.now = run.driver.now + 1h; // whatever heartbeat was agreed on: time for a beat
    for (int i = 0; i < 10'000; ++i) {
        if (run.watch.over() || (run.watch.connected() && run.watch.owed().empty()))
            return true;
        run.driver.now = std::min(run.driver.session.next_deadline(), run.driver.now + 100ms);
        run.step(Tick{});
        run.step(Received{run.watch.connected() ? Message(Beat{}) : Message(welcome())});
        for (const NeedChunk& need : std::exchange(run.watch.asked, {}))
            for (const TestScene& scene : test_scenes())
                if (scene.hash == need.blob)
                    run.step(Received{scene.chunk(need.offset_bytes)});
        if (!run.watch.compiling.empty() || !run.watch.running().empty())
            run.step(random_result(rng, run.watch));
    }
    return false;
}

} // namespace

TEST_CASE("whatever comes, every tile gets exactly one answer and no promise is broken") {
    Limits limits;
    limits.shelf = {.idle_bytes_max = 2 * chunk_bytes, .idle_count_max = 2};
    for_each_seed(200, [&](Rng& rng) {
        Run run(limits);
        run.step(Tick{});
        for (int i = 0; i < 400; ++i) {
            if (rng.below(3) == 0)
                run.driver.now = run.driver.now + Duration(rng.below(900'000'000));
            run.step(random_event(rng, run.watch));
        }
        CHECK(settles(run, rng));
    });
}
