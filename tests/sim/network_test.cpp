// The pretended network: what comes, how often, and in which order.
#include "tests/sim/network.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <utility>
#include <variant>
#include <vector>

namespace fraja::sim {
namespace {

using namespace std::chrono_literals;

/// A broker and a node of it, which is connected.
struct Pair {
    explicit Pair(const Scenario& s) : farm(s), network(farm, broker) {
        network.broker_hears = [this](const broker::PeerId&, protocol::Message&& message) {
            if (std::holds_alternative<protocol::WorkerHello>(message))
                heard.push_back(hello);
            else
                heard.push_back(std::get<protocol::WorkerBeat>(message).credit);
        };
        line.hear = [this](protocol::Message&& message) {
            heard.push_back(std::get<protocol::RenderTile>(message).pass);
        };
        network.begin_life(broker);
        network.begin_life(node);
        network.connect(line);
        run();
    }
    void run() {
        while (!farm.agenda.empty())
            farm.agenda.run_next();
    }
    void say(std::uint32_t number) {
        protocol::Message message = protocol::WorkerBeat{.credit = number, .in_flight = {}};
        REQUIRE(network.to_broker(line, message));
    }
    void say_hello() {
        protocol::Message message = protocol::WorkerHello{};
        REQUIRE(network.to_broker(line, message));
    }
    void send_order(std::uint32_t number) {
        protocol::RenderTile order;
        order.pass = number;
        REQUIRE(network.to_node(line.peer, std::move(order)));
    }

    static constexpr std::uint32_t hello = 1'000;
    Farm farm;
    Process broker, node;
    Line line{node};
    Network network;
    std::vector<std::uint32_t> heard; ///< their numbers
};

Scenario scenario_with(double duplicates, Duration lag_max) {
    Scenario s;
    s.seed = 5;
    s.faults.heals_at = 1h;
    s.faults.duplicates = duplicates;
    s.faults.duplicate_lag_max = lag_max;
    return s;
}

TEST_CASE("without faults a message comes once, in order") {
    const Scenario s = scenario_with(0, 1s);
    Pair pair(s);
    for (std::uint32_t i = 0; i < 100; ++i)
        pair.say(i);
    pair.run();
    CHECK(pair.heard.size() == 100);
    CHECK(std::ranges::is_sorted(pair.heard));
    CHECK(pair.farm.report.duplicates == 0);
}

TEST_CASE("a duplicate comes after its message: directly, or after others") {
    for (const bool orders : {false, true}) {
        const Scenario s = scenario_with(0.5, 5ms);
        Pair pair(s);
        for (std::uint32_t i = 0; i < 1'000; ++i)
            orders ? pair.send_order(i) : pair.say(i);
        pair.run();
        std::vector<std::uint32_t> first;
        std::size_t directly = 0, later = 0;
        for (std::size_t k = 0; k < pair.heard.size(); ++k)
            if (std::ranges::find(first, pair.heard[k]) == first.end())
                first.push_back(pair.heard[k]);
            else
                ++(pair.heard[k - 1] == pair.heard[k] ? directly : later);
        CHECK(first.size() == 1'000);
        CHECK(std::ranges::is_sorted(first));
        CHECK(directly + later == pair.farm.report.duplicates);
        CHECK(directly > 100);
        CHECK(later > 100);
    }
}

TEST_CASE("when all is healed nothing comes twice") {
    Scenario s = scenario_with(1, 1s);
    s.faults.heals_at = Duration::zero();
    Pair pair(s);
    pair.say(1);
    pair.run();
    CHECK(pair.heard.size() == 1);
}

TEST_CASE("no duplicate of what was said before a hello comes after it") {
    const Scenario s = scenario_with(1, 1s);
    Pair pair(s);
    for (std::uint32_t i = 0; i < 100; ++i)
        pair.say(i);
    pair.say_hello();
    pair.run();
    const auto at = std::ranges::find(pair.heard, Pair::hello);
    CHECK(std::count(at, pair.heard.end(), Pair::hello) == 2); // which may come twice itself
    CHECK(pair.heard.end() - at == 2);
}

TEST_CASE("a duplicate is lost with its connection") {
    const Scenario s = scenario_with(1, 1h);
    Pair pair(s);
    pair.say(1);
    pair.network.break_line(pair.line);
    pair.run();
    CHECK(pair.heard.empty());
}

TEST_CASE("what shares a pipe goes through it one after the other, each way by itself") {
    Scenario s = scenario_with(0, {});
    s.faults.delay_min = s.faults.delay_max = 1ms;
    Pair pair(s);
    const auto run_for = [&](std::uint32_t count) {
        const Instant sent = pair.farm.now();
        for (std::uint32_t i = 0; i < count; ++i)
            pair.say(i);
        pair.run();
        return pair.farm.now() - sent;
    };
    CHECK(run_for(1) == 1ms);
    Pipe slow({.delay = 20ms, .bytes_per_s = 0});
    pair.line.pipe = &slow;
    CHECK(run_for(10) == 21ms);
    Pipe narrow({.delay = 20ms, .bytes_per_s = 1'000});
    pair.line.pipe = &narrow;
    const Duration one = run_for(1) - 21ms, ten = run_for(10) - 21ms;
    CHECK(one > 5ms); // of some bytes
    CHECK(seconds(ten) == doctest::Approx(10 * seconds(one)).epsilon(0.1));
    // What goes the other way does not wait for it.
    pair.heard.clear();
    for (std::uint32_t i = 0; i < 10; ++i)
        pair.say(i);
    pair.send_order(500);
    pair.run();
    CHECK(std::ranges::find(pair.heard, 500) < pair.heard.end() - 5);
    CHECK(pair.network.traffic().heard == 32);
    CHECK(pair.network.traffic().beats == 32);
    CHECK(pair.network.traffic().said == 1);
    CHECK(pair.network.traffic().connections == 1);
}

TEST_CASE("what comes to a broker that is busy waits, in order") {
    Scenario s = scenario_with(0, {});
    s.faults.delay_min = s.faults.delay_max = 1ms;
    s.service = {.answer = 2s, .mib = 40s, .beat = 10ms};
    Pair pair(s);
    std::vector<Instant> heard_at;
    pair.network.broker_hears = [&](const broker::PeerId&, protocol::Message&&) {
        heard_at.push_back(pair.farm.now());
    };
    const Instant sent = pair.farm.now();
    for (std::uint32_t i = 0; i < 3; ++i)
        pair.say(i);
    protocol::TileRendered tile;
    tile.blobs = {Blob(std::vector<std::byte>(std::size_t{1} << 18))};
    protocol::Message message = std::move(tile);
    REQUIRE(pair.network.to_broker(pair.line, message));
    pair.say_hello();
    pair.run();
    CHECK(heard_at ==
          std::vector{sent + 1ms, sent + 11ms, sent + 21ms, sent + 31ms, sent + 12s + 31ms});
    CHECK(pair.network.traffic().busy == 12s + 30ms);
}

TEST_CASE("a cut goes between a group and all others, and nowhere else") {
    const Scenario s = scenario_with(0, {});
    Farm farm(s);
    Process root, branch, with_branch, elsewhere;
    Network above(farm, root), below(farm, branch);
    Line of_branch(branch), of_one_with_it(with_branch), of_one_elsewhere(elsewhere);
    const std::vector<Node> nodes = {
        {&of_branch, &above}, {&of_one_with_it, &below}, {&of_one_elsewhere, &above}};
    const auto cut = [&](const std::set<const Process*>& group) {
        for (const Node& node : nodes)
            node.line->silent_until = {};
        cut_off(group, nodes, Instant{} + 10s);
        std::vector<bool> silent;
        for (const Node& node : nodes)
            silent.push_back(node.line->silent_until > Instant{});
        return silent;
    };
    CHECK(cut({&branch, &with_branch}) == std::vector{true, false, false});
    CHECK(cut({&branch}) == std::vector{true, true, false});
    CHECK(cut({&with_branch}) == std::vector{false, true, false});
    CHECK(cut({&with_branch, &elsewhere}) == std::vector{false, true, true});
    CHECK(cut({&branch, &with_branch, &elsewhere}) == std::vector{true, false, true});
}

TEST_CASE("what is said across a cut goes through when it heals, or breaks with its connection") {
    const Scenario s = scenario_with(0, {});
    Pair pair(s);
    const std::vector<Node> nodes = {{&pair.line, &pair.network}};
    cut_off({&pair.node}, nodes, pair.farm.now() + 10s);
    const Instant healed = pair.farm.now() + 10s;
    pair.say(1);
    pair.run();
    CHECK(pair.heard == std::vector<std::uint32_t>{1});
    CHECK(pair.farm.now() == healed);
    pair.say(2);
    cut_off({&pair.node}, nodes, pair.farm.now() + 40s);
    pair.run();
    CHECK(pair.heard == std::vector<std::uint32_t>{1});
    CHECK(pair.line.up); // it has found back
}

TEST_CASE(
    "a program that is woken again and again for what is over is told of, and one in time is not") {
    const Scenario s = scenario_with(0, {});
    for (const Duration ahead : {Duration::zero(), Duration(1us)}) {
        CAPTURE(ahead.count());
        Pair pair(s);
        int left = 2'000;
        pair.node.tick = [&] {
            pair.network.wake(pair.node, --left > 0 ? pair.farm.now() + ahead : Instant::never());
        };
        pair.node.tick();
        pair.run();
        CHECK(left == 0);
        CHECK(pair.farm.report.violations.size() == (ahead == Duration::zero() ? 1 : 0));
    }
}

} // namespace
} // namespace fraja::sim
