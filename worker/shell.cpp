#include "worker/shell.hpp"

#include "common/base/text.hpp"
#include "common/discovery/finder.hpp"
#include "common/discovery/source.hpp"
#include "common/net/clock.hpp"
#include "common/net/descriptors.hpp"
#include "common/net/endpoint.hpp"
#include "common/net/poller.hpp"
#include "worker/crew.hpp"
#include "worker/crew_wires.hpp"
#include "worker/emulation.hpp"
#include "worker/render_pool.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
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
                auto socket = connect_for(worker.number, endpoints[slot]);
                if (!socket)
                    return socket.error();
                worker.wires.add_line(slot, std::move(*socket), endpoints[slot]);
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
                with_worker(index / sessions_max_, [&](Worker& worker) {
                    worker.wires.receive_some(index % sessions_max_);
                });
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
            for (const auto& worker : workers_)
                if (worker)
                    reception_ = std::max(reception_, worker->wires.crew().reception());
            options_.on_turn({!pool_->is_idle(), answers_, reception_});
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
            workers_, [](const auto& worker) { return worker && worker->wires.crew().is_alone(); });
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
            add_worker({bound.back()}).wires.add_line(0, std::move(*socket), bound.back());
        }
        if (options_.on_listening)
            options_.on_listening(bound);
        return {};
    }

    // ----------------------------------------------------------------------------------- workers

    /// A worker: the true one, or one of many that are emulated.
    struct Worker final : CrewWires::Host {
        Worker(Shell& shell_, std::size_t number_, CrewOptions options)
            : shell(shell_), number(number_),
              wires(std::move(options),
                    shell.options_.emulated.empty() ? std::string() : shell.name_of(number),
                    shell.options_.on_log, *shell.pool_, *this) {}

        Result<net::DealerSocket> connect(const std::string& told) override {
            const auto endpoint = net::endpoint_to_connect(told, net::broker_port);
            if (!endpoint)
                return endpoint.error();
            if (auto reserved = net::reserve_descriptors(shell.wire_count_ + 1); !reserved)
                return reserved.error();
            return shell.connect_for(number, *endpoint);
        }
        void opened(std::size_t slot, const net::Socket& socket) override {
            shell.poller_.add(shell.poller_index(number, slot), socket);
            ++shell.wire_count_;
        }
        void closed(std::size_t slot) override {
            shell.poller_.remove(shell.poller_index(number, slot));
        }
        void gone(std::size_t count) override { shell.wire_count_ -= count; }
        void used(std::size_t slot) override {
            shell.poller_.look_again(shell.poller_index(number, slot));
        }

        Shell& shell;
        const std::size_t number;
        CrewWires wires;
    };

    [[nodiscard]] std::string name_of(std::size_t number) const {
        return options_.emulated.empty() ? options_.name
                                         : options_.name + "/" + std::to_string(number + 1);
    }

    Worker& add_worker(std::vector<std::string> endpoints) {
        const std::size_t number = workers_.size();
        Identity identity{random_id<WorkerId>(), name_of(number),          options_.threads,
                          options_.tags,         !options_.listen.empty(), options_.memory_bytes};
        if (!options_.emulated.empty())
            identity.tags.emplace_back("emulated");
        const SessionIndex first{static_cast<std::uint32_t>(number * sessions_max_)};
        workers_.push_back(
            std::make_unique<Worker>(*this, number,
                                     CrewOptions{std::move(identity), std::move(endpoints),
                                                 !sources_of(options_).empty(), first, limits_}));
        noted_.push_back(workers_.back()->wires.crew().next_deadline());
        deadlines_.emplace(noted_.back(), number);
        ++open_count_;
        return *workers_.back();
    }

    /// Emulated workers have the same brokers and one key: what one is told holds for all.
    Result<net::DealerSocket> connect_for(std::size_t number, const std::string& endpoint) {
        using Telling = net::DealerSocket::Telling;
        return net::DealerSocket::connect(context_, endpoint,
                                          number == 0 ? Telling::refusals : Telling::nothing);
    }

    [[nodiscard]] std::size_t poller_index(std::size_t number, std::size_t slot) const {
        return number * sessions_max_ + slot;
    }

    /// All that is done with a worker goes through here: its deadline is noted, and when it is over
    /// it goes.
    template <class F>
    void with_worker(std::size_t number, F deed) {
        std::unique_ptr<Worker>& worker = workers_[number];
        if (!worker)
            return;
        deed(*worker);
        if (const Instant deadline = worker->wires.next_deadline(); deadline != noted_[number]) {
            deadlines_.erase({noted_[number], number});
            deadlines_.emplace(deadline, number);
            noted_[number] = deadline;
        }
        if (worker->wires.is_over())
            let_go(number);
    }

    void let_go(std::size_t number) {
        reason_ = *workers_[number]->wires.crew().finished();
        deadlines_.erase({noted_[number], number});
        workers_[number].reset();
        --open_count_;
    }

    // ----------------------------------------------------------------------------------- events

    /// Of an endpoint that there is no wire to.
    void log(const std::string& endpoint, const std::string& text) {
        if (options_.on_log)
            options_.on_log({LogLevel::warning, "broker_unserved", endpoint,
                             printable(endpoint + ": " + text)});
    }

    void for_each_worker(const CrewEvent& event) {
        for (std::size_t number = 0; number < workers_.size(); ++number)
            with_worker(number, [&](Worker& worker) { worker.wires.step(event); });
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
            with_worker(
                static_cast<std::size_t>(result.session) / sessions_max_, [&](Worker& worker) {
                    worker.wires.step(SessionEvent{result.session, std::move(result.event)});
                });
        }
    }

    void keep_time() {
        const Instant now = net::now();
        std::vector<std::size_t> due;
        for (auto at = deadlines_.begin(); at != deadlines_.end() && at->first <= now; ++at)
            due.push_back(at->second);
        for (const std::size_t number : due)
            with_worker(number, [&](Worker& worker) { worker.wires.keep_time(now); });
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
    std::optional<discovery::Finder> finder_;                  // null: nobody is to be found
    std::map<std::string, std::vector<std::string>> findings_; // by source, the last
    bool was_wanted_ = false;
    Instant findings_due_{};
    Instant next_turn_told_{};
    std::uint64_t answers_ = 0;
    bool draining_ = false, stopping_ = false;
    FinishReason reason_{};
    Reception reception_ = Reception::nobody; // the best of all, also of those that are over
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
