// The crew under brokers that stand for each other, render threads and a clock that do what they
// like.
#include "tests/support/seeds.hpp"
#include "tests/worker/crew_driver.hpp"

#include <doctest/doctest.h>
#include <map>
#include <set>
#include <tuple>

using namespace fraja;
using namespace fraja::worker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

namespace {

// Names of this file alone: tests are built together.
namespace of_crew {

using Key = std::tuple<JobId, TileIndex, AttemptNumber>;

template <class M>
Key key_of(const M& m) {
    return {m.job, m.tile, m.attempt};
}

struct Owed {
    std::uint32_t giver = 0;
    ContentHash scene;
    bool is_probe = false;
};

constexpr std::uint32_t brokers = 3, threads = 2;

const std::vector<TestScene>& test_scenes() {
    static const std::vector<TestScene> scenes{TestScene(3, 'a'), TestScene(3, 'b'),
                                               TestScene(chunk_bytes + 1, 'c')};
    return scenes;
}

template <class T>
T one_of(Rng& rng, const std::set<T>& set) {
    return *std::next(set.begin(), static_cast<std::ptrdiff_t>(rng.below(set.size())));
}

/// Knows what was promised to whom, and checks every action against it.
class World {
public:
    explicit World(Rng& rng) : rng_(rng), driver_(brokers, test_identity(threads), limits()) {
        step(CrewTick{});
    }

    void random_step() {
        const auto of = static_cast<std::uint32_t>(rng_.below(brokers));
        const std::uint64_t kind = rng_.below(1000);
        if (kind < 180)
            return hear(of, welcome_of(broker(of), list_of_all(), greatest_));
        if (kind < 400)
            return give(of);
        if (kind < 550)
            return answer_ask(of);
        if (kind < 750)
            return end_work(of);
        if (kind < 790)
            return cancel(of);
        if (kind < 860)
            return hear(of, Beat{});
        if (kind < 880) {
            if (is_connected(of))
                greatest_ = {greatest_.counter + 1, broker_id(broker(of))};
            return hear(of,
                        Brokers{greatest_, rng_.below(2) ? list_of_all() : members({broker(of)})});
        }
        if (kind < 890)
            return hear(of, Refused{RefusalCode::unknown_peer, {}, ""});
        if (kind < 891)
            return hear(of, is_connected(of) ? Message(Dismissed{"go"}) : Message(Beat{}));
        if (kind < 892)
            return step(Drain{});
        if (kind < 893)
            return step(StopNow{});
        driver_.now = driver_.now + Duration(rng_.below(700'000'000));
        step(tick());
    }

    /// Brokers and threads that do as they should; false when a tile is still owed in the end.
    bool settles() {
        for (int i = 0; i < 10'000; ++i) {
            if (driver_.crew.finished() || (owed_.empty() && connected() > 0))
                return true;
            driver_.now = std::min(driver_.crew.next_deadline(), driver_.now + 100ms);
            step(tick());
            for (std::uint32_t of = 0; of < brokers; ++of) {
                if (over_.contains(of))
                    continue;
                if (is_connected(of))
                    hear(of, Beat{});
                else
                    hear(of, welcome_of(broker(of), list_of_all(), greatest_));
                while (!asked_[of].empty())
                    answer_ask(of);
                if (!compiling_[of].empty() || !running_[of].empty())
                    end_work(of);
            }
        }
        return false;
    }

private:
    static Limits limits() {
        Limits limits;
        limits.shelf = {.idle_bytes_max = chunk_bytes, .idle_count_max = 1};
        return limits;
    }
    static bool names(const WorkerBeat& beat, const Key& key) {
        return std::ranges::any_of(beat.in_flight,
                                   [&](const TileInFlight& tile) { return key_of(tile) == key; });
    }
    static std::uint8_t broker(std::uint32_t of) { return static_cast<std::uint8_t>(of + 1); }
    static std::vector<Member> list_of_all() { return members({1, 2, 3}); }
    bool is_connected(std::uint32_t of) const {
        return !over_.contains(of) && driver_.crew.is_connected(session(of));
    }
    std::size_t connected() const {
        std::size_t count = 0;
        for (std::uint32_t of = 0; of < brokers; ++of)
            count += is_connected(of);
        return count;
    }
    CrewTick tick() {
        CrewTick tick;
        for (std::uint32_t of = 0; of < brokers; ++of)
            for (const Ticket ticket : running_[of])
                tick.progress.push_back({session(of), {{ticket, rng_.below(1000)}}});
        return tick;
    }

    // -------------------------------------------------------------------------------- what comes

    void hear(std::uint32_t of, Message message) { step(of, Received{std::move(message)}); }
    void step(std::uint32_t of, Event event) { step(SessionEvent{session(of), std::move(event)}); }

    void give(std::uint32_t of) {
        const TestScene& scene = test_scenes()[rng_.below(test_scenes().size())];
        RenderTile tile = order(scene, static_cast<std::uint32_t>(rng_.below(6)), ++attempts_);
        tile.term = greatest_;
        if (rng_.below(10) == 0)
            tile.term.counter -= std::min<std::uint64_t>(tile.term.counter, 1);
        if (rng_.below(10) == 0)
            tile.probe_side = 4;
        if (rng_.below(20) == 0)
            tile.rect = {};
        given_ = key_of(tile);
        const bool may_be_taken = is_connected(of);
        if (may_be_taken)
            owed_[*given_] = {of, tile.scene, tile.probe_side > 0};
        hear(of, tile);
        const auto is_of_giver = [&](const auto& beat) { return beat.first == of; };
        const auto beat = std::ranges::find_if(beats_, is_of_giver);
        if (may_be_taken && owed_.contains(*given_) && beat != beats_.end() &&
            !names(beat->second, *given_)) {
            // Of a broker that leads no more, or beyond what it takes of all.
            REQUIRE((tile.term < greatest_ ||
                     beat->second.in_flight.size() >= 2 * std::size_t{beat->second.credit}));
            owed_.erase(*given_);
        } else if (owed_.contains(*given_)) {
            // Or nobody else has come yet, or is left who knows it.
            REQUIRE((tile.term == greatest_ || met_.size() < 2 || !over_.empty()));
        }
        given_.reset();
    }

    void answer_ask(std::uint32_t of) {
        if (asked_[of].empty())
            return;
        const NeedChunk need = asked_[of].front();
        asked_[of].erase(asked_[of].begin());
        for (const TestScene& scene : test_scenes())
            if (scene.hash == need.blob)
                hear(of, scene.chunk(need.offset_bytes));
    }

    void end_work(std::uint32_t of) {
        if (!compiling_[of].empty() && rng_.below(2)) {
            const ContentHash scene = one_of(rng_, compiling_[of]);
            compiling_[of].erase(scene);
            if (rng_.below(5) == 0)
                return step(of, SceneFailed{scene, {ErrorCode::io, "no"}});
            compiled_[of].insert(scene);
            return step(of, SceneCompiled{scene});
        }
        if (running_[of].empty())
            return step(of, TileFinished{Ticket{rng_.below(50)}, {}, 1ms, {}}); // of none
        const Ticket ticket = one_of(rng_, running_[of]);
        running_[of].erase(ticket);
        if (rng_.below(5) == 0)
            step(of, TileBroken{ticket, {ErrorCode::io, "no"}});
        else
            step(of, TileFinished{ticket, {}, 1ms, {Blob(Bytes(12))}});
    }

    void cancel(std::uint32_t of) {
        if (owed_.empty())
            return;
        const auto at =
            std::next(owed_.begin(), static_cast<std::ptrdiff_t>(rng_.below(owed_.size())));
        const auto [job, tile, attempt] = at->first;
        hear(of, CancelTile{job, tile, attempt});
    }

    // ---------------------------------------------------------------------------- what it leads to

    void step(const CrewEvent& event) {
        if (driver_.crew.finished())
            return;
        beats_.clear();
        owed_before_ = owed_;
        answered_.clear();
        was_connected_.clear();
        for (std::uint32_t of = 0; of < brokers; ++of)
            if (is_connected(of)) {
                was_connected_.insert(of);
                met_.insert(of);
            }
        const auto* heard = std::get_if<SessionEvent>(&event);
        const bool is_dismissal =
            heard && std::holds_alternative<Received>(heard->event) &&
            std::holds_alternative<Dismissed>(std::get<Received>(heard->event).message);
        for (const CrewAction& action : driver_.step(event)) {
            of_ = static_cast<std::uint32_t>(action.session);
            CAPTURE(of_);
            CAPTURE(action.deed.index());
            REQUIRE((!over_.contains(of_) || std::holds_alternative<ForgetScene>(action.deed)));
            std::visit([&](const auto& deed) { check(deed); }, action.deed);
        }
        check_answers();
        note_losses(is_dismissal ? std::optional(static_cast<std::uint32_t>(heard->session))
                                 : std::nullopt);
        check_beats();
        if (said_goodbye_)
            for (const auto& [key, owed] : owed_)
                REQUIRE((given_ && key == *given_)); // which is not taken
        std::size_t running = 0;
        for (auto& [of, tickets] : running_)
            running += tickets.size();
        REQUIRE(running <= 2 * credit_for(threads, limits()));
        REQUIRE(driver_.crew.next_deadline() > driver_.now); // or the shell would spin
    }

    void check(const Send& send) {
        if (std::holds_alternative<WorkerHello>(send.message)) {
            asked_[of_].clear();
            was_connected_.erase(of_);
            return;
        }
        REQUIRE((was_connected_.contains(of_) || is_connected(of_)));
        if (const auto* rendered = std::get_if<TileRendered>(&send.message)) {
            REQUIRE(answered_[key_of(*rendered)].insert(of_).second); // once to each
        } else if (const auto* failed = std::get_if<TileFailed>(&send.message)) {
            REQUIRE(answered_[key_of(*failed)].insert(of_).second);
        } else if (const auto* need = std::get_if<NeedChunk>(&send.message)) {
            asked_[of_].push_back(*need);
        } else if (const auto* beat = std::get_if<WorkerBeat>(&send.message)) {
            beats_.emplace_back(of_, *beat);
        } else {
            REQUIRE(std::holds_alternative<Goodbye>(send.message));
            said_goodbye_ = true;
        }
    }
    void check(const StartTile& start) {
        REQUIRE(tickets_.insert(start.ticket).second);
        REQUIRE(compiled_[of_].contains(start.scene));
        running_[of_].insert(start.ticket);
    }
    void check(const StopTile& stop) { REQUIRE(running_[of_].erase(stop.ticket) == 1); }
    void check(const CompileScene& compile) {
        REQUIRE_FALSE(compiled_[of_].contains(compile.scene));
        REQUIRE(compiling_[of_].insert(compile.scene).second);
    }
    void check(const ForgetScene& forget) { REQUIRE(compiled_[of_].erase(forget.scene) == 1); }
    void check(const Close&) {
        REQUIRE(running_[of_].empty());
        over_.insert(of_);
    }
    void check(const HangUp&) { FAIL("nobody has called"); }
    void check(const Open&) { FAIL("all brokers were given"); }
    void check(const Log&) {}

    /// All that are there hear an answer; of a probe, and of what is refused at once, the giver.
    void check_answers() {
        for (const auto& [key, to] : answered_) {
            const auto owed = owed_.find(key);
            REQUIRE(owed != owed_.end());
            const bool is_private = owed->second.is_probe || (given_ && key == *given_);
            if (is_private && to.size() == 1) {
                REQUIRE(to.contains(owed->second.giver));
            } else {
                for (const std::uint32_t of : to)
                    REQUIRE(was_connected_.contains(of));
                for (const std::uint32_t of : was_connected_) // and did not go in this very step
                    REQUIRE((to.contains(of) || !is_connected(of)));
            }
            owed_.erase(owed);
        }
    }

    /// Tiles go without a word with a dismissal, where nobody is there any more, and of a lost
    /// broker those whose scene is not, and probes.
    void note_losses(std::optional<std::uint32_t> dismissed) {
        std::erase_if(owed_, [&](const auto& entry) {
            const Owed& owed = entry.second;
            if (connected() == 0 || owed.giver == dismissed)
                return true;
            const bool has_scene = compiled_[owed.giver].contains(owed.scene) ||
                                   compiling_[owed.giver].contains(owed.scene);
            return !is_connected(owed.giver) && (owed.is_probe || !has_scene);
        });
        for (std::uint32_t of = 0; of < brokers; ++of)
            if (!is_connected(of))
                asked_[of].clear();
    }

    /// No tile is dropped while an ally is there: it is named. And none is that is not in hand.
    void check_beats() {
        for (const auto& [of, beat] : beats_) {
            REQUIRE(beat.in_flight.size() <= 2 * credit_for(threads, limits()));
            std::set<Key> named;
            for (const TileInFlight& tile : beat.in_flight)
                REQUIRE(named.insert(key_of(tile)).second);
            for (const Key& key : named)
                REQUIRE((owed_.contains(key) || owed_before_.contains(key)));
            for (const auto& [key, owed] : owed_)
                REQUIRE((named.contains(key) || (given_ && key == *given_)));
        }
    }

    Rng& rng_;
    CrewDriver driver_;
    Term greatest_{1, broker_id(1)};
    std::uint32_t attempts_ = 0;
    std::map<Key, Owed> owed_, owed_before_; // tiles not yet answered: now, and before the step
    std::optional<Key> given_;               // in this step
    std::vector<std::pair<std::uint32_t, WorkerBeat>> beats_; // likewise, and by whom
    std::map<Key, std::set<std::uint32_t>> answered_;
    std::set<std::uint32_t> was_connected_, met_, over_;
    std::map<std::uint32_t, std::vector<NeedChunk>> asked_;
    std::map<std::uint32_t, std::set<ContentHash>> compiling_, compiled_;
    std::map<std::uint32_t, std::set<Ticket>> running_;
    std::set<Ticket> tickets_;
    bool said_goodbye_ = false;
    std::uint32_t of_ = 0;
};

} // namespace of_crew

} // namespace

TEST_CASE("whatever brokers of a farm do, each that is there hears every answer once") {
    for_each_seed(2'000, [](Rng& rng) {
        of_crew::World world(rng);
        for (int i = 0; i < 500; ++i)
            world.random_step();
        CHECK(world.settles());
    });
}
