#include "tests/sim/elections.hpp"

#include "broker/membership.hpp"
#include "common/base/rng.hpp"
#include "tests/sim/agenda.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace fraja::sim {
namespace {

using namespace std::chrono_literals;

constexpr int beats = 4;               // in a heartbeat, under both rules
constexpr double patience = 1.3;       // heartbeats, likewise
constexpr Duration order_every = 50ms; // to each worker, by whoever leads

struct Election {};    ///< "I want to lead": to all that are above
struct Alive {};       ///< "I am above you": the answer
struct Coordinator {}; ///< "I lead": to all, and again with every beat
using Vote =
    std::variant<Election, Alive, Coordinator, protocol::BrokerHello, protocol::BrokerBeat>;

/// What one of the rules says to whom.
struct Said {
    Said(std::size_t whom, Vote what) : to(whom), vote(std::move(what)) {}
    std::size_t to;
    Vote vote;
};

class Rule {
public:
    virtual ~Rule() = default;
    virtual void hear(Instant now, std::size_t from, const Vote& vote, std::vector<Said>& said) = 0;
    virtual void tick(Instant now, std::vector<Said>& said) = 0; ///< every beat, and after hearing
    [[nodiscard]] virtual bool leads() const = 0;
    [[nodiscard]] virtual protocol::Term term() const { return {}; }
    virtual void learn(Instant, const protocol::Term&) {} ///< a worker has heard of it
};

BrokerId id_of(std::size_t index) {
    BrokerId id;
    id.bytes[15] = static_cast<std::uint8_t>(index + 1);
    return id;
}

class Ours final : public Rule {
public:
    Ours(const ElectionPlan& plan, std::size_t self, Instant now, std::uint64_t life)
        : brokers_(plan.brokers), self_(self), started_(now.since_start),
          membership_({now.since_start, id_of(self)},
                      {.patience = from_seconds(patience * seconds(plan.heartbeat)),
                       .patience_max = from_seconds(2 * patience * seconds(plan.heartbeat)),
                       .settling = plan.heartbeat / 2,
                       .counter_min = life},
                      false, now) {}

    void hear(Instant now, std::size_t, const Vote& vote, std::vector<Said>&) override {
        if (const auto* hello = std::get_if<protocol::BrokerHello>(&vote))
            (void)membership_.meet(now, *hello);
        else if (const auto* beat = std::get_if<protocol::BrokerBeat>(&vote))
            membership_.hear(now, *beat);
        update(now);
    }
    void tick(Instant now, std::vector<Said>& said) override {
        if (!membership_.is_synced() && membership_.has_looked_around(now))
            membership_.set_synced(now);
        update(now);
        protocol::BrokerHello hello;
        hello.broker = id_of(self_);
        hello.started_at = started_;
        protocol::BrokerBeat beat;
        beat.broker = id_of(self_);
        beat.term = membership_.term();
        beat.is_synced = membership_.is_synced();
        for (std::size_t to = 0; to < brokers_; ++to)
            if (to != self_) {
                said.emplace_back(to, hello);
                said.emplace_back(to, beat);
            }
    }
    [[nodiscard]] bool leads() const override { return membership_.leads(); }
    [[nodiscard]] protocol::Term term() const override { return membership_.term(); }
    void learn(Instant now, const protocol::Term& term) override {
        membership_.learn(term);
        update(now);
    }

private:
    void update(Instant now) { (void)membership_.update(now); }

    std::size_t brokers_, self_;
    Duration started_;
    broker::Membership membership_;
};

class Bully final : public Rule {
public:
    Bully(const ElectionPlan& plan, std::size_t self, Instant now)
        : brokers_(plan.brokers), self_(self),
          patience_(from_seconds(patience * seconds(plan.heartbeat))), heard_at_(now) {}

    void hear(Instant now, std::size_t from, const Vote& vote, std::vector<Said>& said) override {
        if (std::holds_alternative<Election>(vote)) {
            said.emplace_back(from, Alive{});
            if (!elects_until_ && !leads_)
                elect(now, said);
            else if (leads_)
                announce(said);
        } else if (std::holds_alternative<Alive>(vote)) {
            if (elects_until_)
                elects_until_ = now + 2 * patience_; // it will announce itself
            answered_ = true;
        } else if (std::holds_alternative<Coordinator>(vote)) {
            if (from < self_)
                return elect(now, said); // it bullies
            leads_ = false;
            elects_until_.reset();
            heard_at_ = now;
        }
    }
    void tick(Instant now, std::vector<Said>& said) override {
        if (leads_)
            announce(said);
        else if (elects_until_ && now >= *elects_until_)
            answered_ ? elect(now, said) : lead(said);
        else if (!elects_until_ && now - heard_at_ > patience_)
            elect(now, said);
    }
    [[nodiscard]] bool leads() const override { return leads_; }

private:
    void elect(Instant now, std::vector<Said>& said) {
        answered_ = false;
        elects_until_ = now + patience_;
        for (std::size_t above = self_ + 1; above < brokers_; ++above)
            said.emplace_back(above, Election{});
        if (self_ + 1 == brokers_)
            lead(said);
    }
    void lead(std::vector<Said>& said) {
        leads_ = true;
        elects_until_.reset();
        announce(said);
    }
    void announce(std::vector<Said>& said) const {
        for (std::size_t to = 0; to < brokers_; ++to)
            if (to != self_)
                said.emplace_back(to, Coordinator{});
    }

    std::size_t brokers_, self_;
    Duration patience_;
    Instant heard_at_; ///< of a coordinator
    std::optional<Instant> elects_until_;
    bool answered_ = false, leads_ = false;
};

class Contest {
public:
    explicit Contest(const ElectionPlan& plan)
        : plan_(plan), rng_(plan.seed), nodes_(plan.brokers), workers_(plan.workers),
          moved_(plan.brokers) {}

    ElectionReport run() {
        for (std::size_t i = 0; i < nodes_.size(); ++i)
            start(i);
        every(plan_.crashes_every, [this] { crash(); });
        every(plan_.partitions_every, [this] { cut(); });
        every(plan_.hangs_every, [this] { hang(); });
        look();
        const Instant end = Instant{} + plan_.time;
        while (agenda_.next() <= end)
            agenda_.run_next();
        const std::uint64_t busiest = *std::ranges::max_element(moved_);
        report_.busiest = report_.tiles > 0
                              ? static_cast<double>(busiest) / static_cast<double>(report_.tiles)
                              : 0;
        return report_;
    }

private:
    struct Node {
        std::unique_ptr<Rule> rule; ///< null: it is down
        std::uint64_t life = 0;
        Instant frozen_until{}, cut_until{};
        bool is_apart = false; ///< while it is cut off: from those that are not
        std::optional<Instant> leads_since;
        std::uint64_t reign = 0; ///< counts whoever begins to lead, of all
    };
    struct Worker {
        protocol::Term term;
        std::uint64_t reign = 0;      ///< that it obeyed last
        std::set<std::uint64_t> left; ///< that it obeyed before others
    };

    void start(std::size_t i) {
        Node& node = nodes_[i];
        ++node.life;
        node.leads_since.reset();
        if (plan_.rule == ElectionRule::ours)
            node.rule = std::make_unique<Ours>(plan_, i, agenda_.now(), node.life);
        else
            node.rule = std::make_unique<Bully>(plan_, i, agenda_.now());
        beat(i);
        order(i);
    }

    // ------------------------------------------------------------------------------- accidents
    template <class F>
    void every(Duration mean, F deed) {
        if (mean <= Duration::zero())
            return;
        agenda_.after(from_seconds(-std::log(1 - rng_.unit()) * seconds(mean)), [this, mean, deed] {
            deed();
            every(mean, deed);
        });
    }
    Duration up_to(Duration max) { return from_seconds(rng_.unit() * seconds(max)); }
    void crash() {
        const std::size_t i = rng_.below(nodes_.size());
        if (!nodes_[i].rule)
            return;
        nodes_[i].rule.reset();
        ++nodes_[i].life;
        nodes_[i].leads_since.reset();
        agenda_.after(up_to(plan_.down_max), [this, i] { start(i); });
    }
    void cut() {
        const Instant until = agenda_.now() + up_to(plan_.partition_max);
        for (Node& node : nodes_) {
            node.is_apart = rng_.below(2) == 0;
            node.cut_until = until;
        }
    }
    void hang() {
        nodes_[rng_.below(nodes_.size())].frozen_until = agenda_.now() + up_to(plan_.hang_max);
    }
    [[nodiscard]] bool hear_each_other(std::size_t a, std::size_t b) const {
        return agenda_.now() >= nodes_[a].cut_until || nodes_[a].is_apart == nodes_[b].is_apart;
    }

    // -------------------------------------------------------------------------------- brokers
    /// Done when it is awake, if it still lives then.
    template <class F>
    void in_node(std::size_t i, F deed) {
        Node& node = nodes_[i];
        if (agenda_.now() >= node.frozen_until)
            return deed();
        agenda_.at(node.frozen_until, [this, i, life = node.life, deed]() mutable {
            if (nodes_[i].life == life)
                in_node(i, std::move(deed));
        });
    }
    void beat(std::size_t i) {
        in_node(i, [this, i] {
            say(i, [](Rule& rule, Instant now, std::vector<Said>& said) { rule.tick(now, said); });
        });
        agenda_.after(plan_.heartbeat / beats, [this, i, life = nodes_[i].life] {
            if (nodes_[i].life == life)
                beat(i);
        });
    }
    using Step = std::function<void(Rule&, Instant, std::vector<Said>&)>;
    void say(std::size_t i, const Step& step) {
        std::vector<Said> said;
        step(*nodes_[i].rule, agenda_.now(), said);
        note_leading(i);
        for (Said& words : said) {
            ++report_.votes;
            if (!hear_each_other(i, words.to))
                continue;
            agenda_.after(up_to(plan_.delay_max), [this, from = i, words] {
                if (nodes_[words.to].rule && hear_each_other(from, words.to))
                    in_node(words.to, [this, from, words] {
                        say(words.to, [&](Rule& rule, Instant now, std::vector<Said>& more) {
                            rule.hear(now, from, words.vote, more);
                        });
                    });
            });
        }
    }
    void note_leading(std::size_t i) {
        Node& node = nodes_[i];
        if (node.rule->leads() && !node.leads_since) {
            node.leads_since = agenda_.now();
            node.reign = ++report_.elections;
        } else if (!node.rule->leads()) {
            node.leads_since.reset();
        }
    }

    // -------------------------------------------------------------------------------- workers
    void order(std::size_t i) {
        in_node(i, [this, i] {
            for (Worker& worker : workers_)
                if (nodes_[i].rule->leads())
                    give(i, worker);
            note_leading(i);
        });
        agenda_.after(order_every, [this, i, life = nodes_[i].life] {
            if (nodes_[i].life == life)
                order(i);
        });
    }
    /// Workers hear all brokers, whoever of these does not hear whom.
    void give(std::size_t i, Worker& worker) {
        const Node& node = nodes_[i];
        ++moved_[i];
        if (plan_.rule == ElectionRule::ours) {
            if (node.rule->term() < worker.term)
                return nodes_[i].rule->learn(agenda_.now(), worker.term);
            worker.term = node.rule->term();
        }
        ++report_.tiles;
        if (worker.reign != node.reign) {
            report_.replaced += worker.left.contains(node.reign);
            worker.left.insert(std::exchange(worker.reign, node.reign));
        }
        for (std::size_t to = 0; to < nodes_.size(); ++to) {
            const bool answers =
                plan_.rule == ElectionRule::ours ? nodes_[to].rule != nullptr : to == i;
            const std::size_t watchers =
                plan_.rule == ElectionRule::ours
                    ? plan_.watchers / nodes_.size() + (to < plan_.watchers % nodes_.size())
                    : plan_.watchers;
            moved_[to] += answers ? 1 + watchers : 0;
        }
    }

    /// Now and then: who leads.
    void look() {
        std::vector<std::size_t> leaders;
        for (std::size_t i = 0; i < nodes_.size(); ++i)
            if (nodes_[i].leads_since && agenda_.now() >= nodes_[i].frozen_until)
                leaders.push_back(i);
        constexpr Duration pause = 10ms;
        report_.without += leaders.empty() ? pause : Duration::zero();
        const bool several = std::ranges::any_of(leaders, [&](std::size_t a) {
            return std::ranges::any_of(
                leaders, [&](std::size_t b) { return a < b && hear_each_other(a, b); });
        });
        report_.with_several += several ? pause : Duration::zero();
        agenda_.after(pause, [this] { look(); });
    }

    const ElectionPlan& plan_;
    Rng rng_;
    Agenda agenda_;
    std::vector<Node> nodes_;
    std::vector<Worker> workers_;
    std::vector<std::uint64_t> moved_;
    ElectionReport report_;
};

} // namespace

ElectionReport run_election(const ElectionPlan& plan) {
    return Contest(plan).run();
}

} // namespace fraja::sim
