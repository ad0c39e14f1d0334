#include "worker/shell.hpp"

#include "common/base/text.hpp"
#include "common/net/clock.hpp"
#include "common/protocol/codec.hpp"
#include "worker/render_pool.hpp"

#include <algorithm>
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace fraja::worker {
namespace {

using namespace std::chrono_literals;

constexpr Duration resend_pause_min = 2ms, resend_pause_max = 250ms;
constexpr Duration farewell_max = 1s;   ///< for the last answers and the Goodbye to leave
constexpr int messages_per_round = 256; ///< so that a flood does not keep the others waiting

/// One broker: its socket, its session, and what waits to leave.
class Link {
public:
    /// `options` and `pool` must outlive this.
    Link(SessionIndex index, const WorkerOptions& options, net::DealerSocket socket,
         Session session, RenderPool& pool)
        : index_(index), options_(options), socket_(std::move(socket)),
          session_(std::move(session)), pool_(pool) {
        socket_.set_linger(farewell_max);
    }

    void step(const Event& event) {
        actions_.clear();
        session_.step(net::now(), event, actions_);
        for (Action& action : actions_)
            std::visit([&](auto& a) { perform(std::move(a)); }, action);
        flush();
    }

    /// Whether there may be more.
    bool receive_some() {
        for (int i = 0; i < messages_per_round; ++i) {
            const auto frames = socket_.receive();
            if (!frames)
                return false;
            auto message = protocol::decode(*frames);
            if (message)
                step(Received{std::move(*message)});
            else
                step(Undecodable{message.error()});
        }
        return true;
    }

    void keep_time(Instant now) {
        if (now >= resend_at_)
            flush();
        if (now >= session_.next_deadline())
            step(Tick{pool_.progress(index_)});
    }

    [[nodiscard]] Instant next_deadline() const {
        const Instant deadline = std::min(resend_at_, session_.next_deadline());
        return finished_ ? std::min(deadline, finished_at_ + farewell_max) : deadline;
    }
    [[nodiscard]] std::optional<FinishReason> finished() const { return finished_; }
    /// Nothing is left to do, or it has taken too long.
    [[nodiscard]] bool over(Instant now) const {
        return finished_ && (outbox_.empty() || now >= finished_at_ + farewell_max);
    }
    [[nodiscard]] const net::Socket& socket() const { return socket_; }

private:
    void perform(Send action) {
        if (std::holds_alternative<protocol::WorkerHello>(action.message))
            outbox_.clear();
        outbox_.push_back(protocol::encode(action.message));
    }
    void perform(CompileScene action) { pool_.perform(index_, std::move(action)); }
    void perform(StartTile action) { pool_.perform(index_, action); }
    void perform(StopTile action) { pool_.perform(index_, action); }
    void perform(ForgetScene action) { pool_.perform(index_, action); }
    void perform(const Log& action) {
        if (options_.on_log)
            options_.on_log(action.level,
                            printable(options_.brokers[static_cast<std::size_t>(index_)] + ": " +
                                      action.text)); // a broker's own words may be in it
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
        while (!outbox_.empty() && socket_.send(outbox_.front()) == net::SendStatus::sent) {
            outbox_.pop_front();
            progress = true;
        }
        if (outbox_.empty() || progress)
            resend_pause_ = resend_pause_min;
        else
            resend_pause_ = std::min(2 * resend_pause_, resend_pause_max);
        resend_at_ = outbox_.empty() ? Instant::never() : net::now() + resend_pause_;
    }

    SessionIndex index_;
    const WorkerOptions& options_;
    net::DealerSocket socket_;
    Session session_;
    RenderPool& pool_;
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
    return options.brokers.size() *
           (tiles + scenes * protocol::ValueCount<protocol::KernelChoice>::value);
}

class Shell {
public:
    Shell(const WorkerOptions& options, Control& control, const Limits& limits)
        : options_(options), control_(control), limits_(limits),
          pool_(options.threads, queue_max(options, limits), pool_waker_) {}

    Result<void> connect(const net::Context& context) {
        for (const std::string& endpoint : options_.brokers) {
            auto socket = net::DealerSocket::connect(context, endpoint);
            if (!socket)
                return socket.error();
            // An id for each session: two endpoints may turn out to be one broker, where one worker
            // would push itself out for ever.
            Identity identity{random_id<WorkerId>(), options_.name, options_.threads,
                              options_.tags};
            links_.push_back(std::make_unique<Link>(
                SessionIndex(static_cast<std::uint32_t>(links_.size())), options_,
                std::move(*socket), Session(std::move(identity), limits_), pool_));
        }
        return {};
    }

    FinishReason run() {
        bool hurry = false;
        while (!clear_away()) {
            wait(hurry ? Duration::zero() : next_deadline() - net::now());
            obey();
            hurry = false;
            for_each_link([&](Link& link) { hurry = link.receive_some() || hurry; });
            hand_out_results();
            for_each_link([now = net::now()](Link& link) { link.keep_time(now); });
        }
        return reason_;
    }

private:
    template <class F>
    void for_each_link(F deed) {
        for (const std::unique_ptr<Link>& link : links_)
            if (link)
                deed(*link);
    }

    void wait(Duration timeout) {
        std::vector<net::Waitable> waitables{pool_waker_.fd(), control_.waker().fd()};
        for_each_link([&](Link& link) { waitables.emplace_back(link.socket()); });
        net::wait(waitables, std::max(timeout, Duration::zero()));
    }

    Instant next_deadline() {
        Instant deadline = Instant::never();
        for_each_link([&](Link& link) { deadline = std::min(deadline, link.next_deadline()); });
        return deadline;
    }

    /// Passes on what `control_` asks, each once.
    void obey() {
        control_.waker().drain();
        if (control_.drain_asked() && !std::exchange(draining_, true))
            for_each_link([](Link& link) { link.step(Drain{}); });
        if (control_.stop_asked() && !std::exchange(stopping_, true))
            for_each_link([](Link& link) { link.step(StopNow{}); });
    }

    void hand_out_results() {
        pool_waker_.drain();
        for (const PoolResult& result : pool_.take_results())
            if (Link* link = links_[static_cast<std::size_t>(result.session)].get())
                link->step(result.event);
    }

    /// Lets go of sessions that are over; whether none is left.
    bool clear_away() {
        const Instant now = net::now();
        for (std::unique_ptr<Link>& link : links_)
            if (link && link->over(now)) {
                reason_ = *link->finished();
                link.reset();
            }
        return std::ranges::none_of(links_, [](const auto& link) { return link != nullptr; });
    }

    const WorkerOptions& options_;
    Control& control_;
    const Limits limits_;
    net::Waker pool_waker_;
    RenderPool pool_;
    std::vector<std::unique_ptr<Link>> links_; // at SessionIndex; null when over
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
