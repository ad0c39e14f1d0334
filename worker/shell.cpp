#include "worker/shell.hpp"

#include "common/net/clock.hpp"
#include "common/net/descriptors.hpp"
#include "common/net/poller.hpp"
#include "worker/emulation.hpp"
#include "worker/link.hpp"
#include "worker/render_pool.hpp"

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace fraja::worker {
namespace {

constexpr Duration turn_interval = std::chrono::seconds(1); ///< of telling that the loop turns

/// Deeds that may wait for a thread: of each session its tiles, and the scenes on its shelf for
/// every kernel.
std::size_t queue_max(const WorkerOptions& options, const Limits& limits) {
    const std::size_t tiles = credit_for(options.threads, limits);
    const std::size_t scenes = tiles + limits.shelf.idle_count_max;
    return session_count(options) *
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
                              .queue_max = queue_max(options, limits)},
        done);
}

class Shell {
public:
    Shell(const WorkerOptions& options, Control& control, const Limits& limits)
        : options_(options), control_(control), limits_(limits),
          pool_(make_pool(options, limits, pool_waker_)) {
        poller_.add(pool_waker_.fd());
        poller_.add(control_.waker().fd());
    }

    Result<void> connect(const net::Context& context) {
        if (auto reserved = net::reserve_descriptors(session_count(options_)); !reserved)
            return reserved.error();
        if (!options_.listen.empty())
            return listen(context);
        // An id for each session: two endpoints may turn out to be one broker, where one worker
        // would push itself out for ever.
        for (std::uint64_t i = 0; i < session_count(options_); ++i) {
            const std::string& broker = options_.brokers[options_.emulated.empty() ? i : 0];
            // Emulated workers have one broker and one key: what one is told holds for all.
            using Telling = net::DealerSocket::Telling;
            auto socket = net::DealerSocket::connect(
                context, broker,
                options_.emulated.empty() || i == 0 ? Telling::refusals : Telling::nothing);
            if (!socket)
                return socket.error();
            add_link(std::move(*socket), broker, identity_of(i));
        }
        return {};
    }

    FinishReason run() {
        while (open_count_ > 0) {
            const Instant deadline =
                std::min({deadlines_.begin()->first, pool_->next_deadline(), tell_that_it_turns()});
            for (const std::size_t index : poller_.wait(deadline - net::now()))
                with_link(index, [](Link& link) { link.receive_some(); });
            obey();
            hand_out_results();
            keep_time();
        }
        return reason_;
    }

private:
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

    Result<void> listen(const net::Context& context) {
        if (!options_.allow.empty()) { // before anything is bound
            auto list = net::AllowList::read(options_.allow);
            const auto taken = list ? context.admit(*std::move(list)) : Result<void>(list.error());
            if (!taken)
                return Error{taken.error().code, "--allow: " + taken.error().message};
        }
        const auto wanted = listening_endpoints(
            options_.listen, options_.insecure || !options_.allow.empty(), session_count(options_));
        if (!wanted)
            return wanted.error();
        std::vector<std::string> bound;
        for (std::uint64_t i = 0; i < wanted->size(); ++i) {
            auto socket = net::CalleeSocket::bind(context, (*wanted)[i]);
            if (!socket)
                return socket.error();
            bound.push_back(socket->endpoint());
            add_link(std::move(*socket), bound.back(), identity_of(i));
        }
        if (options_.on_listening)
            options_.on_listening(bound);
        return {};
    }

    /// Of the session with that number, from 0.
    [[nodiscard]] Identity identity_of(std::uint64_t i) const {
        Identity identity{random_id<WorkerId>(), options_.name, options_.threads, options_.tags,
                          !options_.listen.empty()};
        if (!options_.emulated.empty()) {
            identity.name += "/" + std::to_string(i + 1);
            identity.tags.emplace_back("emulated");
        }
        return identity;
    }

    void add_link(Line line, const std::string& endpoint, Identity identity) {
        const std::size_t index = links_.size();
        std::string title = endpoint;
        if (!options_.emulated.empty())
            title += ": " + identity.name;
        links_.push_back(std::make_unique<Link>(
            Link::Who{SessionIndex(static_cast<std::uint32_t>(index)), std::move(title)},
            options_.on_log, std::move(line), Session(std::move(identity), limits_), *pool_));
        poller_.add(index, links_.back()->socket());
        noted_.push_back(links_.back()->next_deadline());
        deadlines_.emplace(noted_.back(), index);
        ++open_count_;
    }

    /// All that is done with a link goes through here: its deadline is noted, its socket looked at
    /// again, and when it is over it goes.
    template <class F>
    void with_link(std::size_t index, F deed) {
        std::unique_ptr<Link>& link = links_[index];
        if (!link)
            return;
        deed(*link);
        poller_.look_again(index);
        const Instant deadline = link->next_deadline();
        if (deadline != noted_[index]) {
            deadlines_.erase({noted_[index], index});
            deadlines_.emplace(deadline, index);
            noted_[index] = deadline;
        }
        if (link->over(net::now()))
            let_go(index);
    }

    void let_go(std::size_t index) {
        reason_ = *links_[index]->finished();
        deadlines_.erase({noted_[index], index});
        poller_.remove(index);
        links_[index].reset();
        --open_count_;
    }

    void for_each_link(const Event& event) {
        for (std::size_t index = 0; index < links_.size(); ++index)
            with_link(index, [&](Link& link) { link.step(event); });
    }

    /// Passes on what `control_` asks, each once.
    void obey() {
        control_.waker().drain();
        if (control_.drain_asked() && !std::exchange(draining_, true))
            for_each_link(Drain{});
        if (control_.stop_asked() && !std::exchange(stopping_, true))
            for_each_link(StopNow{});
    }

    void hand_out_results() {
        pool_waker_.drain();
        for (const PoolResult& result : pool_->take_results()) {
            answers_ += std::holds_alternative<TileFinished>(result.event) ||
                        std::holds_alternative<TileBroken>(result.event);
            with_link(static_cast<std::size_t>(result.session),
                      [&](Link& link) { link.step(result.event); });
        }
    }

    void keep_time() {
        const Instant now = net::now();
        std::vector<std::size_t> due;
        for (auto at = deadlines_.begin(); at != deadlines_.end() && at->first <= now; ++at)
            due.push_back(at->second);
        for (const std::size_t index : due)
            with_link(index, [now](Link& link) {
                link.receive_some(); // what has arrived is heard before silence is judged
                link.keep_time(now);
            });
    }

    const WorkerOptions& options_;
    Control& control_;
    const Limits limits_;
    net::Waker pool_waker_;
    std::unique_ptr<Pool> pool_;
    net::Poller poller_;
    std::vector<std::unique_ptr<Link>> links_; // at SessionIndex; null when over
    std::size_t open_count_ = 0;
    std::vector<Instant> noted_; // of each link its deadline, as it is among these:
    std::set<std::pair<Instant, std::size_t>> deadlines_;
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
    Shell shell(options, control, limits);
    if (auto connected = shell.connect(context); !connected)
        return connected.error();
    return shell.run();
}

} // namespace fraja::worker
