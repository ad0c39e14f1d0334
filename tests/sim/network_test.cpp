// The pretended network: what comes, how often, and in which order.
#include "tests/sim/network.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <variant>
#include <vector>

namespace fraja::sim {
namespace {

using namespace std::chrono_literals;

/// A broker and a node of it, which is connected.
struct Pair {
    explicit Pair(const Scenario& s) : farm(s), network(farm, broker) {
        network.broker_hears = [this](const broker::PeerId&, protocol::Message&& message) {
            heard.push_back(std::get<protocol::WorkerBeat>(message).credit);
        };
        network.begin_life(broker);
        network.begin_life(node);
        network.connect(node);
        run();
    }
    void run() {
        while (!farm.agenda.empty())
            farm.agenda.run_next();
    }
    void say(std::uint32_t number) {
        protocol::Message message = protocol::WorkerBeat{.credit = number, .in_flight = {}};
        REQUIRE(network.to_broker(node, message));
    }
    Farm farm;
    Process broker, node;
    Network network;
    std::vector<std::uint32_t> heard; ///< their numbers
};

Scenario without_faults() {
    Scenario s;
    s.seed = 5;
    return s;
}

TEST_CASE("without faults a message comes once, in order") {
    const Scenario s = without_faults();
    Pair pair(s);
    for (std::uint32_t i = 0; i < 100; ++i)
        pair.say(i);
    pair.run();
    CHECK(pair.heard.size() == 100);
    CHECK(std::ranges::is_sorted(pair.heard));
}

TEST_CASE("a cut goes between a group and all others, and nowhere else") {
    const Scenario s = without_faults();
    Farm farm(s);
    Process root, branch, with_branch, elsewhere;
    Network above(farm, root), below(farm, branch);
    const std::vector<Node> nodes = {
        {&branch, &above}, {&with_branch, &below}, {&elsewhere, &above}};
    const auto cut = [&](const std::set<const Process*>& group) {
        for (const Node& node : nodes)
            node.process->line.silent_until = {};
        cut_off(group, nodes, Instant{} + 10s);
        std::vector<bool> silent;
        for (const Node& node : nodes)
            silent.push_back(node.process->line.silent_until > Instant{});
        return silent;
    };
    CHECK(cut({&branch, &with_branch}) == std::vector{true, false, false});
    CHECK(cut({&branch}) == std::vector{true, true, false});
    CHECK(cut({&with_branch}) == std::vector{false, true, false});
    CHECK(cut({&with_branch, &elsewhere}) == std::vector{false, true, true});
    CHECK(cut({&branch, &with_branch, &elsewhere}) == std::vector{true, false, true});
}

TEST_CASE("what is said across a cut goes through when it heals, or breaks with its connection") {
    const Scenario s = without_faults();
    Pair pair(s);
    const std::vector<Node> nodes = {{&pair.node, &pair.network}};
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
    CHECK(pair.node.line.up); // it has found back
}

} // namespace
} // namespace fraja::sim
