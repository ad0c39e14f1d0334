#include "worker/shell.hpp"

#include "common/base/text.hpp"
#include "common/net/clock.hpp"
#include "common/net/descriptors.hpp"
#include "common/net/poller.hpp"
#include "common/protocol/codec.hpp"
#include "worker/emulation.hpp"
#include "worker/render_pool.hpp"

#include <algorithm>
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace fraja::worker {
namespace {

using namespace std::chrono_literals;

constexpr Duration resend_pause_min = 2ms, resend_pause_max = 250ms;
constexpr Duration farewell_max = 1s;   ///< for the last answers and the Goodbye to leave
constexpr int messages_per_round = 256; ///< so that a flood does not keep the others waiting

/// A broker's end of the line, whoever made the connection.
class Line {
public:
    Line(net::DealerSocket socket) : socket_(std::move(socket)) {}
    Line(net::CalleeSocket socket) : socket_(std::move(socket)) {}

    [[nodiscard]] std::optional<net::Frames> receive() {
        return std::visit([](auto& socket) { return socket.receive(); }, socket_);
    }
    net::SendStatus send(const protocol::Packet& packet) {
        return std::visit([&](auto& socket) { return socket.send(packet); }, socket_);
    }
    void set_linger(Duration linger) {
        std::visit([&](auto& socket) { socket.set_linger(linger); }, socket_);
    }
    [[nodiscard]] const net::Socket& socket() const {
        return std::visit([](const auto& socket) -> const net::Socket& { return socket; }, socket_);
    }

    /// Who is at the other end; 0: nobody. Always the same where we have connected.
    [[nodiscard]] std::uint64_t caller() const {
        const auto* called = std::get_if<net::CalleeSocket>(&socket_);
        return called ? called->caller() : 1;
    }
    void hang_up(bool for_good) {
        if (auto* called = std::get_if<net::CalleeSocket>(&socket_))
            called->hang_up(for_good);
    }

private:
    std::variant<net::DealerSocket, net::CalleeSocket> socket_;
};

/// One broker, or those that call one after the other: the socket, the session, and what waits to
/// leave.
class Link {
public:
    struct Who {
        SessionIndex index{};
        std::string title; ///< in the log
    };
    /// `options` and `pool` must outlive this.
    Link(Who who, const WorkerOptions& options, Line line, Session session, Pool& pool)
        : who_(std::move(who)), options_(options), line_(std::move(line)),
          session_(std::move(session)), pool_(pool), caller_(line_.caller()) {
        line_.set_linger(farewell_max);
    }

    void step(const Event& event) {
        step_session(event);
        heed_caller();
    }

    void receive_some() {
        for (int i = 0; i < messages_per_round; ++i) {
            const auto frames = line_.receive();
            heed_caller();
            if (!frames)
                return;
            auto message = protocol::decode(*frames);
            if (message)
                step(Received{std::move(*message)});
            else
                step(Undecodable{message.error()});
        }
    }

    void keep_time(Instant now) {
        if (now >= resend_at_)
            flush();
        heed_caller();
        if (caller_ != 0 && now >= session_.next_deadline())
            step(Tick{pool_.progress(who_.index)});
    }

    [[nodiscard]] Instant next_deadline() const {
        // Without a caller there is nobody to greet.
        const Instant deadline =
            caller_ != 0 ? std::min(resend_at_, session_.next_deadline()) : Instant::never();
        return finished_ ? std::min(deadline, finished_at_ + farewell_max) : deadline;
    }
    [[nodiscard]] std::optional<FinishReason> finished() const { return finished_; }
    /// Nothing is left to do, or it has taken too long.
    [[nodiscard]] bool over(Instant now) const {
        return finished_ && (outbox_.empty() || now >= finished_at_ + farewell_max);
    }
    [[nodiscard]] const net::Socket& socket() const { return line_.socket(); }

private:
    void step_session(const Event& event) {
        actions_.clear();
        session_.step(net::now(), event, actions_);
        for (Action& action : actions_)
            std::visit([&](auto& a) { perform(std::move(a)); }, action);
        flush();
    }

    /// What was for another caller is for nobody; a new one is greeted.
    void heed_caller() {
        while (caller_ != line_.caller()) {
            outbox_.clear();
            resend_at_ = Instant::never();
            const bool one_has_gone = std::exchange(caller_, line_.caller()) != 0;
            if (one_has_gone)
                step_session(CallerGone{});
            if (caller_ != 0 && caller_ == line_.caller())
                step_session(Tick{});
        }
    }

    void perform(Send action) {
        if (std::holds_alternative<protocol::WorkerHello>(action.message))
            outbox_.clear();
        outbox_.push_back(protocol::encode(action.message));
    }
    void perform(CompileScene action) { pool_.perform(who_.index, std::move(action)); }
    void perform(StartTile action) { pool_.perform(who_.index, action); }
    void perform(StopTile action) { pool_.perform(who_.index, action); }
    void perform(ForgetScene action) { pool_.perform(who_.index, action); }
    void perform(HangUp action) { line_.hang_up(action.for_good); }
    void perform(const Log& action) {
        if (options_.on_log)
            options_.on_log(
                action.level,
                printable(who_.title + ": " + action.text)); // a broker's own words may be in it
    }
    void perform(Finished action) {
        finished_ = action.reason;
        finished_at_ = net::now();
    }

    /// What cannot leave (no connection yet, or a broker that does not read) is tried again soon,
    /// and ever less often. It is never much: the answers that the credit allows, and the beats
    /// until the silent broker is given up.
    void flush() {
        bool progress = false;
        while (!outbox_.empty() && line_.send(outbox_.front()) == net::SendStatus::sent) {
            outbox_.pop_front();
            progress = true;
        }
        if (outbox_.empty() || progress)
            resend_pause_ = resend_pause_min;
        else
            resend_pause_ = std::min(2 * resend_pause_, resend_pause_max);
        resend_at_ = outbox_.empty() ? Instant::never() : net::now() + resend_pause_;
    }

    Who who_;
    const WorkerOptions& options_;
    Line line_;
    Session session_;
    Pool& pool_;
    std::uint64_t caller_; // whom the session speaks to
    std::vector<Action> actions_;
    std::deque<protocol::Packet> outbox_;
    Instant resend_at_ = Instant::never();
    Duration resend_pause_ = resend_pause_min;
    std::optional<FinishReason> finished_;
    Instant finished_at_{};
};

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
            auto socket = net::DealerSocket::connect(context, broker);
            if (!socket)
                return socket.error();
            add_link(std::move(*socket), broker, identity_of(i));
        }
        return {};
    }

    FinishReason run() {
        while (open_count_ > 0) {
            const Instant deadline = std::min(deadlines_.begin()->first, pool_->next_deadline());
            for (const std::size_t index : poller_.wait(deadline - net::now()))
                with_link(index, [](Link& link) { link.receive_some(); });
            obey();
            hand_out_results();
            keep_time();
        }
        return reason_;
    }

private:
    Result<void> listen(const net::Context& context) {
        const auto wanted =
            listening_endpoints(options_.listen, options_.insecure, session_count(options_));
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
            Link::Who{SessionIndex(static_cast<std::uint32_t>(index)), std::move(title)}, options_,
            std::move(line), Session(std::move(identity), limits_), *pool_));
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
        for (const PoolResult& result : pool_->take_results())
            with_link(static_cast<std::size_t>(result.session),
                      [&](Link& link) { link.step(result.event); });
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
