#include "broker/shell.hpp"

#include "broker/dispatcher.hpp"
#include "common/base/text.hpp"
#include "common/net/clock.hpp"
#include "common/net/endpoint.hpp"
#include "common/protocol/codec.hpp"

#include <chrono>
#include <csignal>
#include <deque>
#include <vector>

namespace fraja::broker {
namespace {

constexpr int messages_per_turn_max = 1'000; // then the clock is looked at again

Result<std::string> checked_endpoint(const std::string& text, std::uint16_t default_port,
                                     bool insecure) {
    auto endpoint = net::parse_endpoint(text, default_port);
    if (!endpoint)
        return endpoint.error();
    if (endpoint->host == "localhost") // ZeroMQ would look for a network interface of that name
        endpoint->host = "127.0.0.1";
    if (!insecure && !net::is_loopback(*endpoint))
        return Error{
            ErrorCode::invalid_argument,
            net::to_string(*endpoint) +
                " can be reached from other machines, and this broker has no keys yet to tell "
                "friend "
                "from stranger: use a loopback address, or say --insecure on a network you trust"};
    return net::to_string(*endpoint);
}

/// Epochs grow with every start: microseconds since 1970.
std::uint64_t new_epoch() {
    const auto since_1970 = std::chrono::system_clock::now().time_since_epoch();
    return static_cast<std::uint64_t>(
        std::chrono::duration_cast<std::chrono::microseconds>(since_1970).count());
}

/// Both sockets with the dispatcher between them.
class Shell {
public:
    Shell(net::RouterSocket router, net::PublisherSocket publisher, const Options& options)
        : router_(std::move(router)), publisher_(std::move(publisher)), options_(options),
          dispatcher_({random_id<BrokerId>(), new_epoch(), publisher_.endpoint()}, options.limits) {
    }

    void run(const Control& control) {
        step(Tick{});
        while (!control.stopping() && !stopped_by_signal_) {
            std::vector<net::Waitable> waitables{router_, publisher_, control.waker().fd()};
            if (options_.signals)
                waitables.emplace_back(options_.signals->fd());
            net::wait(waitables, dispatcher_.next_deadline() - net::now());
            control.waker().drain();
            take_signals();
            for (int i = 0; i < messages_per_turn_max && take_subscription(); ++i) {
            }
            for (int i = 0; i < messages_per_turn_max && take_message(); ++i) {
            }
            step(Tick{});
        }
    }

private:
    void take_signals() {
        while (const auto signal = options_.signals ? options_.signals->receive() : std::nullopt) {
            if (*signal == SIGINT || *signal == SIGTERM) {
                stopped_by_signal_ = true;
                log(LogLevel::info, "stopping");
            } else if (*signal == SIGUSR1) {
                for (const std::string& line : dispatcher_.describe(net::now()))
                    log(LogLevel::info, line);
            }
        }
    }

    bool take_subscription() {
        auto change = publisher_.receive();
        if (!change)
            return false;
        if (change->subscribed)
            step(TopicSubscribed{std::move(change->topic)});
        else
            step(TopicUnsubscribed{std::move(change->topic)});
        return true;
    }

    bool take_message() {
        auto received = router_.receive();
        if (!received)
            return false;
        auto message = protocol::decode(received->frames);
        if (message)
            step(PeerSaid{std::move(received->peer), std::move(*message)});
        else
            step(PeerSpokeRubbish{std::move(received->peer), message.error()});
        return true;
    }

    /// One event, what it leads to, and what follows from sends that fail.
    void step(Event event) {
        std::deque<Event> events;
        events.push_back(std::move(event));
        while (!events.empty()) {
            actions_.clear();
            dispatcher_.step(net::now(), events.front(), actions_);
            events.pop_front();
            for (const Action& action : actions_)
                perform(action, events);
        }
    }

    void perform(const Action& action, std::deque<Event>& events) {
        if (const auto* send = std::get_if<Send>(&action)) {
            if (router_.send(send->peer, protocol::encode(send->message)) != net::SendStatus::sent)
                events.push_back(PeerUnreachable{send->peer});
        } else if (const auto* publish = std::get_if<Publish>(&action)) {
            publisher_.publish(publish->topic, protocol::encode(publish->message));
        } else if (const auto* line = std::get_if<Log>(&action)) {
            log(line->level, line->text);
        }
    }

    void log(LogLevel level, const std::string& text) const {
        if (options_.on_log)
            options_.on_log(level, printable(text)); // names in it are strangers' choice
    }

    net::RouterSocket router_;
    net::PublisherSocket publisher_;
    const Options& options_;
    Dispatcher dispatcher_;
    std::vector<Action> actions_;
    bool stopped_by_signal_ = false;
};

} // namespace

Result<void> run_broker(const net::Context& context, const Options& options,
                        const Control& control) {
    const auto bind = checked_endpoint(options.bind, 50057, options.insecure);
    if (!bind)
        return bind.error();
    const auto publish = checked_endpoint(options.publish, 50058, options.insecure);
    if (!publish)
        return publish.error();
    auto router = net::RouterSocket::bind(context, *bind);
    if (!router)
        return router.error();
    auto publisher = net::PublisherSocket::bind(context, *publish);
    if (!publisher)
        return publisher.error();
    if (options.on_listening)
        options.on_listening(router->endpoint(), publisher->endpoint());
    Shell(std::move(*router), std::move(*publisher), options).run(control);
    return {};
}

} // namespace fraja::broker
