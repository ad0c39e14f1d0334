#include "tests/sim/world.hpp"

#include "broker/dispatcher.hpp"
#include "client/submission.hpp"
#include "common/base/rng.hpp"
#include "common/protocol/content_hash.hpp"
#include "worker/session.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <memory>
#include <queue>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <variant>

namespace fraja::sim {
namespace {

using namespace std::chrono_literals;

/// A connection that is silent for so long is given up by ZeroMQ (net/sockets.cpp).
constexpr Duration connection_patience = 30s;

template <class Id>
Id id_from(Rng& rng) {
    Id id;
    for (std::uint8_t& byte : id.bytes)
        byte = static_cast<std::uint8_t>(rng.next());
    return id;
}

/// A tile's pixels: of each pixel a hash of its place, its job and its pass.
Bytes pixels_of(const ContentHash& scene, const protocol::PictureSettings& settings,
                std::uint32_t pass, PixelRect rect) {
    Bytes bytes;
    const std::uint64_t pixel_bytes = settings.pixel_bytes();
    bytes.reserve(rect.pixel_count() * pixel_bytes);
    for (std::uint32_t y = rect.y; y < rect.y + rect.height; ++y)
        for (std::uint32_t x = rect.x; x < rect.x + rect.width; ++x) {
            Rng rng((std::uint64_t{y} << 32 | x) ^ std::uint64_t{scene.bytes[0]} << 56 ^
                    std::uint64_t{pass} << 24 ^ std::uint64_t{settings.depth} << 60);
            for (std::uint64_t i = 0; i < pixel_bytes; i += 4) {
                const std::uint64_t bits = rng.next();
                for (unsigned b = 0; b < 4; ++b)
                    bytes.push_back(static_cast<std::byte>(bits >> (8 * b)));
            }
        }
    return bytes;
}

Bytes joined(const std::vector<Blob>& blobs) {
    Bytes bytes;
    for (const Blob& blob : blobs)
        bytes.insert(bytes.end(), blob->begin(), blob->end());
    return bytes;
}

class World {
public:
    explicit World(const Scenario& scenario)
        : scenario_(scenario), rng_(scenario.seed), clients_(scenario.jobs.size()),
          workers_(scenario.workers.size()) {
        report_.jobs.resize(scenario.jobs.size());
    }

    Report run() {
        start_broker();
        for (std::size_t i = 0; i < workers_.size(); ++i)
            start_worker(i);
        for (std::size_t i = 0; i < clients_.size(); ++i)
            after(scenario_.jobs[i].at, [this, i] { start_client(i); });
        plan_accidents();
        while (!agenda_.empty() && !all_over()) {
            if (agenda_.top().at > Instant{} + scenario_.ends_at)
                break;
            now_ = agenda_.top().at;
            const auto deed = std::move(agenda_.top().deed);
            agenda_.pop();
            deed();
        }
        report_.ended_at = now_.since_start;
        for (std::size_t i = 0; i < clients_.size(); ++i)
            if (!report_.jobs[i].done)
                violation("job " + std::to_string(i) + " has not ended" +
                          (report_.jobs[i].outcome.empty() ? "" : ": " + report_.jobs[i].outcome));
        return std::move(report_);
    }

private:
    // ------------------------------------------------------------------------------------ time
    struct Entry {
        Instant at;
        std::uint64_t order;
        mutable std::function<void()> deed;
        friend bool operator<(const Entry& a, const Entry& b) {
            return std::tie(a.at, a.order) > std::tie(b.at, b.order); // the soonest on top
        }
    };
    void at(Instant when, std::function<void()> deed) {
        agenda_.push({std::max(when, now_), ++order_, std::move(deed)});
    }
    void after(Duration pause, std::function<void()> deed) { at(now_ + pause, std::move(deed)); }
    Duration between(Duration low, Duration high) {
        return low + Duration(static_cast<Duration::rep>(
                         rng_.unit() * static_cast<double>((high - low).count())));
    }
    [[nodiscard]] bool healed() const { return now_ >= Instant{} + scenario_.faults.heals_at; }
    /// Calls `deed` again and again, with that mean time between, until all is healed.
    void every(Duration mean, const std::function<void()>& deed) {
        if (mean <= Duration::zero())
            return;
        const Duration pause(static_cast<Duration::rep>(-std::log(1 - rng_.unit()) *
                                                        static_cast<double>(mean.count())));
        if (now_ + pause >= Instant{} + scenario_.faults.heals_at)
            return;
        after(pause, [this, mean, deed] {
            deed();
            every(mean, deed);
        });
    }
    void violation(std::string what) {
        report_.violations.push_back(std::to_string(seconds(now_.since_start)) +
                                     " s: " + std::move(what));
    }
    void note(std::uint64_t what) {
        ++report_.events;
        report_.history =
            Rng(report_.history ^ what ^ static_cast<std::uint64_t>(now_.since_start.count()))
                .next();
    }

    // --------------------------------------------------------------------------------- network
    /// From a node to the broker and back: in order each way, lost when it breaks.
    struct Line {
        std::uint64_t generation = 0; ///< of the connection; another one, another peer
        bool up = false;
        broker::PeerId peer;            ///< while it is up
        Instant to_broker{}, to_node{}; ///< when the last message arrives
        Instant silent_until{};
    };
    Duration delay() { return between(scenario_.faults.delay_min, scenario_.faults.delay_max); }
    Instant arrival(Line& line, Instant& last) {
        last = std::max({last, now_ + delay(), line.silent_until});
        return last;
    }

    struct Process {
        std::uint64_t life = 0; ///< counts its starts; 0: not running
        bool running = false;
        Instant frozen_until{};
        std::deque<std::function<void()>> backlog; ///< of what came since
        std::uint64_t wake = 0;                    ///< the last planned one counts
        Line line;
        std::function<void(const protocol::Message&)> hear; ///< from the broker
        std::function<void()> reconnected; ///< its socket has found the broker again by itself
    };
    /// Whatever comes to a process that stands still waits, in order.
    void in_process(Process& process, std::function<void()> deed) {
        if (!process.running)
            return;
        if (process.backlog.empty() && now_ >= process.frozen_until)
            return deed();
        process.backlog.push_back(std::move(deed));
        if (process.backlog.size() == 1)
            thaw_when_due(process);
    }
    void thaw_when_due(Process& process) {
        at(process.frozen_until, [this, &process, life = process.life] {
            while (process.life == life && !process.backlog.empty()) {
                if (now_ < process.frozen_until)
                    return thaw_when_due(process);
                const std::function<void()> deed = std::move(process.backlog.front());
                deed();
                if (process.life == life) // and last: what comes meanwhile goes behind
                    process.backlog.pop_front();
            }
        });
    }
    static void end_life(Process& process) {
        process.running = false;
        ++process.life;
        process.backlog.clear();
    }

    void connect(Process& process, std::function<void()> connected = {}) {
        const std::uint64_t life = process.life, generation = ++process.line.generation;
        process.line.up = false;
        after(delay(), [this, &process, life, generation, connected] {
            if (!process.running || process.life != life || process.line.generation != generation)
                return;
            if (!broker_.running || now_ < process.line.silent_until)
                return after(100ms, [this, &process, life, generation, connected] {
                    if (process.life == life && process.line.generation == generation)
                        connect(process, connected);
                });
            process.line.up = true;
            process.line.to_broker = process.line.to_node = now_;
            process.line.peer = "peer " + std::to_string(++peers_);
            lines_[process.line.peer] = {&process, generation};
            if (connected)
                connected();
        });
    }
    void disconnect(Process& process) {
        if (!process.line.up)
            return;
        lines_.erase(process.line.peer);
        process.line.up = false;
        ++process.line.generation;
    }
    void break_line(Process& process) {
        if (!process.running)
            return;
        disconnect(process);
        connect(process, process.reconnected);
    }
    /// Whether it left.
    bool to_broker(Process& process, protocol::Message message) {
        if (!process.line.up)
            return false;
        const std::uint64_t generation = process.line.generation;
        at(arrival(process.line, process.line.to_broker),
           [this, &process, generation, peer = process.line.peer,
            message = std::move(message)]() mutable {
               if (process.line.generation == generation)
                   in_process(broker_, [this, peer, message] {
                       step_broker(broker::PeerSaid{peer, message});
                   });
           });
        return true;
    }

    // ---------------------------------------------------------------------------------- broker
    void start_broker() {
        broker_.running = true;
        ++broker_.life;
        dispatcher_ = std::make_unique<broker::Dispatcher>(
            broker::Dispatcher::Identity{id_from<BrokerId>(rng_), ++epoch_, "tcp://sim:50058"},
            scenario_.limits);
        topics_.clear();
        step_broker(broker::Tick{});
        for (Client& client : clients_) // its socket finds the stream again by itself
            for (const std::string& topic : client.topics)
                subscribe(client, topic);
    }
    void crash_broker() {
        if (!broker_.running)
            return;
        end_life(broker_);
        dispatcher_.reset();
        for (Client& client : clients_) {
            ++client.stream_generation;
            break_line(client.process);
        }
        for (Worker& worker : workers_)
            break_line(worker.process);
        after(between(10ms, scenario_.faults.restart_max), [this] { start_broker(); });
    }
    void step_broker(broker::Event event) {
        std::deque<broker::Event> events;
        events.push_back(std::move(event));
        while (!events.empty()) {
            note(1'000 + events.front().index());
            std::vector<broker::Action> actions;
            dispatcher_->step(now_, events.front(), actions);
            events.pop_front();
            for (broker::Action& action : actions) {
                if (auto* send = std::get_if<broker::Send>(&action))
                    perform(std::move(*send), events);
                else if (auto* publish = std::get_if<broker::Publish>(&action))
                    perform(*publish);
            }
        }
        wake(broker_, dispatcher_->next_deadline(), [this] { step_broker(broker::Tick{}); });
    }
    void perform(broker::Send send, std::deque<broker::Event>& events) {
        const auto line = lines_.find(send.peer);
        if (line == lines_.end())
            return events.push_back(broker::PeerUnreachable{send.peer});
        Process& process = *line->second.first;
        const std::uint64_t generation = line->second.second;
        at(arrival(process.line, process.line.to_node),
           [this, &process, generation, message = std::move(send.message)]() mutable {
               if (process.line.generation == generation && process.line.up)
                   in_process(process, [&process, message] { process.hear(message); });
           });
    }
    void perform(const broker::Publish& publish) {
        const auto subscribers = topics_.find(publish.topic);
        if (subscribers == topics_.end())
            return;
        const auto message = std::make_shared<const protocol::Message>(publish.message);
        for (Client* client : subscribers->second) {
            if (!healed() && rng_.unit() < scenario_.faults.stream_drop)
                continue;
            const std::uint64_t generation = client->stream_generation;
            client->stream_last =
                std::max({client->stream_last, now_ + delay(), client->process.line.silent_until});
            at(client->stream_last, [this, client, generation, message] {
                if (client->stream_generation == generation)
                    in_process(client->process, [this, client, message] {
                        step(*client, client::FromStream{*message});
                    });
            });
        }
    }
    template <class F>
    void wake(Process& process, Instant deadline, F deed) {
        const std::uint64_t mine = ++process.wake, life = process.life;
        if (deadline == Instant::never())
            return;
        at(std::max(deadline, now_ + 1us), [this, &process, mine, life, deed] {
            if (process.wake == mine && process.life == life)
                in_process(process, deed);
        });
    }

    // --------------------------------------------------------------------------------- workers
    struct Worker {
        Process process;
        std::size_t index = 0;
        std::unique_ptr<worker::Session> session;
        std::deque<protocol::Message> outbox;
        std::deque<worker::StartTile> waiting;
        std::set<worker::Ticket> running; ///< what the render threads are at
        std::set<ContentHash> scenes;     ///< compiled
    };
    void start_worker(std::size_t i) {
        Worker& worker = workers_[i];
        worker.index = i;
        worker.process.running = true;
        ++worker.process.life;
        worker.process.frozen_until = now_;
        worker.outbox.clear();
        worker.waiting.clear();
        worker.running.clear();
        worker.scenes.clear();
        const worker::Limits limits;
        worker.session =
            std::make_unique<worker::Session>(worker::Identity{id_from<WorkerId>(rng_),
                                                               "worker " + std::to_string(i),
                                                               scenario_.workers[i].threads,
                                                               {}},
                                              limits);
        worker.process.hear = [this, &worker](const protocol::Message& message) {
            step(worker, worker::Received{message});
        };
        worker.process.reconnected = [this, &worker] {
            in_process(worker.process, [this, &worker] { flush(worker); });
        };
        connect(worker.process, worker.process.reconnected);
        step(worker, worker::Tick{});
    }
    void crash(Worker& worker) {
        if (!worker.process.running)
            return;
        disconnect(worker.process);
        end_life(worker.process);
        worker.session.reset();
        after(between(10ms, scenario_.faults.restart_max),
              [this, i = worker.index] { start_worker(i); });
    }
    void step(Worker& worker, const worker::Event& event) {
        note(2'000 + 100 * worker.index + event.index());
        std::vector<worker::Action> actions;
        worker.session->step(now_, event, actions);
        for (worker::Action& action : actions)
            std::visit([&](auto& a) { perform(worker, std::move(a)); }, action);
        flush(worker);
        wake(worker.process, worker.session->next_deadline(), [this, &worker] {
            worker::Tick tick;
            for (const worker::Ticket ticket : worker.running)
                tick.progress.push_back({ticket, ++progress_});
            step(worker, tick);
        });
    }
    void flush(Worker& worker) {
        while (!worker.outbox.empty() && to_broker(worker.process, worker.outbox.front()))
            worker.outbox.pop_front();
    }
    void perform(Worker& worker, worker::Send send) {
        if (std::holds_alternative<protocol::WorkerHello>(send.message))
            worker.outbox.clear();
        if (const auto* failed = std::get_if<protocol::TileFailed>(&send.message);
            failed && failed->code != protocol::FailureCode::cancelled)
            violation("worker " + std::to_string(worker.index) +
                      " fails a tile: " + failed->reason);
        worker.outbox.push_back(std::move(send.message));
    }
    void perform(Worker& worker, worker::CompileScene compile) {
        const std::uint64_t life = worker.process.life;
        const bool whole = protocol::content_hash(joined(compile.chunks)) == compile.scene;
        after(between(1ms, 50ms), [this, &worker, life, whole, scene = compile.scene] {
            if (worker.process.life != life)
                return;
            in_process(worker.process, [this, &worker, whole, scene] {
                if (!whole)
                    return step(worker, worker::SceneFailed{
                                            scene, {ErrorCode::invalid_scene, "another hash"}});
                worker.scenes.insert(scene);
                step(worker, worker::SceneCompiled{scene});
            });
        });
    }
    void perform(Worker& worker, worker::StartTile start) {
        if (!worker.scenes.contains(start.scene))
            violation("a worker starts a tile of a scene that it has not");
        worker.waiting.push_back(std::move(start));
        start_waiting(worker);
    }
    void start_waiting(Worker& worker) {
        const WorkerPlan& plan = scenario_.workers[worker.index];
        while (!worker.waiting.empty() && worker.running.size() < plan.threads) {
            const worker::StartTile tile = std::move(worker.waiting.front());
            worker.waiting.pop_front();
            const Duration cost = cost_of(tile.scene, tile.rect);
            const Duration time(
                static_cast<Duration::rep>(static_cast<double>(cost.count()) / plan.speed));
            worker.running.insert(tile.ticket);
            const std::uint64_t life = worker.process.life;
            after(time, [this, &worker, life, tile, time] {
                if (worker.process.life != life)
                    return;
                in_process(worker.process, [this, &worker, tile, time] {
                    if (worker.running.erase(tile.ticket) == 0)
                        return; // stopped
                    report_.busy += time;
                    start_waiting(worker);
                    step(worker,
                         worker::TileFinished{tile.ticket,
                                              {.camera = tile.rect.pixel_count()},
                                              time,
                                              {make_blob(pixels_of(tile.scene, tile.settings,
                                                                   tile.pass, tile.rect))}});
                });
            });
        }
    }
    void perform(Worker& worker, const worker::StopTile& stop) {
        std::erase_if(worker.waiting,
                      [&](const worker::StartTile& t) { return t.ticket == stop.ticket; });
        if (worker.running.erase(stop.ticket) > 0)
            start_waiting(worker);
    }
    void perform(Worker& worker, const worker::ForgetScene& forget) {
        worker.scenes.erase(forget.scene);
    }
    void perform(Worker&, const worker::Log&) {}
    void perform(Worker& worker, const worker::Finished&) {
        violation("worker " + std::to_string(worker.index) + " gave up");
    }
    Duration cost_of(const ContentHash& scene, PixelRect rect) {
        return scenario_.jobs[job_of_scene_.at(scene)].cost(rect);
    }

    // --------------------------------------------------------------------------------- clients
    struct Client {
        Process process;
        std::size_t index = 0;
        std::unique_ptr<client::Submission> submission;
        std::set<std::string> topics;
        std::uint64_t stream_generation = 0;
        Instant stream_last{};
        protocol::SubmitJob job;
        std::map<TileIndex, PixelRect> tiles;
        bool over = false;
    };
    void start_client(std::size_t i) {
        Client& client = clients_[i];
        const JobPlan& plan = scenario_.jobs[i];
        client.index = i;
        client.process.running = true;
        ++client.process.life;
        client.process.hear = [this, &client](const protocol::Message& message) {
            step(client, client::FromBroker{message});
        };
        Bytes scene(plan.scene_bytes);
        for (std::size_t b = 0; b < scene.size(); ++b)
            scene[b] = static_cast<std::byte>(b * 7 + i + b / 251);
        client.job = {.job = id_from<JobId>(rng_),
                      .job_name = "job " + std::to_string(i),
                      .scene = protocol::content_hash(scene),
                      .scene_bytes = scene.size(),
                      .settings = plan.settings,
                      .tile_side = plan.tile_side,
                      .priority = plan.priority,
                      .wishes = plan.wishes,
                      .resume = false};
        job_of_scene_[client.job.scene] = i;
        report_.jobs[i].submitted_at = now_.since_start;
        client::SubmissionRequest request{.job = client.job,
                                          .scene_text = make_blob(std::move(scene)),
                                          .session = {{"sim"}, 1h, "sim"},
                                          .timeout = {}};
        client.submission =
            std::make_unique<client::Submission>(std::move(request), Rng(rng_.next()));
        std::vector<client::Action> actions;
        client.submission->start(now_, actions);
        perform(client, actions);
    }
    void step(Client& client, const client::Event& event) {
        if (client.over)
            return;
        note(3'000 + 100 * client.index + event.index());
        std::vector<client::Action> actions;
        client.submission->step(now_, event, actions);
        perform(client, actions);
    }
    void perform(Client& client, std::vector<client::Action>& actions) {
        for (std::size_t k = 0; k < actions.size() && !client.over; ++k) {
            const client::Action action = std::move(actions[k]);
            if (std::visit([&](const auto& a) { return perform(client, a); }, action))
                continue;
            client.submission->step(now_, client::NotSent{}, actions);
        }
        if (!client.over)
            wake(client.process, client.submission->next_deadline(),
                 [this, &client] { step(client, client::Tick{}); });
    }
    bool perform(Client& client, const client::Connect&) {
        disconnect(client.process);
        connect(client.process, [this, &client] {
            in_process(client.process, [this, &client] { step(client, client::Tick{}); });
        });
        return true;
    }
    bool perform(Client& client, const client::OpenStream&) {
        ++client.stream_generation;
        for (const std::string& topic : std::exchange(client.topics, {}))
            unsubscribe(client, topic);
        return true;
    }
    bool perform(Client& client, const client::Subscribe& subscribe) {
        client.topics.insert(subscribe.topic);
        this->subscribe(client, subscribe.topic);
        return true;
    }
    bool perform(Client& client, const client::Unsubscribe& unsubscribe) {
        client.topics.erase(unsubscribe.topic);
        this->unsubscribe(client, unsubscribe.topic);
        return true;
    }
    bool perform(Client& client, const client::Send& send) {
        return to_broker(client.process, send.message);
    }
    bool perform(Client& client, const client::News& news) {
        JobReport& report = report_.jobs[client.index];
        if (std::holds_alternative<client::Accepted>(news)) {
            report.acknowledged = true;
            client.tiles.clear(); // those of a job that was submitted again come again
        } else if (const auto* tile = std::get_if<client::TileArrived>(&news)) {
            take(client, tile->tile);
        } else if (const auto* finished = std::get_if<client::Finished>(&news)) {
            client.over = true;
            if (finished->outcome == client::Outcome{})
                finish(client);
            else
                report.outcome = finished->outcome.reason;
            disconnect(client.process);
            end_life(client.process);
        }
        return true;
    }
    void take(Client& client, const protocol::TileDone& tile) {
        if (!client.tiles.emplace(tile.tile, tile.rect).second)
            violation("job " + std::to_string(client.index) + " is given a tile twice");
        if (joined(tile.blobs) !=
            pixels_of(client.job.scene, client.job.settings, tile.pass, tile.rect))
            violation("job " + std::to_string(client.index) + " is given wrong pixels");
        report_.useful += cost_of(client.job.scene, tile.rect);
    }
    /// Each pixel of each pass once.
    void finish(Client& client) {
        JobReport& report = report_.jobs[client.index];
        report.done = true;
        report.done_at = now_.since_start;
        std::uint64_t pixels = 0;
        for (const auto& [tile, rect] : client.tiles)
            pixels += rect.pixel_count();
        if (pixels != client.job.settings.crop.pixel_count())
            violation("job " + std::to_string(client.index) + " is done without all its pixels");
    }
    void subscribe(Client& client, const std::string& topic) {
        const std::uint64_t generation = client.stream_generation, life = broker_.life;
        client.stream_last = std::max(client.stream_last, now_ + delay());
        at(client.stream_last, [this, &client, topic, generation, life] {
            if (client.stream_generation != generation || broker_.life != life ||
                !broker_.running || !client.topics.contains(topic))
                return;
            in_process(broker_, [this, &client, topic] {
                topics_[topic].insert(&client);
                step_broker(broker::TopicSubscribed{topic});
            });
        });
    }
    void unsubscribe(Client& client, const std::string& topic) {
        const auto found = topics_.find(topic);
        if (found == topics_.end() || found->second.erase(&client) == 0 || !found->second.empty())
            return;
        topics_.erase(found);
        if (broker_.running)
            after(delay(), [this, topic, life = broker_.life] {
                if (broker_.life == life && !topics_.contains(topic))
                    in_process(broker_,
                               [this, topic] { step_broker(broker::TopicUnsubscribed{topic}); });
            });
    }

    // -------------------------------------------------------------------------------- accidents
    Process& random_process() {
        const std::size_t i = rng_.below(workers_.size() + clients_.size());
        return i < workers_.size() ? workers_[i].process : clients_[i - workers_.size()].process;
    }
    void plan_accidents() {
        const Faults& f = scenario_.faults;
        every(f.breaks_every, [this] { break_line(random_process()); });
        every(f.partitions_every, [this] {
            Process& process = random_process();
            const Duration silence = between(0s, scenario_.faults.partition_max);
            process.line.silent_until = now_ + silence;
            if (silence > connection_patience)
                break_line(process);
        });
        every(f.worker_crashes_every, [this] { crash(workers_[rng_.below(workers_.size())]); });
        every(f.broker_crashes_every, [this] { crash_broker(); });
        every(f.hangs_every, [this] {
            Process& process = rng_.below(4) == 0 ? broker_ : random_process();
            process.frozen_until = now_ + between(0s, scenario_.faults.hang_max);
        });
    }

    [[nodiscard]] bool all_over() const { return std::ranges::all_of(clients_, &Client::over); }

    const Scenario& scenario_;
    Rng rng_;
    Report report_;
    Instant now_{};
    std::priority_queue<Entry> agenda_;
    std::uint64_t order_ = 0, peers_ = 0, epoch_ = 0, progress_ = 0;
    Process broker_;
    std::unique_ptr<broker::Dispatcher> dispatcher_;
    std::map<broker::PeerId, std::pair<Process*, std::uint64_t>> lines_;
    std::map<std::string, std::set<Client*>> topics_;
    std::vector<Client> clients_;
    std::vector<Worker> workers_;
    std::map<ContentHash, std::size_t> job_of_scene_;
};

} // namespace

Report run(const Scenario& scenario) {
    return World(scenario).run();
}

Scenario random_scenario(std::uint64_t seed) {
    Rng rng(seed);
    Scenario s;
    s.seed = rng.next();
    const auto sometimes = [&](Duration low, Duration high) {
        return rng.below(3) == 0
                   ? Duration::zero()
                   : Duration(static_cast<Duration::rep>(rng.between(
                         static_cast<double>(low.count()), static_cast<double>(high.count()))));
    };
    s.faults = {.heals_at = 5min,
                .delay_max = sometimes(1ms, 2s) + 100us,
                .breaks_every = sometimes(2s, 2min),
                .partitions_every = sometimes(5s, 2min),
                .partition_max = sometimes(1s, 60s),
                .worker_crashes_every = sometimes(5s, 2min),
                .broker_crashes_every = sometimes(20s, 3min),
                .restart_max = sometimes(1s, 20s) + 20ms,
                .hangs_every = sometimes(5s, 2min),
                .hang_max = sometimes(1s, 30s),
                .stream_drop = rng.below(2) == 0 ? 0 : rng.unit()};
    s.limits.attempts_max = 1'000; // a tile's workers may crash as often as they like
    const std::size_t workers = 1 + rng.below(6);
    for (std::size_t i = 0; i < workers; ++i)
        s.workers.push_back({1 + static_cast<std::uint32_t>(rng.below(4)),
                             rng.below(4) == 0 ? 0.05 : rng.between(0.5, 4)});
    const std::size_t jobs = 1 + rng.below(4);
    for (std::size_t i = 0; i < jobs; ++i) {
        JobPlan job;
        job.at = Duration(static_cast<Duration::rep>(rng.unit() * 60e9));
        job.settings.size = {8 + static_cast<std::uint32_t>(rng.below(90)),
                             8 + static_cast<std::uint32_t>(rng.below(60))};
        job.settings.crop = {0, 0, job.settings.size.width, job.settings.size.height};
        job.settings.depth = 1 + static_cast<std::uint32_t>(i);
        job.tile_side = 4 + static_cast<std::uint32_t>(rng.below(20));
        job.priority = static_cast<std::int32_t>(rng.below(3));
        job.scene_bytes = rng.below(4) == 0 ? 1'200'000 : 100 + rng.below(1000);
        const double pixel_ns = rng.between(1e3, 2e6); // up to 2 ms a pixel: seconds a tile
        job.cost = [pixel_ns](PixelRect rect) {
            const double uneven = 1 + 4 * std::abs(std::sin(rect.x * 0.37 + rect.y * 0.11));
            return Duration(static_cast<Duration::rep>(pixel_ns * uneven *
                                                       static_cast<double>(rect.pixel_count())));
        };
        s.jobs.push_back(std::move(job));
    }
    s.ends_at = 5min + 30min;
    return s;
}

} // namespace fraja::sim
