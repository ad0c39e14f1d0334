#include "worker/shell.hpp"

#include "common/base/text.hpp"
#include "common/discovery/finder.hpp"
#include "common/discovery/source.hpp"
#include "common/net/clock.hpp"
#include "common/net/descriptors.hpp"
#include "common/net/endpoint.hpp"
#include "common/net/poller.hpp"
#include "worker/crew.hpp"
#include "worker/emulation.hpp"
#include "worker/render_pool.hpp"
#include "worker/wire.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <iterator>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace fraja::worker {
namespace {

constexpr Duration turn_interval = std::chrono::seconds(1); ///< of telling that the loop turns
/// Between two tries of brokers that were found and were of no use.
constexpr Duration findings_interval = std::chrono::seconds(30);

/// Of the brokers that it is told to serve.
std::vector<std::string> endpoints_of(const WorkerOptions& options) {
    std::vector<std::string> endpoints;
    std::ranges::copy_if(options.brokers, std::back_inserter(endpoints),
                         std::not_fn(discovery::is_source));
    return endpoints;
}
std::vector<std::string> sources_of(const WorkerOptions& options) {
    std::vector<std::string> sources;
    std::ranges::copy_if(options.brokers, std::back_inserter(sources), discovery::is_source);
    return sources;
}

/// Of one crew.
std::uint32_t sessions_max(const WorkerOptions& options) {
    return crew_sessions_max(endpoints_of(options).size(), !options.listen.empty(),
                             !sources_of(options).empty());
}

std::uint64_t crew_count(const WorkerOptions& options) {
    return options.emulated.empty() ? 1 : emulated_count(options);
}

/// Deeds that may wait for a thread: of each session its tiles, and the scenes on its shelf for
/// every kernel.
std::size_t queue_max(const WorkerOptions& options, const Limits& limits) {
    const std::size_t tiles = 2 * std::size_t{credit_for(options.threads, limits)};
    const std::size_t scenes = tiles + limits.shelf.idle_count_max;
    return crew_count(options) * sessions_max(options) *
           (tiles + scenes * protocol::ValueCount<protocol::KernelChoice>::value);
}

std::unique_ptr<Pool> make_pool(const WorkerOptions& options, const Limits& limits,
                                const net::Waker& done) {
    if (options.emulated.empty())
        return std::make_unique<RenderPool>(options.threads, queue_max(options, limits), done);
    std::vector<double> speeds;
    for (const EmulatedWorkers& workers : options.emulated)
        speeds.insert(speeds.end(), workers.count, workers.rays_per_s);
    return std::make_unique<EmulatedPool>(
        EmulatedPool::Options{.speeds = std::move(speeds),
                              .threads = options.threads,
                              .render_threads = usable_cpu_count(),
                              .queue_max = queue_max(options, limits),
                              .sessions_per_worker = sessions_max(options)},
        done);
}

/// A worker: the true one, or one of many that are emulated.
struct Worker {
    Worker(CrewOptions options, std::size_t number_)
        : number(number_), name(options.identity.name), crew(std::move(options)) {}

    const std::size_t number;
    const std::string name;
    Crew crew;
    std::vector<std::unique_ptr<Wire>> wires;   // of its sessions; null where one is over
    std::vector<std::unique_ptr<Wire>> leaving; // of those that are over, with something to send
};

class Shell {
public:
    Shell(const net::Context& context, const WorkerOptions& options, Control& control,
          const Limits& limits)
        : context_(context), options_(options), control_(control), limits_(limits),
          sessions_max_(sessions_max(options)), pool_(make_pool(options, limits, pool_waker_)) {
        poller_.add(pool_waker_.fd());
        poller_.add(control_.waker().fd());
    }

    Result<void> connect() {
        if (auto reserved = net::reserve_descriptors(session_count(options_)); !reserved)
            return reserved.error();
        if (!options_.listen.empty())
            return listen();
        const std::vector<std::string> endpoints = endpoints_of(options_);
        for (std::uint64_t i = 0; i < crew_count(options_); ++i) {
            Worker& worker = add_worker(endpoints);
            for (std::size_t slot = 0; slot < endpoints.size(); ++slot) {
                auto socket = connect_for(worker, endpoints[slot]);
                if (!socket)
                    return socket.error();
                add_wire(worker, slot, std::move(*socket), endpoints[slot]);
            }
        }
        begin_to_look();
        return {};
    }

    FinishReason run() {
        while (open_count_ > 0) {
            const Instant deadline = std::min({deadlines_.begin()->first, pool_->next_deadline(),
                                               tell_that_it_turns(), findings_due()});
            // More may be added to what there is to receive from while this goes on.
            const std::vector<std::size_t> readable = poller_.wait(deadline - net::now());
            for (const std::size_t index : readable)
                with_worker(index / sessions_max_,
                            [&](Worker& worker) { receive_some(worker, index % sessions_max_); });
            obey();
            hand_out_results();
            hand_out_findings();
            keep_time();
        }
        return reason_;
    }

private:
    [[nodiscard]] Instant findings_due() const {
        return finder_ && was_wanted_ ? findings_due_ : Instant::never();
    }

    /// Returns when to tell it again.
    Instant tell_that_it_turns() {
        if (!options_.on_turn)
            return Instant::never();
        if (const Instant now = net::now(); now >= next_turn_told_) {
            next_turn_told_ = now + turn_interval;
            options_.on_turn({!pool_->is_idle(), answers_});
        }
        return next_turn_told_;
    }

    // ------------------------------------------------------------------- brokers that are found

    void begin_to_look() {
        const std::vector<std::string> sources = sources_of(options_);
        if (sources.empty())
            return;
        finder_.emplace(sources, discovery::finder_options(context_.farm()));
        poller_.add(finder_->fd());
        if (!context_.farm() && std::ranges::count(sources, discovery::beacon_source) > 0)
            log(std::string(discovery::beacon_source),
                "without keys any broker that announces itself on this network is served: nothing "
                "proves whose it is");
    }

    void hand_out_findings() {
        if (!finder_)
            return;
        for (discovery::Findings& findings : finder_->take()) {
            if (!findings.trouble.empty())
                log(findings.source, findings.trouble);
            for_each_worker(BrokersFound{findings.source, findings.endpoints});
            findings_[findings.source] = std::move(findings.endpoints);
        }
        const bool wanted = std::ranges::any_of(
            workers_, [](const auto& worker) { return worker && worker->crew.is_alone(); });
        finder_->set_wanted(wanted);
        was_wanted_ = wanted;
        // Who was of no use may be of use by now, and is found as before.
        if (const Instant now = net::now(); wanted && now >= findings_due_) {
            findings_due_ = now + findings_interval;
            for (const auto& [source, endpoints] : findings_)
                for_each_worker(BrokersFound{source, endpoints});
        }
    }

    Result<void> listen() {
        if (!options_.allow.empty()) { // before anything is bound
            auto list = net::AllowList::read(options_.allow);
            const auto taken = list ? context_.admit(*std::move(list)) : Result<void>(list.error());
            if (!taken)
                return Error{taken.error().code, "--allow: " + taken.error().message};
        }
        const auto wanted = listening_endpoints(
            options_.listen, options_.insecure || !options_.allow.empty(), session_count(options_));
        if (!wanted)
            return wanted.error();
        std::vector<std::string> bound;
        for (const std::string& endpoint : *wanted) {
            auto socket = net::CalleeSocket::bind(context_, endpoint);
            if (!socket)
                return socket.error();
            bound.push_back(socket->endpoint());
            add_wire(add_worker({bound.back()}), 0, std::move(*socket), bound.back());
        }
        if (options_.on_listening)
            options_.on_listening(bound);
        return {};
    }

    // ------------------------------------------------------------------------- workers and wires

    Worker& add_worker(std::vector<std::string> endpoints) {
        const std::size_t number = workers_.size();
        Identity identity{random_id<WorkerId>(),    options_.name,
                          options_.threads,         options_.tags,
                          !options_.listen.empty(), options_.memory_bytes};
        if (!options_.emulated.empty()) {
            identity.name += "/" + std::to_string(number + 1);
            identity.tags.emplace_back("emulated");
        }
        const SessionIndex first{static_cast<std::uint32_t>(number * sessions_max_)};
        workers_.push_back(
            std::make_unique<Worker>(CrewOptions{std::move(identity), std::move(endpoints),
                                                 !sources_of(options_).empty(), first, limits_},
                                     number));
        noted_.push_back(workers_.back()->crew.next_deadline());
        deadlines_.emplace(noted_.back(), number);
        ++open_count_;
        return *workers_.back();
    }

    void add_wire(Worker& worker, std::size_t slot, Line line, const std::string& endpoint) {
        std::string title = endpoint;
        if (!options_.emulated.empty())
            title += ": " + worker.name;
        if (worker.wires.size() <= slot)
            worker.wires.resize(slot + 1);
        worker.wires[slot] =
            std::make_unique<Wire>(std::move(title), options_.on_log, std::move(line));
        poller_.add(poller_index(worker, slot), worker.wires[slot]->socket());
        ++wire_count_;
    }

    /// Emulated workers have the same brokers and one key: what one is told holds for all.
    Result<net::DealerSocket> connect_for(const Worker& worker, const std::string& endpoint) {
        using Telling = net::DealerSocket::Telling;
        return net::DealerSocket::connect(
            context_, endpoint, worker.number == 0 ? Telling::refusals : Telling::nothing);
    }

    /// To a broker that was told of.
    Result<void> open(Worker& worker, std::size_t slot, const std::string& told) {
        const auto endpoint = net::endpoint_to_connect(told, net::broker_port);
        if (!endpoint)
            return endpoint.error();
        if (auto reserved = net::reserve_descriptors(wire_count_ + 1); !reserved)
            return reserved.error();
        auto socket = connect_for(worker, *endpoint);
        if (!socket)
            return socket.error();
        add_wire(worker, slot, std::move(*socket), told);
        return {};
    }

    void close(Worker& worker, std::size_t slot) {
        if (slot >= worker.wires.size() || !worker.wires[slot])
            return; // it could not be opened
        poller_.remove(poller_index(worker, slot));
        worker.leaving.push_back(std::move(worker.wires[slot]));
        worker.leaving.back()->flush();
        worker.leaving.back()->begin_farewell(net::now());
    }

    [[nodiscard]] std::size_t poller_index(const Worker& worker, std::size_t slot) const {
        return worker.number * sessions_max_ + slot;
    }
    [[nodiscard]] SessionIndex session_of(const Worker& worker, std::size_t slot) const {
        return SessionIndex{static_cast<std::uint32_t>(poller_index(worker, slot))};
    }
    [[nodiscard]] std::size_t slot_of(SessionIndex session) const {
        return static_cast<std::size_t>(session) % sessions_max_;
    }

    /// All that is done with a worker goes through here: its deadline is noted, and when it is over
    /// it goes.
    template <class F>
    void with_worker(std::size_t number, F deed) {
        std::unique_ptr<Worker>& worker = workers_[number];
        if (!worker)
            return;
        deed(*worker);
        const Instant now = net::now();
        wire_count_ -= std::erase_if(worker->leaving, [now](const std::unique_ptr<Wire>& wire) {
            return wire->is_over(now);
        });
        if (const Instant deadline = deadline_of(*worker); deadline != noted_[number]) {
            deadlines_.erase({noted_[number], number});
            deadlines_.emplace(deadline, number);
            noted_[number] = deadline;
        }
        if (worker->crew.finished() && worker->leaving.empty())
            let_go(number);
    }

    [[nodiscard]] static Instant deadline_of(const Worker& worker) {
        Instant deadline =
            has_somebody_to_greet(worker) ? worker.crew.next_deadline() : Instant::never();
        for (const auto& wire : worker.wires)
            if (wire)
                deadline = std::min(deadline, wire->next_deadline());
        for (const auto& wire : worker.leaving)
            deadline = std::min({deadline, wire->next_deadline(), wire->farewell_deadline()});
        return deadline;
    }

    /// A worker that is called has nobody until then.
    [[nodiscard]] static bool has_somebody_to_greet(const Worker& worker) {
        return std::ranges::any_of(worker.wires,
                                   [](const auto& wire) { return wire && wire->has_caller(); });
    }

    void let_go(std::size_t number) {
        reason_ = *workers_[number]->crew.finished();
        deadlines_.erase({noted_[number], number});
        workers_[number].reset();
        --open_count_;
    }

    // ----------------------------------------------------------------------------------- events

    void step(Worker& worker, CrewEvent event) {
        std::deque<CrewEvent> events; // and what follows from it
        events.push_back(std::move(event));
        while (!events.empty()) {
            actions_.clear();
            touched_.clear();
            if (const auto* of_session = std::get_if<SessionEvent>(&events.front()))
                touched_.insert(slot_of(of_session->session));
            worker.crew.step(net::now(), events.front(), actions_);
            events.pop_front();
            for (CrewAction& action : actions_)
                perform(worker, std::move(action), events);
            for (const std::size_t slot : touched_)
                flush(worker, slot, events);
        }
    }

    void flush(Worker& worker, std::size_t slot, std::deque<CrewEvent>& events) {
        Wire* wire = slot < worker.wires.size() ? worker.wires[slot].get() : nullptr;
        if (!wire)
            return;
        wire->flush();
        poller_.look_again(poller_index(worker, slot));
        while (auto event = wire->heed_line())
            events.push_back(SessionEvent{session_of(worker, slot), std::move(*event)});
    }

    void perform(Worker& worker, CrewAction action, std::deque<CrewEvent>& events) {
        const std::size_t slot = slot_of(action.session);
        Wire* wire = slot < worker.wires.size() ? worker.wires[slot].get() : nullptr;
        if (auto* send = std::get_if<Send>(&action.deed)) {
            wire->post(*send);
            touched_.insert(slot);
        } else if (auto* line = std::get_if<Log>(&action.deed)) {
            if (wire)
                wire->log(std::move(*line));
        } else if (const auto* hang_up = std::get_if<HangUp>(&action.deed)) {
            wire->hang_up(*hang_up);
        } else if (const auto* told = std::get_if<Open>(&action.deed)) {
            if (const auto opened = open(worker, slot, told->endpoint); !opened) {
                log(told->endpoint, "cannot be served: " + opened.error().message);
                events.push_back(NotOpened{action.session});
            }
        } else if (std::holds_alternative<Close>(action.deed)) {
            close(worker, slot);
        } else {
            std::visit([&](auto& deed) { hand_to_pool(action.session, std::move(deed)); },
                       action.deed);
        }
    }

    template <class D>
    void hand_to_pool(SessionIndex session, D deed) {
        if constexpr (requires { pool_->perform(session, std::move(deed)); })
            pool_->perform(session, std::move(deed));
    }

    /// Of an endpoint that there is no wire to.
    void log(const std::string& endpoint, const std::string& text) {
        if (options_.on_log)
            options_.on_log({LogLevel::warning, "broker_unserved", endpoint,
                             printable(endpoint + ": " + text)});
    }

    /// As much as there is, but for a flood.
    void receive_some(Worker& worker, std::size_t slot) {
        for (int i = 0; i < wire_events_per_round; ++i) {
            if (slot >= worker.wires.size() || !worker.wires[slot])
                return;
            auto event = worker.wires[slot]->receive();
            poller_.look_again(poller_index(worker, slot));
            if (!event)
                return;
            step(worker, SessionEvent{session_of(worker, slot), std::move(*event)});
        }
    }

    void for_each_worker(const CrewEvent& event) {
        for (std::size_t number = 0; number < workers_.size(); ++number)
            with_worker(number, [&](Worker& worker) { step(worker, event); });
    }

    /// Passes on what `control_` asks, each once.
    void obey() {
        control_.waker().drain();
        if (control_.drain_asked() && !std::exchange(draining_, true))
            for_each_worker(Drain{});
        if (control_.stop_asked() && !std::exchange(stopping_, true))
            for_each_worker(StopNow{});
    }

    void hand_out_results() {
        pool_waker_.drain();
        for (PoolResult& result : pool_->take_results()) {
            answers_ += std::holds_alternative<TileFinished>(result.event) ||
                        std::holds_alternative<TileBroken>(result.event);
            with_worker(static_cast<std::size_t>(result.session) / sessions_max_,
                        [&](Worker& worker) {
                            step(worker, SessionEvent{result.session, std::move(result.event)});
                        });
        }
    }

    void keep_time() {
        const Instant now = net::now();
        std::vector<std::size_t> due;
        for (auto at = deadlines_.begin(); at != deadlines_.end() && at->first <= now; ++at)
            due.push_back(at->second);
        for (const std::size_t number : due)
            with_worker(number, [&](Worker& worker) {
                for (std::size_t slot = 0; slot < worker.wires.size(); ++slot)
                    receive_some(worker,
                                 slot); // what has arrived is heard before silence is judged
                send_again(worker, now);
                if (has_somebody_to_greet(worker) && now >= worker.crew.next_deadline())
                    step(worker, tick_of(worker));
            });
    }

    void send_again(Worker& worker, Instant now) {
        for (std::size_t slot = 0; slot < worker.wires.size(); ++slot) {
            Wire* wire = worker.wires[slot].get();
            if (!wire)
                continue;
            wire->flush_if_due(now);
            while (auto event = wire->heed_line())
                step(worker, SessionEvent{session_of(worker, slot), std::move(*event)});
        }
        for (const auto& wire : worker.leaving)
            wire->flush_if_due(now);
    }

    [[nodiscard]] CrewTick tick_of(const Worker& worker) const {
        CrewTick tick;
        for (const SessionIndex session : worker.crew.sessions())
            tick.progress.push_back({session, pool_->progress(session)});
        return tick;
    }

    const net::Context& context_;
    const WorkerOptions& options_;
    Control& control_;
    const Limits limits_;
    const std::size_t sessions_max_; // of one worker
    net::Waker pool_waker_;
    std::unique_ptr<Pool> pool_;
    net::Poller poller_;
    std::vector<std::unique_ptr<Worker>> workers_; // null when over
    std::size_t open_count_ = 0, wire_count_ = 0;
    std::vector<Instant> noted_; // of each worker its deadline, as it is among these:
    std::set<std::pair<Instant, std::size_t>> deadlines_;
    std::vector<CrewAction> actions_;         // of the step that goes on
    std::set<std::size_t> touched_;           // likewise: slots whose wire has something to send
    std::optional<discovery::Finder> finder_; // null: nobody is to be found
    std::map<std::string, std::vector<std::string>> findings_; // by source, the last
    bool was_wanted_ = false;
    Instant findings_due_{};
    Instant next_turn_told_{};
    std::uint64_t answers_ = 0;
    bool draining_ = false, stopping_ = false;
    FinishReason reason_{};
};

} // namespace

Result<FinishReason> run_worker(const net::Context& context, const WorkerOptions& options,
                                Control& control, const Limits& limits) {
    if (auto valid = validate(options); !valid)
        return valid.error();
    Shell shell(context, options, control, limits);
    if (auto connected = shell.connect(); !connected)
        return connected.error();
    return shell.run();
}

} // namespace fraja::worker
