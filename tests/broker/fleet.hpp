// Several brokers that stand for each other, with workers that serve all of them, for tests: what
// one says another hears at once, and time passes when told.
#pragma once

#include "tests/broker/farm.hpp"

#include <deque>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace fraja::broker {

class Fleet {
public:
    /// `keeps`: each has a store, which keeps all at once.
    explicit Fleet(std::size_t count, Limits those = {}, bool keeps = false)
        : limits(those), keeps_(keeps) {
        for (std::size_t i = 0; i < count; ++i)
            start(i);
    }

    // ---------------------------------------------------------------------------------- brokers
    /// Knowing the one before it, which knows of the others. It is another one each time.
    void start(std::size_t i) {
        nodes.resize(std::max(nodes.size(), i + 1));
        Node& node = nodes[i];
        node.id = id_of<BrokerId>(++ids_);
        std::vector<std::string> peers;
        if (nodes.size() > 1 || i > 0)
            peers.push_back(endpoint(i == 0 ? 1 : i - 1));
        node.dispatcher = std::make_unique<Dispatcher>(
            Dispatcher::Identity{.broker = node.id,
                                 .epoch = static_cast<std::uint64_t>(100 * ids_),
                                 .stream = "tcp://127.0.0.1:50058",
                                 .keeps = keeps_,
                                 .started_at = now,
                                 .unix_offset = std::chrono::seconds(ids_),
                                 .endpoint = advertised.contains(i) ? advertised[i] : endpoint(i),
                                 .peers = std::move(peers)},
            limits);
        event(i, Tick{});
    }
    void kill(std::size_t i) {
        nodes[i].dispatcher.reset();
        nodes[i].cut.clear();
        nodes[i].dialled.clear();
        for (std::size_t other = 0; other < nodes.size(); ++other)
            if (nodes[other].dispatcher)
                event(other, PeerUnreachable{broker_peer(i)});
    }
    /// They hear nothing of each other.
    void cut(std::size_t a, std::size_t b) {
        nodes[a].cut.insert(b);
        nodes[b].cut.insert(a);
    }
    void heal() {
        for (Node& node : nodes)
            node.cut.clear();
    }
    [[nodiscard]] Dispatcher& at(std::size_t i) { return *nodes[i].dispatcher; }
    [[nodiscard]] std::vector<std::size_t> leaders() const {
        std::vector<std::size_t> all;
        for (std::size_t i = 0; i < nodes.size(); ++i)
            if (nodes[i].dispatcher && nodes[i].dispatcher->deals_out())
                all.push_back(i);
        return all;
    }

    // --------------------------------------------------------------------------------- speaking
    void event(std::size_t i, Event e) {
        queue_.emplace_back(i, std::move(e));
        while (!queue_.empty()) {
            auto [target, next] = std::move(queue_.front());
            queue_.pop_front();
            if (!nodes[target].dispatcher)
                continue;
            std::vector<Action> actions;
            nodes[target].dispatcher->step(now, next, actions);
            for (Action& action : actions)
                take(target, std::move(action));
        }
    }
    void say(std::size_t i, const PeerId& peer, protocol::Message message) {
        event(i, PeerSaid{peer, std::move(message)});
    }
    void pass(Duration d) {
        const Instant end = now + d;
        while (now < end) {
            now = std::min(end, now + std::chrono::milliseconds(25));
            for (std::size_t i = 0; i < nodes.size(); ++i)
                if (nodes[i].dispatcher)
                    event(i, Tick{});
            if (now >= next_beats_) {
                next_beats_ = now + limits.heartbeat / 2;
                for (auto& [name, worker] : workers)
                    for (std::size_t i = 0; i < nodes.size(); ++i)
                        if (hears(i, name))
                            beat(i, name);
                for (const PeerId& client : clients_)
                    for (std::size_t i = 0; i < nodes.size(); ++i)
                        if (nodes[i].dispatcher)
                            say(i, client, protocol::Beat{});
            }
        }
    }

    // ---------------------------------------------------------------------------------- workers
    struct Worker {
        std::uint8_t id = 0;
        std::uint32_t credit = 0;
        protocol::Term term{};
        std::vector<protocol::RenderTile> has;
        std::map<std::size_t, std::uint64_t> received; ///< by broker
        bool hangs = false;                            ///< no tile of it moves
        std::set<std::size_t> cut{};                   ///< brokers that hear nothing of it
        std::map<std::size_t, Instant> led_at{};       ///< brokers that have said that they lead
    };
    /// Known to all brokers that are there, and hear it, by that name.
    void worker_arrives(const std::string& name, std::uint8_t id, std::uint32_t credit,
                        std::set<std::size_t> cut = {}) {
        Worker& worker = workers[name] = {};
        worker.id = id;
        worker.credit = credit;
        worker.cut = std::move(cut);
        for (std::size_t i = 0; i < nodes.size(); ++i)
            if (hears(i, name))
                greet(i, name);
    }
    [[nodiscard]] bool hears(std::size_t i, const std::string& name) const {
        return nodes[i].dispatcher && !workers.at(name).cut.contains(i);
    }
    void greet(std::size_t i, const std::string& name) {
        Worker& worker = workers.at(name);
        worker.received[i] = 0;
        say(i, name,
            protocol::WorkerHello{.worker = id_of<WorkerId>(worker.id),
                                  .incarnation = ++incarnations_,
                                  .worker_name = name,
                                  .threads = worker.credit,
                                  .credit = worker.credit,
                                  .speed_rays_per_s = 0,
                                  .memory_bytes = 0,
                                  .tags = {},
                                  .program_version = "test"});
    }
    void beat(std::size_t i, const std::string& name) { say(i, name, beat_of(i, name)); }
    /// The oldest tile that it has, answered to all brokers that are there. False: it has none.
    bool render_one(const std::string& name) {
        Worker& worker = workers.at(name);
        if (worker.has.empty())
            return false;
        const protocol::RenderTile tile = worker.has.front();
        worker.has.erase(worker.has.begin());
        ++rendered;
        protocol::TileRendered answer = Farm::answer(tile);
        answer.pass = tile.pass;
        answer.rect = tile.rect;
        answer.elapsed = drawing_time;
        if (name == liar && tile.probe_side == 0) {
            Bytes pixels(byte_count(answer.blobs));
            pixels.back() = std::byte{1};
            answer.blobs = {Blob(std::move(pixels))};
        }
        for (std::size_t i = 0; i < nodes.size(); ++i)
            if (hears(i, name))
                say(i, name, answer);
        return true;
    }
    void render_all(const std::string& name) {
        while (render_one(name)) {
        }
    }

    // ---------------------------------------------------------------------------------- clients
    JobId submit(std::size_t i, const PeerId& client, const protocol::SubmitJob& submission) {
        if (clients_.insert(client).second)
            for (std::size_t n = 0; n < nodes.size(); ++n)
                if (nodes[n].dispatcher)
                    say(n, client, protocol::ClientHello{client, "test"});
        say(i, client, submission);
        const auto needs = heard<protocol::NeedChunk>(i, client);
        if (!needs.empty())
            say(i, client, Farm::scene_chunk());
        return submission.job;
    }
    [[nodiscard]] std::optional<protocol::JobState> state(std::size_t i, const JobId& job) {
        sent.erase({i, "inspector"});
        say(i, "inspector", protocol::ClientHello{"inspector", "test"});
        say(i, "inspector", protocol::FindJob{to_string(job)});
        const auto states = heard<protocol::JobState>(i, "inspector");
        return states.empty() ? std::nullopt : std::optional(states.back());
    }
    template <class M>
    [[nodiscard]] std::vector<M> heard(std::size_t i, const PeerId& peer) const {
        std::vector<M> result;
        const auto found = sent.find({i, peer});
        if (found != sent.end())
            for (const protocol::Message& m : found->second)
                if (const auto* message = std::get_if<M>(&m))
                    result.push_back(*message);
        return result;
    }
    [[nodiscard]] bool has_logged(std::size_t i, std::string_view kind) const {
        return std::ranges::any_of(nodes[i].logs,
                                   [&](const Log& line) { return line.kind == kind; });
    }
    [[nodiscard]] std::size_t published(std::size_t i, const JobId& job) const {
        return static_cast<std::size_t>(std::ranges::count_if(nodes[i].stream, [&](const auto& p) {
            return p.topic == protocol::job_topic(job) &&
                   std::holds_alternative<protocol::TileDone>(p.message);
        }));
    }

    struct Node {
        BrokerId id;
        std::unique_ptr<Dispatcher> dispatcher; ///< null: it is dead
        std::set<std::size_t> cut;
        std::set<std::string> dialled;
        std::vector<Publish> stream;
        std::vector<Log> logs;
        std::vector<Write> kept;
        std::size_t repairs = 0; ///< that it has asked other brokers for
    };
    Limits limits;
    std::map<std::size_t, std::string> advertised; ///< by brokers that are not told where they are
    Instant now{std::chrono::hours(1)};
    std::vector<Node> nodes;
    std::map<std::string, Worker> workers;
    std::map<std::pair<std::size_t, PeerId>, std::vector<protocol::Message>> sent;
    std::size_t rendered = 0;
    Duration drawing_time = std::chrono::milliseconds(5); ///< as workers say, of a tile
    std::string liar; ///< a worker: the last byte of all that it draws is wrong

private:
    static std::string endpoint(std::size_t i) { return "tcp://b" + std::to_string(i) + ":50057"; }
    static PeerId broker_peer(std::size_t i) { return "broker " + std::to_string(i); }
    [[nodiscard]] std::optional<std::size_t> index_of(const std::string& endpoint_wanted) const {
        for (std::size_t i = 0; i < nodes.size(); ++i)
            if (endpoint(i) == endpoint_wanted)
                return i;
        return std::nullopt;
    }
    [[nodiscard]] bool reaches(std::size_t from, std::size_t to) const {
        return nodes[to].dispatcher && !nodes[from].cut.contains(to);
    }
    void take(std::size_t from, Action action) {
        if (const auto* dial = std::get_if<Dial>(&action)) {
            CHECK(nodes[from].dialled.insert(dial->endpoint).second);
        } else if (const auto* gone = std::get_if<HangUp>(&action)) {
            CHECK(nodes[from].dialled.erase(gone->endpoint) == 1);
        } else if (auto* words = std::get_if<Tell>(&action)) {
            (void)protocol::encode(words->message);
            CHECK(nodes[from].dialled.contains(words->endpoint));
            nodes[from].repairs += std::holds_alternative<protocol::Repair>(words->message);
            const auto to = index_of(words->endpoint);
            if (to && reaches(from, *to))
                queue_.emplace_back(*to, PeerSaid{broker_peer(from), std::move(words->message)});
        } else if (auto* send = std::get_if<Send>(&action)) {
            (void)protocol::encode(send->message);
            take_sent(from, std::move(*send));
        } else if (auto* publish = std::get_if<Publish>(&action)) {
            nodes[from].stream.push_back(std::move(*publish));
        } else if (auto* persist = std::get_if<Persist>(&action)) {
            nodes[from].kept.push_back(std::move(persist->write));
            queue_.emplace_back(from, Stored{persist->sequence});
        } else if (auto* line = std::get_if<Log>(&action)) {
            nodes[from].logs.push_back(std::move(*line));
        }
    }
    void take_sent(std::size_t from, Send send) {
        for (std::size_t to = 0; to < nodes.size(); ++to)
            if (send.peer == broker_peer(to)) {
                if (reaches(from, to))
                    queue_.emplace_back(to, BrokerSaid{endpoint(from), std::move(send.message)});
                return;
            }
        if (const auto worker = workers.find(send.peer); worker != workers.end())
            work(from, send.peer, worker->second, send.message);
        sent[{from, send.peer}].push_back(std::move(send.message));
    }
    void work(std::size_t from, const std::string& name, Worker& worker,
              const protocol::Message& message) {
        if (const auto* tile = std::get_if<protocol::RenderTile>(&message)) {
            ++worker.received[from];
            if (tile->term < worker.term)
                return queue_beat(from, name);
            worker.term = tile->term;
            worker.has.push_back(*tile);
            CHECK(worker.has.size() <= 2 * worker.credit);
        } else if (const auto* beat = std::get_if<protocol::Beat>(&message)) {
            if (beat->leads)
                worker.led_at[from] = now;
            else
                worker.led_at.erase(from);
        } else if (const auto* brokers = std::get_if<protocol::Brokers>(&message)) {
            worker.term = std::max(worker.term, brokers->term);
            queue_beat(from, name);
        } else if (const auto* cancelled = std::get_if<protocol::CancelTile>(&message)) {
            std::erase_if(worker.has, [&](const protocol::RenderTile& t) {
                return t.job == cancelled->job && t.tile == cancelled->tile &&
                       t.attempt == cancelled->attempt;
            });
            for (std::size_t i = 0; i < nodes.size(); ++i)
                queue_.emplace_back(
                    i, PeerSaid{name, protocol::TileFailed{
                                          cancelled->job, cancelled->tile, cancelled->attempt,
                                          protocol::FailureCode::cancelled, "as told"}});
        }
    }
    void queue_beat(std::size_t to, const std::string& name) {
        queue_.emplace_back(to, PeerSaid{name, beat_of(to, name)});
    }
    [[nodiscard]] protocol::WorkerBeat beat_of(std::size_t i, const std::string& name) {
        Worker& worker = workers.at(name);
        protocol::WorkerBeat beat{.credit = worker.credit,
                                  .in_flight = {},
                                  .tiles_received = worker.received[i],
                                  .term = worker.term};
        for (const auto& [broker, at] : worker.led_at)
            if (nodes[broker].id == worker.term.leader)
                beat.leader_silence = now - at;
        for (const protocol::RenderTile& t : worker.has)
            beat.in_flight.push_back({t.job, t.tile, t.attempt, worker.hangs ? 0 : ++rays_, t.pass,
                                      t.probe_side > 0 ? PixelRect{} : t.rect});
        return beat;
    }

    std::deque<std::pair<std::size_t, Event>> queue_;
    std::set<PeerId> clients_;
    Instant next_beats_{};
    std::uint64_t incarnations_ = 0, rays_ = 0;
    std::uint8_t ids_ = 0;
    bool keeps_;
};

/// What a broker may say of a job.
inline protocol::JobRecord word_of(const protocol::SubmitJob& picture,
                                   const protocol::Revision& revision, protocol::JobPhase phase,
                                   std::vector<protocol::Distrusted> distrusted = {}) {
    return {.submission = picture,
            .revision = revision,
            .number = 1,
            .passes = 1,
            .phase = phase,
            .reason = {},
            .checks = {},
            .distrusted = std::move(distrusted)};
}

} // namespace fraja::broker
