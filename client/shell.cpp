#include "client/shell.hpp"

#include "common/discovery/finder.hpp"
#include "common/net/clock.hpp"
#include "common/net/endpoint.hpp"
#include "common/net/reach.hpp"
#include "common/protocol/codec.hpp"

#include <algorithm>
#include <csignal>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr int burst = 64;                // messages read from one socket before the other's turn
constexpr Duration farewell_max = 200ms; // for a Goodbye to leave

} // namespace

/// The two sockets, and what is done with them.
class Conversation::Port {
public:
    Port(const net::Context& context, Advice advice) : context_(context), advice_(advice) {}

    void perform(const Connect& action) {
        hang_up();
        reached_ = action.broker;
        connect();
    }
    void perform(const Speak& action) { spoken_ = action.version; }
    void perform(const Look& action) {
        hang_up();
        reached_.clear();
        Looking& looking = looking_[action.source];
        if (!looking.finder)
            looking.finder = std::make_unique<discovery::Finder>(
                std::vector{action.source}, discovery::finder_options(context_.farm()));
        looking.finder->set_wanted(true);
        looking.is_to_be_told = looking.last.has_value();
    }
    void perform(const StopLooking&) {
        for (const auto& [source, looking] : looking_)
            looking.finder->set_wanted(false);
    }
    void perform(const OpenStream& action) {
        stream_.reset();
        const auto endpoint = net::stream_endpoint(reached_, action.told);
        if (!endpoint) // a stream that cannot be reached: the follower asks for every tile instead
            return;
        if (auto stream = net::SubscriberSocket::connect(context_, *endpoint))
            stream_ = std::move(*stream);
    }
    void perform(const Subscribe& action) {
        if (stream_)
            stream_->subscribe(action.topic);
    }
    void perform(const Unsubscribe& action) {
        if (stream_)
            stream_->unsubscribe(action.topic);
    }
    void perform(const Send& action) {
        connect();
        if (!dealer_ ||
            dealer_->send(protocol::encode(action.message, spoken_)) != net::SendStatus::sent)
            not_sent_ = true;
    }
    /// And what to do; nothing where there is no telling.
    [[nodiscard]] std::string why_unreachable() const {
        using enum Advice;
        const std::string why = advice_ == none ? std::string() : net::why_silent(reached_);
        return why.empty()
                   ? why
                   : ": " + why + " (fraja-broker starts one, -b HOST:PORT names another" +
                         (advice_ == broker_or_local ? "; fraja-submit --local does without)"
                                                     : ")");
    }
    /// Why nothing could be sent, where keys do not fit.
    [[nodiscard]] std::string refusal() const { return dealer_ ? dealer_->refusal() : ""; }
    [[nodiscard]] bool take_not_sent() { return std::exchange(not_sent_, false); }

    [[nodiscard]] std::optional<Event> receive_from_broker() {
        const auto frames = dealer_ ? dealer_->receive() : std::nullopt;
        if (!frames)
            return std::nullopt;
        auto message = protocol::decode(*frames);
        if (!message)
            return Undecodable{message.error()};
        return FromBroker{*std::move(message), *protocol::version_of(*frames)};
    }
    /// Rubbish on the stream is skipped: what it should have been is repaired.
    [[nodiscard]] std::optional<Event> receive_from_stream() {
        while (auto published = stream_ ? stream_->receive() : std::nullopt)
            if (auto message = protocol::decode(published->frames))
                return FromStream{*std::move(message)};
        return std::nullopt;
    }

    /// What is new, and what was known when it was asked for.
    [[nodiscard]] std::vector<discovery::Findings> take_findings() {
        std::vector<discovery::Findings> all;
        for (auto& [source, looking] : looking_) {
            for (discovery::Findings& findings : looking.finder->take()) {
                looking.last = std::move(findings);
                looking.is_to_be_told = true;
            }
            if (std::exchange(looking.is_to_be_told, false))
                all.push_back(*looking.last);
        }
        return all;
    }

    void wait_also(std::vector<net::Waitable>& all) const {
        if (dealer_)
            all.emplace_back(*dealer_);
        if (stream_)
            all.emplace_back(*stream_);
        for (const auto& [source, looking] : looking_)
            all.emplace_back(looking.finder->fd());
    }
    [[nodiscard]] bool has_findings() const {
        return std::ranges::any_of(looking_,
                                   [](const auto& entry) { return entry.second.is_to_be_told; });
    }

    void take_leave() {
        if (!dealer_)
            return;
        dealer_->set_linger(farewell_max);
        (void)dealer_->send(protocol::encode(protocol::Goodbye{}, spoken_));
    }

private:
    /// At a source, since it was its turn for the first time.
    struct Looking {
        std::unique_ptr<discovery::Finder> finder;
        std::optional<discovery::Findings> last;
        bool is_to_be_told = false;
    };

    void hang_up() {
        dealer_.reset();
        stream_.reset();
    }
    /// Where there was no descriptor left for it, it is tried again with the next word.
    void connect() {
        if (dealer_ || reached_.empty())
            return;
        if (auto dealer = net::DealerSocket::connect(context_, reached_))
            dealer_ = std::move(*dealer);
    }

    const net::Context& context_;
    Advice advice_;
    std::string reached_;
    std::optional<net::DealerSocket> dealer_;
    std::optional<net::SubscriberSocket> stream_;
    protocol::Version spoken_ = protocol::version;
    std::map<std::string, Looking> looking_; // by source
    bool not_sent_ = false;
};

class Conversation::State {
public:
    State(const net::Context& context, Core& core, Listener& listener, Advice advice)
        : core_(core), listener_(listener), port_(context, advice) {
        core_.start(net::now(), actions_);
        perform_actions();
    }

    bool turn() {
        const bool drained = read();
        if (drained && !outcome_)
            step(Tick{});
        if (outcome_)
            return true;
        redraw_ = listener_.tick(net::now());
        outcome_ = listener_.wants_to_leave();
        return drained;
    }
    [[nodiscard]] const std::optional<Outcome>& outcome() const { return outcome_; }
    void wait_also(std::vector<net::Waitable>& all) const {
        listener_.wait_also(all);
        port_.wait_also(all);
    }
    [[nodiscard]] Instant due() const {
        return port_.has_findings() ? net::now() : std::min(core_.next_deadline(), redraw_);
    }
    void take_leave() { port_.take_leave(); }

private:
    /// Whether nothing is left to read.
    bool read() {
        bool drained = true;
        for (int i = 0; i < burst && !outcome_; ++i) {
            auto event = port_.receive_from_broker();
            if (!event)
                break;
            drained = i + 1 < burst;
            step(*event);
        }
        for (int i = 0; i < burst && !outcome_; ++i) {
            auto event = port_.receive_from_stream();
            if (!event)
                break;
            drained = drained && i + 1 < burst;
            step(*event);
        }
        for (discovery::Findings& findings : port_.take_findings())
            if (!outcome_)
                step(BrokersFound{std::move(findings.source), std::move(findings.endpoints),
                                  std::move(findings.trouble)});
        return drained;
    }

    void step(const Event& event) {
        core_.step(net::now(), event, actions_);
        perform_actions();
    }

    void perform_actions() {
        // Indexed: NotSent may add actions.
        for (std::size_t i = 0; i < actions_.size(); ++i) {
            const Action next = std::move(actions_[i]);
            std::visit([this](const auto& action) { perform(action); }, next);
            if (!port_.take_not_sent())
                continue;
            if (const std::string why = port_.refusal(); !why.empty())
                core_.step(net::now(), TurnedAway{why}, actions_);
            core_.step(net::now(), NotSent{}, actions_);
        }
        actions_.clear();
    }

    template <class A>
    void perform(const A& action) {
        port_.perform(action);
    }
    void perform(News news) {
        if (auto* const finished = std::get_if<Finished>(&news)) {
            if (finished->outcome.code == ExitCode::unreachable)
                finished->outcome.reason += port_.why_unreachable();
            outcome_ = finished->outcome;
        }
        listener_.hear(net::now(), news);
    }

    Core& core_;
    Listener& listener_;
    Port port_;
    std::vector<Action> actions_;
    std::optional<Outcome> outcome_;
    Instant redraw_{}; ///< when the listener wants to be called
};

Conversation::Conversation(const net::Context& context, Core& core, Listener& listener,
                           Advice advice)
    : state_(std::make_unique<State>(context, core, listener, advice)) {}
Conversation::~Conversation() = default;

bool Conversation::turn() {
    return state_->turn();
}
const std::optional<Outcome>& Conversation::outcome() const {
    return state_->outcome();
}
void Conversation::wait_also(std::vector<net::Waitable>& all) const {
    state_->wait_also(all);
}
Instant Conversation::due() const {
    return state_->due();
}
void Conversation::take_leave() {
    state_->take_leave();
}

namespace {

Outcome hold(Conversation& conversation, const net::SignalWatch* signals) {
    std::optional<Outcome> told;
    while (!told) {
        const bool drained = conversation.turn();
        told = conversation.outcome();
        if (const auto signal = signals && !told ? signals->receive() : std::nullopt)
            told = outcome_of(*signal);
        if (told || !drained)
            continue;
        std::vector<net::Waitable> all;
        if (signals)
            all.emplace_back(signals->fd());
        conversation.wait_also(all);
        net::wait(all, conversation.due() - net::now());
    }
    conversation.take_leave();
    return *told;
}

} // namespace

Outcome outcome_of(int signal) {
    return signal == SIGTERM ? Outcome{ExitCode::terminated, "terminated"}
                             : Outcome{ExitCode::interrupted, "interrupted"};
}

Outcome converse(const net::Context& context, Core& core, Listener& listener,
                 const net::SignalWatch* signals) {
    Conversation conversation(context, core, listener, Conversation::Advice::broker);
    return hold(conversation, signals);
}

Outcome run_submission(const net::Context& context, SubmissionRequest request, Listener& listener,
                       const net::SignalWatch* signals) {
    Submission submission(std::move(request), fresh_rng());
    Conversation conversation(context, submission, listener, Conversation::Advice::broker_or_local);
    return hold(conversation, signals);
}

} // namespace fraja::client
