#include "broker/shell.hpp"

#include "broker/dispatcher.hpp"
#include "broker/restore.hpp"
#include "broker/store_reader.hpp"
#include "broker/store_writer.hpp"
#include "common/base/freed_memory.hpp"
#include "common/base/once.hpp"
#include "common/base/text.hpp"
#include "common/net/clock.hpp"
#include "common/net/endpoint.hpp"
#include "common/protocol/codec.hpp"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstring>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace fraja::broker {
namespace {

constexpr int messages_per_turn_max = 1'000; // then the clock is looked at again
/// What pictures took that are gone goes back to the system so often. All the time it would cost a
/// tile more than its way through the broker does.
constexpr Duration give_back_interval = std::chrono::minutes(1);
constexpr Duration keyless_told_interval = std::chrono::minutes(10);

Duration since_1970() {
    return std::chrono::system_clock::now().time_since_epoch();
}

/// Epochs grow with every start: microseconds since 1970.
std::uint64_t new_epoch() {
    return static_cast<std::uint64_t>(
        std::chrono::duration_cast<std::chrono::microseconds>(since_1970()).count());
}

std::uint64_t random_number() {
    const auto bytes = random_id<Nonce>().bytes;
    std::uint64_t parts[2];
    static_assert(sizeof parts == bytes.size());
    std::memcpy(parts, bytes.data(), sizeof parts);
    return parts[0] ^ parts[1];
}

std::uint64_t packet_bytes(const protocol::Packet& packet) {
    return packet.header.size() + packet.body.size() + byte_count(packet.blobs);
}

/// What a broker keeps, and what it found there.
struct Kept {
    std::uint64_t epoch = 0;
    Restored restored;
    StoreReader reader;
    StoreWriter writer;
};

/// The store with all that a broker needs of it at its start.
Result<std::unique_ptr<Kept>> open_store(const std::filesystem::path& state,
                                         const net::Waker& waker) {
    auto store = Store::open(state);
    if (!store)
        return store.error();
    auto reader = StoreReader::open(*store);
    if (!reader)
        return reader.error();
    auto restored = restore(*store, *reader);
    if (!restored)
        return restored.error();
    const auto epoch = store->next_epoch(); // last: what is refused is left as it is
    if (!epoch)
        return epoch.error();
    return std::unique_ptr<Kept>(new Kept{*epoch, std::move(*restored), std::move(*reader),
                                          StoreWriter(std::move(*store), waker)});
}

/// Empty, where it is bound to all addresses that the machine has: others know which of them they
/// reach.
std::string endpoint_for_others(const Options& options, const std::string& bound) {
    if (!options.advertise.empty())
        return options.advertise;
    for (const char* any : {"tcp://0.0.0.0:", "tcp://[::]:", "tcp://*:"})
        if (bound.starts_with(any))
            return {};
    return bound;
}

/// Whoever is listed with the farm's own key would be taken for one of its brokers.
Result<void> admit(const net::Context& context, const std::filesystem::path& file) {
    auto list = net::AllowList::read(file);
    if (!list)
        return list.error();
    if (const auto known = context.admitted(); list->size() == 0 && known && known->size() > 0)
        return Error{ErrorCode::invalid_argument,
                     file.string() + ": it names no key, and so would shut out everybody (is it "
                                     "being written?)"};
    if (const auto holder = list->find(context.farm()->text))
        return Error{ErrorCode::invalid_argument,
                     file.string() + ": '" + holder->name +
                         "' has the key of the farm's brokers, and would be taken for one: each of "
                         "those that are listed has a key of its own (fraja-ctl keygen)"};
    return context.admit(*std::move(list));
}

/// Both sockets and the store, with the dispatcher between them.
class Shell {
public:
    /// `kept`: null where nothing is kept. `waker` is woken when there is news of it.
    Shell(const net::Context& context, net::RouterSocket router, net::PublisherSocket publisher,
          std::unique_ptr<Kept> kept, const net::Waker& waker, const Options& options)
        : context_(context), router_(std::move(router)), publisher_(std::move(publisher)),
          kept_(std::move(kept)), waker_(waker), options_(options),
          dispatcher_({.broker = random_id<BrokerId>(),
                       .epoch = kept_ ? kept_->epoch : new_epoch(),
                       .stream = publisher_.endpoint(),
                       .keeps = kept_ != nullptr,
                       .started_at = net::now(),
                       .unix_offset = since_1970() - (net::now() - Instant{}),
                       .endpoint = endpoint_for_others(options, router_.endpoint()),
                       .peers = options.peers,
                       .check_key = random_number(),
                       .is_branch = !options.upstream.brokers.empty()},
                      options.limits),
          next_report_(options.on_report ? Instant{} : Instant::never()) {
        if (!options.upstream.brokers.empty())
            upstream_.emplace(
                context, options.upstream, [this] { return dispatcher_.order_progress(); },
                options.on_log);
    }

    /// Whether all is kept that should be.
    bool run(const Control& control) {
        if (kept_)
            step(std::exchange(kept_->restored, {}));
        step(Tick{});
        while (!control.stopping() && !stopped_by_signal_) {
            report_if_due();
            give_back_if_due();
            std::vector<net::Waitable> waitables{router_, publisher_, control.waker().fd(),
                                                 waker_.fd()};
            if (options_.signals)
                waitables.emplace_back(options_.signals->fd());
            for (const auto& [endpoint, broker] : dialled_)
                waitables.emplace_back(broker.socket);
            Instant deadline =
                std::min({dispatcher_.next_deadline(), next_report_, next_give_back_});
            if (upstream_) {
                deadline = std::min(deadline, upstream_->next_deadline());
                for (const net::Socket* socket : upstream_->sockets())
                    waitables.emplace_back(*socket);
            }
            net::wait(waitables, deadline - net::now());
            control.waker().drain();
            take_signals();
            take_news();
            for (int i = 0; i < messages_per_turn_max && take_subscription(); ++i) {
            }
            for (int i = 0; i < messages_per_turn_max && take_message(); ++i) {
            }
            hear_brokers();
            serve_upstream();
            step(Tick{});
        }
        if (upstream_)
            upstream_->leave();
        return !kept_ || kept_->writer.stop();
    }

private:
    void give_back_if_due() {
        if (const Instant now = net::now(); now >= next_give_back_) {
            next_give_back_ = now + give_back_interval;
            give_back_freed_memory();
        }
    }
    void report_if_due() {
        const Instant now = net::now();
        if (now < next_report_)
            return;
        next_report_ = now + report_interval;
        report_.at = now;
        tell_of_strangers();
        dispatcher_.set_unix_offset(since_1970() - (now - Instant{}));
        report_.figures = dispatcher_.figures();
        if (kept_)
            report_.written = kept_->writer.totals();
        options_.on_report(report_);
    }

    void take_news() {
        waker_.drain();
        if (!kept_)
            return;
        for (const StoreNews& news : kept_->writer.take_news()) {
            if (const auto* committed = std::get_if<Committed>(&news))
                step(Stored{committed->sequence});
            else if (const auto* trouble = std::get_if<StoreTrouble>(&news))
                step(StoreFails{trouble->reason});
            else
                step(StoreWorks{});
        }
    }

    void serve_upstream() {
        if (!upstream_)
            return;
        for (auto events = upstream_->serve(net::now(), dispatcher_.thread_count());
             !events.empty(); events = upstream_->serve(net::now(), dispatcher_.thread_count()))
            for (Event& event : events)
                step(std::move(event));
    }

    void take_signals() {
        while (const auto signal = options_.signals ? options_.signals->receive() : std::nullopt) {
            if (*signal == SIGINT || *signal == SIGTERM) {
                stopped_by_signal_ = true;
                log({LogLevel::info, "stopping", {}, "stopping" + fate_of_jobs()});
                if (options_.on_stopping)
                    options_.on_stopping();
            } else if (*signal == SIGHUP) {
                read_allow_list_again();
                if (const auto limits =
                        options_.on_hangup ? options_.on_hangup() : std::optional<Limits>())
                    dispatcher_.change_limits(*limits);
            } else if (*signal == SIGUSR1) {
                for (const std::string& line : dispatcher_.describe(net::now()))
                    log({LogLevel::info, {}, {}, line});
            }
        }
    }

    /// A list that cannot be used changes nothing. The stream's subscribers are known to libzmq
    /// alone: so where one may not follow any more all are cut off, and the others come back.
    void read_allow_list_again() {
        if (options_.allow.empty())
            return;
        const auto before = context_.admitted();
        if (const auto taken = admit(context_, options_.allow); !taken) {
            log({LogLevel::error,
                 "allow_list_refused",
                 {},
                 "the keys that are known stay as they were: " + taken.error().message});
            return;
        }
        const auto now = context_.admitted();
        log({LogLevel::info,
             "allow_list_read",
             {},
             "knows " + counted(now->size() - 1, "key") + " of " + options_.allow.string()});
        step(RolesChanged{now->roles()});
        if (before->followers_lost_in(*now))
            publisher_.cut_off_all();
    }

    void tell_of_strangers() {
        report_.keys_refused = context_.refused_count();
        for (const net::Stranger& s : context_.take_strangers())
            log({LogLevel::warning,
                 "key_refused",
                 {},
                 "refused the key " + (s.key.empty() ? "(none)" : s.key) + " from " + s.address +
                     ": " + s.why});
        const std::uint64_t missing = context_.keyless_count() - report_.keys_missing;
        report_.keys_missing += missing;
        keyless_untold_ += missing;
        if (keyless_untold_ > 0 && keyless_told_.is_new(report_.at, {}))
            log({LogLevel::warning,
                 "key_missing",
                 {},
                 counted(std::exchange(keyless_untold_, 0), "connection") +
                     " ended before a key was shown: who has none (--key-file), or takes this for "
                     "another farm, is not let in"});
    }

    /// Of those that are not over.
    [[nodiscard]] std::string fate_of_jobs() const {
        const std::uint64_t count = dispatcher_.figures().jobs_not_over();
        if (count == 0)
            return {};
        return ": " + counted(count, "job") +
               (kept_ ? " to go on with when it is started again"
                      : " not over, which nobody keeps (--state)");
    }

    bool take_subscription() {
        const std::uint64_t cut_off_before = publisher_.cut_off_count();
        auto change = publisher_.receive();
        if (publisher_.cut_off_count() > cut_off_before)
            log({LogLevel::warning,
                 "stream_cut_off",
                 {},
                 "more than " + std::to_string(options_.limits.topics_max) +
                     " topics were subscribed to: all subscribers of the stream were "
                     "cut off; those that mean it come back by themselves"});
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
        report_.received_bytes += byte_count(received->frames);
        const auto version = protocol::version_of(received->frames).value_or(protocol::version);
        auto message = protocol::decode(received->frames);
        if (message)
            step(PeerSaid{std::move(received->peer), std::move(*message),
                          std::move(received->holder), version});
        else
            step(PeerSpokeRubbish{std::move(received->peer), message.error(), version});
        return true;
    }

    /// Those that were dialled.
    void hear_brokers() {
        std::vector<std::string> endpoints; // what they say may change who is dialled
        for (const auto& [endpoint, broker] : dialled_)
            endpoints.push_back(endpoint);
        for (const std::string& endpoint : endpoints)
            for (int i = 0; i < messages_per_turn_max && hear_broker(endpoint); ++i) {
            }
    }

    bool hear_broker(const std::string& endpoint) {
        const auto found = dialled_.find(endpoint);
        auto frames = found == dialled_.end() ? std::nullopt : found->second.socket.receive();
        if (!frames)
            return false;
        report_.received_bytes += byte_count(*frames);
        auto& told = found->second.rubbish;
        if (auto message = protocol::decode(*frames))
            step(BrokerSaid{endpoint, std::move(*message), *protocol::version_of(*frames)});
        else if (std::exchange(told, message.error().message) != message.error().message)
            log({LogLevel::warning,
                 "rubbish",
                 {},
                 "broker " + endpoint + " is not understood: " + told});
        return true;
    }

    void dial(const std::string& endpoint) {
        if (dialled_.contains(endpoint))
            return;
        auto socket = net::DealerSocket::connect(context_, endpoint);
        if (socket)
            dialled_.emplace(endpoint, Dialled{std::move(*socket)});
        else
            log({LogLevel::error,
                 "broker_undialled",
                 {},
                 "broker " + endpoint + " cannot be called: " + socket.error().message});
    }

    void tell(const Tell& words) {
        const auto found = dialled_.find(words.endpoint);
        if (found == dialled_.end())
            return;
        auto& [socket, refusal, rubbish] = found->second;
        const protocol::Packet packet = protocol::encode(words.message);
        if (socket.send(packet) == net::SendStatus::sent) {
            report_.sent_bytes += packet_bytes(packet);
            refusal.clear();
        } else if (socket.refusal() != refusal && !socket.refusal().empty()) {
            refusal = socket.refusal();
            log({LogLevel::warning,
                 "turned_away",
                 {},
                 "broker " + words.endpoint +
                     " does not let this one in, will ask again: " + refusal});
        }
    }

    /// One event, what it leads to, and what follows from sends that fail.
    void step(const Event& event) {
        std::vector<Event> consequences;
        take_step(event, consequences);
        for (std::size_t i = 0; i < consequences.size(); ++i)
            take_step(Event(std::move(consequences[i])), consequences);
    }

    void take_step(const Event& event, std::vector<Event>& consequences) {
        actions_.clear();
        dispatcher_.step(net::now(), event, actions_);
        for (const Action& action : actions_)
            perform(action, consequences);
    }

    void perform(const Action& action, std::vector<Event>& events) {
        if (const auto* send = std::get_if<Send>(&action)) {
            const protocol::Packet packet = protocol::encode(send->message, send->version);
            if (router_.send(send->peer, packet) == net::SendStatus::sent)
                report_.sent_bytes += packet_bytes(packet);
            else
                events.push_back(PeerUnreachable{send->peer});
        } else if (const auto* dialled = std::get_if<Dial>(&action)) {
            dial(dialled->endpoint);
        } else if (const auto* gone = std::get_if<HangUp>(&action)) {
            dialled_.erase(gone->endpoint);
        } else if (const auto* words = std::get_if<Tell>(&action)) {
            tell(*words);
        } else if (const auto* publish = std::get_if<Publish>(&action)) {
            const protocol::Packet packet =
                protocol::encode(publish->message, protocol::oldest_version_spoken);
            report_.published_bytes += packet_bytes(packet);
            publisher_.publish(publish->topic, packet);
        } else if (const auto* write = std::get_if<Persist>(&action)) {
            kept_->writer.enqueue(write->write, write->sequence);
        } else if (const auto* wish = std::get_if<SendStored>(&action)) {
            send_stored(*wish, events);
        } else if (const auto* load = std::get_if<LoadScene>(&action)) {
            auto scene = kept_->reader.blob(load->scene);
            if (!scene)
                log({LogLevel::error, "scene_unread", {}, scene.error().message});
            events.push_back(
                SceneLoaded{load->job, load->peer, scene ? std::move(*scene) : std::nullopt});
        } else if (const auto* filled = std::get_if<OrderFilled>(&action)) {
            upstream_->take(*filled);
        } else if (const auto* failed = std::get_if<OrderFailed>(&action)) {
            upstream_->take(*failed);
        } else if (const auto* line = std::get_if<Log>(&action)) {
            log(*line);
        }
    }

    void send_stored(const SendStored& wish, std::vector<Event>& events) {
        for (const TileIndex tile : wish.tiles) {
            auto stored = kept_->reader.tiles(wish.job, std::span(&tile, 1));
            if (!stored) {
                log({LogLevel::error, "tile_unread", {}, stored.error().message});
                continue;
            }
            for (protocol::TileDone& done : *stored) {
                done.epoch = wish.epoch;
                perform(Send{wish.peer, std::move(done), wish.version}, events);
            }
        }
    }

    void log(LogLine line) const {
        line.text = printable(line.text); // names in it are strangers' choice
        if (options_.on_log)
            options_.on_log(line);
    }

    struct Dialled {
        net::DealerSocket socket;
        std::string refusal = {}, rubbish = {}; ///< that were logged
    };

    const net::Context& context_;
    net::RouterSocket router_;
    std::map<std::string, Dialled> dialled_; ///< other brokers, by endpoint
    net::PublisherSocket publisher_;
    std::unique_ptr<Kept> kept_;
    const net::Waker& waker_;
    const Options& options_;
    Dispatcher dispatcher_;
    std::optional<Upstream> upstream_;
    Report report_; ///< the next one
    Instant next_report_;
    Instant next_give_back_ = net::now() + give_back_interval;
    std::uint64_t keyless_untold_ = 0;
    Once keyless_told_{keyless_told_interval, 1};
    std::vector<Action> actions_;
    bool stopped_by_signal_ = false;
};

/// With the option that can mend it.
Error about(const std::string& option, Error error) {
    error.message = option + ": " + error.message;
    return error;
}

} // namespace

Result<void> run_broker(const net::Context& context, const Options& options,
                        const Control& control) {
    if (!options.allow.empty()) // before anything is bound
        if (const auto taken = admit(context, options.allow); !taken)
            return about("--allow", taken.error());
    const bool open_to_all = options.insecure || !options.allow.empty();
    const auto bind = net::endpoint_to_bind(options.bind, net::broker_port, open_to_all);
    if (!bind)
        return about("--bind", bind.error());
    const auto publish = net::endpoint_to_bind(options.publish, net::stream_port, open_to_all);
    if (!publish)
        return about("--publish", publish.error());
    const net::Waker waker;
    std::unique_ptr<Kept> kept;
    if (!options.state.empty()) {
        auto opened = open_store(options.state, waker);
        if (!opened)
            return opened.error();
        kept = std::move(*opened);
    }
    auto router = net::RouterSocket::bind(context, *bind);
    if (!router)
        return about("--bind", router.error());
    for (const std::string& worker : options.call)
        if (auto called = router->call(worker); !called)
            return called.error();
    auto publisher = net::PublisherSocket::bind(context, *publish, options.limits.topics_max);
    if (!publisher)
        return about("--publish", publisher.error());
    if (options.on_listening)
        options.on_listening(router->endpoint(), publisher->endpoint());
    Shell shell(context, std::move(*router), std::move(*publisher), std::move(kept), waker,
                options);
    if (!shell.run(control))
        return Error{ErrorCode::io,
                     options.state.string() + ": not all could be written in the end"};
    return {};
}

} // namespace fraja::broker
