#include "common/net/sockets.hpp"

#include "common/net/clock.hpp"
#include "common/net/doorman.hpp"
#include "common/net/endpoint.hpp"
#include "common/net/frames.hpp"
#include "common/net/handshakes.hpp"
#include "common/protocol/packing.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <map>
#include <mutex>
#include <utility>
#include <zmq.hpp>

namespace fraja::net {

// The figures behind these: ARCHITECTURE.md, "Socket options".
namespace {

using namespace std::chrono_literals;

constexpr int sockets_max = 16'384;
constexpr int backlog =
    4096; // the default of 100 lets 10,000 workers take half a minute to come back
constexpr int router_queue_max =
    10'000; // above any credit: ROUTER answers `full` only for peers that do not read
constexpr std::uint64_t router_unsent_bytes_max = std::uint64_t{512} << 20; // of blobs, to a peer
constexpr int dealer_queue_max = 10'000;
constexpr int stream_queue_max =
    2'000; // messages per watcher; beyond that they are dropped and repaired
constexpr std::int64_t subscriber_frame_bytes_max = 512; // a handshake with keys has some 400
/// Of all topics there may be; ours have 33. libzmq needs some 40 bytes to keep one of them.
constexpr std::size_t topic_bytes_mean_max = 64;
constexpr std::size_t callers_max = 1'000; // that wait for their turn
constexpr int unheard_max = 256; // messages that are nobody's turn, before others have theirs
constexpr auto handshake_max = 3s;
constexpr auto transport_beat = 2s;         // of whoever connects for a session
constexpr auto transport_silence_max = 30s; // generous: beats also pause during a large transfer
constexpr int keepalive_idle_s = 10, keepalive_interval_s = 5, keepalive_probes = 4;
constexpr auto reconnect_min = 100ms;
constexpr auto reconnect_max = 3s;
/// libzmq gives up who says no, and we try again, as allow-lists change. Who is not told of a
/// refusal (Telling::nothing) takes so long without a connection for one.
constexpr Duration readmission_pause = 2s, silent_readmission_pause = 15s;

int milliseconds(std::chrono::milliseconds d) {
    return static_cast<int>(d.count());
}

void set_common_options(zmq::socket_t& socket) {
    socket.set(zmq::sockopt::linger, 0);
    socket.set(zmq::sockopt::maxmsgsize, static_cast<int64_t>(protocol::packed_bytes_max));
    socket.set(zmq::sockopt::handshake_ivl, milliseconds(handshake_max));
    socket.set(zmq::sockopt::tcp_keepalive, 1);
    socket.set(zmq::sockopt::tcp_keepalive_idle, keepalive_idle_s);
    socket.set(zmq::sockopt::tcp_keepalive_intvl, keepalive_interval_s);
    socket.set(zmq::sockopt::tcp_keepalive_cnt, keepalive_probes);
    socket.set(zmq::sockopt::tcp_maxrt, milliseconds(transport_silence_max));
    socket.set(zmq::sockopt::ipv6, true);
    socket.set(zmq::sockopt::backlog, backlog);
}

/// Whoever binds sends no beats: libzmq looks through all timers of all connections for the one
/// that an answer stops. Nor does a subscriber: while its queue is full nothing is heard, libzmq
/// 4.3.4 connects again, and aborts when there is room. The kernel's probes find dead connections
/// as well.
void set_transport_beats(zmq::socket_t& socket) {
    socket.set(zmq::sockopt::heartbeat_ivl, milliseconds(transport_beat));
    socket.set(zmq::sockopt::heartbeat_timeout, milliseconds(transport_silence_max));
}

void set_options_to_connect(zmq::socket_t& socket) {
    socket.set(zmq::sockopt::reconnect_ivl, milliseconds(reconnect_min));
    socket.set(zmq::sockopt::reconnect_ivl_max, milliseconds(reconnect_max));
}

/// Binding an IPv4 address through an IPv6 socket would show it as [::ffff:...]: only where it is
/// asked for.
void set_family_for_bind(zmq::socket_t& socket, std::string_view endpoint) {
    socket.set(zmq::sockopt::ipv6, endpoint.find_first_of("[*") != std::string_view::npos);
}

const char* cure(int error) {
    return error == EADDRINUSE
               ? ". Another program has that port, perhaps a broker that runs already; choose "
                 "another port, or 0: the system's choice"
           : error == EACCES        ? ". Ports below 1024 are root's; choose another"
           : error == EADDRNOTAVAIL ? ". This machine has no such address"
                                    : "";
}

Error refused(const char* deed, const std::string& endpoint, const zmq::error_t& e) {
    const bool usage = e.num() == EINVAL || e.num() == EPROTONOSUPPORT || e.num() == ENODEV;
    return {usage                   ? ErrorCode::invalid_argument
            : e.num() == EADDRINUSE ? ErrorCode::in_use
                                    : ErrorCode::io,
            std::string("cannot ") + deed + " " + endpoint + ": " + e.what() + cure(e.num())};
}

// libzmq 4.3.4 looks names up in its I/O threads, and waits for the answer: seconds, where nobody
// knows the name. Connections to a name have a thread of that name, so that all others go on; with
// more names than threads some share one.
constexpr std::size_t name_threads = 8;
constexpr std::uint64_t thread_of_numbers = 1; // a mask

/// Empty: it is a number, or no host.
std::string host_name(const std::string& endpoint) {
    const auto parsed = parse_endpoint(endpoint, broker_port);
    if (!parsed || parsed->transport != Endpoint::Transport::tcp)
        return {};
    std::string host = without_brackets(parsed->host);
    in6_addr address{};
    const bool is_number =
        inet_pton(AF_INET, host.c_str(), &address) == 1 ||
        inet_pton(AF_INET6, host.substr(0, host.find('%')).c_str(), &address) == 1;
    return is_number ? std::string() : host;
}

void set_linger_of(zmq::socket_t& socket, Duration linger) {
    socket.set(zmq::sockopt::linger,
               milliseconds(std::chrono::ceil<std::chrono::milliseconds>(linger)));
}

} // namespace

struct Context::Impl {
    zmq::context_t context;
    std::optional<Keys> keys;
    std::mutex mutex;
    std::shared_ptr<Doorman> doorman; // guarded by it
    std::atomic<std::uint64_t> keyless_count = 0;
    std::map<std::string, std::uint64_t> threads_of_names; // masks, guarded by it

    explicit Impl(std::optional<Keys> own) : keys(std::move(own)) {}
    ~Impl() { context.shutdown(); } // so that the doorman ends
    [[nodiscard]] std::shared_ptr<Doorman> the_doorman() {
        const std::lock_guard lock(mutex);
        return doorman;
    }
    [[nodiscard]] std::uint64_t thread_for(const std::string& endpoint) {
        const std::string name = host_name(endpoint);
        if (name.empty())
            return thread_of_numbers;
        const std::lock_guard lock(mutex);
        const std::size_t next = threads_of_names.size() % name_threads;
        return threads_of_names.try_emplace(name, thread_of_numbers << (1 + next)).first->second;
    }
};

Context::Context(std::optional<Keys> keys) : impl_(std::make_unique<Impl>(std::move(keys))) {
    impl_->context.set(zmq::ctxopt::max_sockets, sockets_max);
    impl_->context.set(zmq::ctxopt::io_threads, static_cast<int>(1 + name_threads));
    impl_->context.set(zmq::ctxopt::blocky, false);
}
Context::~Context() = default;
Context::Context(Context&&) noexcept = default;
Context& Context::operator=(Context&&) noexcept = default;

const PublicKey* Context::farm() const {
    return impl_->keys ? &impl_->keys->broker : nullptr;
}

Result<void> Context::admit(AllowList list) const {
    FRAJA_ASSERT(impl_->keys);
    list.add_brokers(impl_->keys->own.public_key);
    const std::lock_guard lock(impl_->mutex);
    if (impl_->doorman) {
        impl_->doorman->replace(std::move(list));
        return {};
    }
    try {
        impl_->doorman = std::make_shared<Doorman>(impl_->context, std::move(list));
        return {};
    } catch (const zmq::error_t& e) {
        return Error{ErrorCode::io, std::string("cannot look at keys: ") + e.what()};
    }
}

std::shared_ptr<const AllowList> Context::admitted() const {
    const auto doorman = impl_->the_doorman();
    return doorman ? doorman->list() : nullptr;
}

std::uint64_t Context::refused_count() const {
    const auto doorman = impl_->the_doorman();
    return doorman ? doorman->refused_count() : 0;
}

std::uint64_t Context::keyless_count() const {
    return impl_->keyless_count;
}

std::vector<Stranger> Context::take_strangers() const {
    const auto doorman = impl_->the_doorman();
    return doorman ? doorman->take_strangers() : std::vector<Stranger>();
}

struct SocketImpl {
    zmq::socket_t socket;
    // Of one that is bound:
    std::optional<Keyless> keyless = {};
    // Of a DealerSocket:
    std::string endpoint = {};
    std::optional<Handshakes> handshakes = {};
    std::optional<Instant> unsent_since = {};
};

namespace {

void connect_to(zmq::socket_t& socket, const Context& context, const std::string& endpoint) {
    socket.set(zmq::sockopt::affinity, context.impl().thread_for(endpoint));
    socket.connect(endpoint);
}

std::unique_ptr<SocketImpl> open(const Context& context, zmq::socket_type type) {
    auto impl = std::make_unique<SocketImpl>(
        SocketImpl{zmq::socket_t(context.impl().context, type)}); // Clang 14 wants the braces
    set_common_options(impl->socket);
    impl->socket.set(zmq::sockopt::affinity, thread_of_numbers);
    return impl;
}

/// Of a socket that binds, before it does.
void set_server_keys(SocketImpl& impl, const Context& context, const char* door) {
    if (!context.admitted())
        return;
    zmq::socket_t& socket = impl.socket;
    impl.keyless.emplace(context.impl().context, socket, context.impl().keyless_count);
    socket.set(zmq::sockopt::curve_server, true);
    socket.set(zmq::sockopt::curve_secretkey, context.impl().keys->own.secret.text());
    socket.set(zmq::sockopt::zap_domain, door);
}

void look_for_keyless(SocketImpl& impl) {
    if (impl.keyless)
        impl.keyless->look();
}

/// Of a socket that connects, before it does. What does not leave the process is not encrypted.
void set_client_keys(zmq::socket_t& socket, const Context& context, std::string_view endpoint) {
    const auto& keys = context.impl().keys;
    if (!keys || endpoint.starts_with("inproc:"))
        return;
    socket.set(zmq::sockopt::curve_serverkey, keys->broker.text);
    socket.set(zmq::sockopt::curve_publickey, keys->own.public_key.text);
    socket.set(zmq::sockopt::curve_secretkey, keys->own.secret.text());
}

} // namespace

Socket::Socket(std::unique_ptr<SocketImpl> impl) : impl_(std::move(impl)) {}
Socket::Socket(Socket&&) noexcept = default;
Socket& Socket::operator=(Socket&&) noexcept = default;
Socket::~Socket() = default;
void* Socket::handle() const {
    return impl_->socket.handle();
}
int Socket::event_fd() const {
    return impl_->socket.get(zmq::sockopt::fd);
}
bool Socket::readable() const {
    for (;;) {
        try {
            return (impl_->socket.get(zmq::sockopt::events) & ZMQ_POLLIN) != 0;
        } catch (const zmq::error_t& e) {
            if (e.num() != EINTR)
                throw;
        }
    }
}

// ----------------------------------------------------------------------------------------- ROUTER

namespace {

Result<std::unique_ptr<SocketImpl>> bind_router(const Context& context, const std::string& endpoint,
                                                const char* door) {
    try {
        auto router = open(context, zmq::socket_type::router);
        router->socket.set(zmq::sockopt::router_mandatory, true);
        router->socket.set(zmq::sockopt::sndhwm, router_queue_max);
        router->socket.set(zmq::sockopt::rcvhwm, router_queue_max);
        set_server_keys(*router, context, door);
        set_family_for_bind(router->socket, endpoint);
        router->socket.bind(endpoint);
        return router;
    } catch (const zmq::error_t& e) {
        return refused("listen at", endpoint, e);
    }
}

/// `doorman` may be null.
std::optional<RoutedMessage> take_routed(zmq::socket_t& socket, const Doorman* doorman) {
    zmq::message_t id;
    if (!take(socket, id))
        return std::nullopt;
    zmq::message_t first = take_next(socket);
    // libzmq 4.3.4 may have lost what it knows of the connection at the id frame.
    auto holder = doorman ? doorman->holder(first.gets("User-Id")) : nullptr;
    return RoutedMessage{id.to_string(), take_frames(socket, std::move(first)), std::move(holder)};
}

} // namespace

RouterSocket::RouterSocket(std::unique_ptr<SocketImpl> impl, const Context& context)
    : Socket(std::move(impl)), context_(&context), doorman_(context.impl().the_doorman()),
      unsent_(router_unsent_bytes_max) {}

Result<RouterSocket> RouterSocket::bind(const Context& context, const std::string& endpoint) {
    auto router = bind_router(context, endpoint, session_door);
    if (!router)
        return router.error();
    RouterSocket socket(std::move(*router), context);
    socket.bound_ = socket.impl_->socket.get(zmq::sockopt::last_endpoint);
    return socket;
}

std::optional<RoutedMessage> RouterSocket::receive() {
    auto message = take_routed(impl_->socket, doorman_.get());
    while (calls_ && message && is_probe(message->frames)) // of those whom we have called ourselves
        message = take_routed(impl_->socket, doorman_.get());
    if (!message)
        look_for_keyless(*impl_);
    return message;
}

SendStatus RouterSocket::send(const PeerId& peer, const protocol::Packet& packet) {
    if (packet.blobs.empty())
        return send_packet(impl_->socket, peer, packet);
    const auto lent = unsent_.lend(peer, protocol::packed(packet));
    return lent ? send_packed(impl_->socket, peer, *lent) : SendStatus::full;
}

Result<void> RouterSocket::call(const std::string& endpoint) {
    try {
        zmq::socket_t& socket = impl_->socket;
        socket.set(zmq::sockopt::ipv6, true);
        socket.set(zmq::sockopt::probe_router, true);
        socket.set(zmq::sockopt::immediate, true); // a probe for each connection, not for the first
        set_transport_beats(socket);
        set_options_to_connect(socket);
        set_client_keys(socket, *context_, endpoint);
        connect_to(socket, *context_, endpoint);
        calls_ = true;
        return {};
    } catch (const zmq::error_t& e) {
        return refused("call", endpoint, e);
    }
}

// --------------------------------------------------------------------------------- ROUTER, called

CalleeSocket::CalleeSocket(std::unique_ptr<SocketImpl> impl, const Context& context)
    : Socket(std::move(impl)), doorman_(context.impl().the_doorman()) {}

Result<CalleeSocket> CalleeSocket::bind(const Context& context, const std::string& endpoint) {
    auto router = bind_router(context, endpoint, call_door);
    if (!router)
        return router.error();
    return CalleeSocket(std::move(*router), context);
}

std::string CalleeSocket::endpoint() const {
    return impl_->socket.get(zmq::sockopt::last_endpoint);
}

std::optional<Frames> CalleeSocket::receive() {
    for (int i = 0; i < unheard_max; ++i) {
        auto message = take_routed(impl_->socket, doorman_.get());
        if (!message) {
            look_for_keyless(*impl_);
            return std::nullopt;
        }
        if (message->holder && !message->holder->roles.has_any(protocol::caller_roles)) {
            std::erase(waiting_, message->peer);
            if (caller_ != 0 && message->peer == peer_)
                pass_on();
        } else if (is_probe(message->frames))
            note_call(std::move(message->peer));
        else if (caller_ != 0 && message->peer == peer_)
            return std::move(message->frames);
    }
    return std::nullopt;
}

SendStatus CalleeSocket::send(const protocol::Packet& packet) {
    if (caller_ == 0)
        return SendStatus::full;
    const SendStatus status = send_packet(impl_->socket, peer_, packet);
    if (status == SendStatus::unreachable)
        pass_on();
    return status;
}

void CalleeSocket::hang_up(bool for_good) {
    if (caller_ == 0)
        return;
    if (!for_good)
        waiting_.push_back(std::move(peer_));
    pass_on();
}

void CalleeSocket::set_linger(Duration linger) {
    set_linger_of(impl_->socket, linger);
}

/// A caller that has gone shows only when something is sent to it. So whoever calls has it looked
/// for: the turn passes on at once.
void CalleeSocket::note_call(PeerId peer) {
    if ((caller_ != 0 && peer == peer_) || std::ranges::find(waiting_, peer) != waiting_.end())
        return;
    if (waiting_.size() >= callers_max)
        std::erase_if(waiting_, [&](const PeerId& other) { return !is_there(other); });
    if (waiting_.size() < callers_max)
        waiting_.push_back(std::move(peer));
    if (caller_ == 0 || !is_there(peer_))
        pass_on();
}

bool CalleeSocket::is_there(const PeerId& peer) {
    return send_probe(impl_->socket, peer) != SendStatus::unreachable;
}

void CalleeSocket::pass_on() {
    caller_ = 0;
    while (caller_ == 0 && !waiting_.empty()) {
        peer_ = std::move(waiting_.front());
        waiting_.pop_front();
        if (is_there(peer_))
            caller_ = ++callers_so_far_;
    }
}

// ----------------------------------------------------------------------------------------- DEALER

Result<DealerSocket> DealerSocket::connect(const Context& context, const std::string& endpoint,
                                           Telling telling) {
    try {
        DealerSocket dealer(open(context, zmq::socket_type::dealer));
        dealer.impl_->socket.set(zmq::sockopt::immediate, true); // queue for connections that stand
        dealer.impl_->socket.set(zmq::sockopt::sndhwm, dealer_queue_max);
        dealer.impl_->socket.set(zmq::sockopt::rcvhwm, 0); // what comes was asked for
        set_transport_beats(dealer.impl_->socket);
        set_options_to_connect(dealer.impl_->socket);
        set_client_keys(dealer.impl_->socket, context, endpoint);
        if (telling == Telling::refusals && !endpoint.starts_with("inproc:"))
            dealer.impl_->handshakes.emplace(context.impl().context, dealer.impl_->socket,
                                             context.impl().keys.has_value());
        dealer.impl_->endpoint = endpoint;
        connect_to(dealer.impl_->socket, context, endpoint);
        return dealer;
    } catch (const zmq::error_t& e) {
        return refused("connect to", endpoint, e);
    }
}

std::optional<Frames> DealerSocket::receive() {
    zmq::message_t first;
    if (!take(impl_->socket, first))
        return std::nullopt;
    // A broker that calls workers greets whoever connects to it in the same way, once.
    if (first.size() == 0 && !first.more() && !take(impl_->socket, first))
        return std::nullopt;
    return take_frames(impl_->socket, std::move(first));
}

namespace {

void connect_anew(SocketImpl& dealer) {
    try {
        dealer.socket.disconnect(dealer.endpoint);
    } catch (const zmq::error_t& e) {
        if (e.num() != ENOENT)
            throw;
    }
    dealer.socket.connect(dealer.endpoint); // by the same thread
}

void look_for_refusal(SocketImpl& dealer) {
    const Instant now = net::now();
    auto& handshakes = dealer.handshakes;
    if (handshakes)
        handshakes->look();
    if (handshakes && !handshakes->is_over()) {
        dealer.unsent_since.reset();
    } else if (!dealer.unsent_since) {
        dealer.unsent_since = now;
    } else if (now - *dealer.unsent_since >=
               (handshakes ? readmission_pause : silent_readmission_pause)) {
        dealer.unsent_since.reset();
        if (handshakes)
            handshakes->begin_anew();
        connect_anew(dealer);
    }
}

} // namespace

SendStatus DealerSocket::send(const protocol::Packet& packet) {
    const SendStatus status = send_packet(impl_->socket, std::nullopt, packet);
    if (impl_->endpoint.starts_with("inproc:"))
        return status;
    if (status != SendStatus::sent) {
        look_for_refusal(*impl_);
    } else {
        impl_->unsent_since.reset();
        if (impl_->handshakes)
            impl_->handshakes->forget();
    }
    return status;
}

const std::string& DealerSocket::refusal() const {
    static const std::string none;
    return impl_->handshakes ? impl_->handshakes->why() : none;
}

void DealerSocket::set_linger(Duration linger) {
    set_linger_of(impl_->socket, linger);
}

// ----------------------------------------------------------------------------------- XPUB and SUB

namespace {

std::unique_ptr<SocketImpl> open_publisher(const Context& context) {
    auto publisher = open(context, zmq::socket_type::xpub);
    publisher->socket.set(zmq::sockopt::sndhwm, stream_queue_max);
    publisher->socket.set(zmq::sockopt::rcvhwm, router_queue_max);
    publisher->socket.set(zmq::sockopt::maxmsgsize, subscriber_frame_bytes_max);
    set_server_keys(*publisher, context, stream_door);
    return publisher;
}

void bind_publisher(zmq::socket_t& socket, const std::string& endpoint) {
    set_family_for_bind(socket, endpoint);
    socket.bind(endpoint);
}

/// A change of subscriptions; nothing: somebody has said something else.
std::optional<SubscriptionChange> change_of(const zmq::message_t& frame) {
    const std::string_view text = frame.to_string_view();
    if (text.empty() || (text[0] != 0 && text[0] != 1))
        return std::nullopt;
    return SubscriptionChange{std::string(text.substr(1)), text[0] == 1};
}

} // namespace

PublisherSocket::PublisherSocket(std::unique_ptr<SocketImpl> impl, const Context& context,
                                 std::size_t topics_max)
    : Socket(std::move(impl)), context_(&context),
      bound_(impl_->socket.get(zmq::sockopt::last_endpoint)), topics_max_(topics_max) {}

Result<PublisherSocket> PublisherSocket::bind(const Context& context, const std::string& endpoint,
                                              std::size_t topics_max) {
    try {
        auto publisher = open_publisher(context);
        bind_publisher(publisher->socket, endpoint);
        return PublisherSocket(std::move(publisher), context, topics_max);
    } catch (const zmq::error_t& e) {
        return refused("publish at", endpoint, e);
    }
}

std::optional<SubscriptionChange> PublisherSocket::receive() {
    zmq::message_t frame;
    while (unsubscribed_.empty() && is_bound_again() && take(impl_->socket, frame)) {
        if (frame.more()) {
            (void)take_rest(impl_->socket, true);
            continue;
        }
        auto change = change_of(frame);
        if (!change)
            continue;
        if (change->subscribed && topics_.insert(change->topic).second)
            topic_bytes_ += change->topic.size();
        else if (!change->subscribed && topics_.erase(change->topic) > 0)
            topic_bytes_ -= change->topic.size();
        if (topics_.size() <= topics_max_ && topic_bytes_ <= topics_max_ * topic_bytes_mean_max)
            return change;
        topics_.erase(change->topic); // nobody has been told of it
        cut_off_all();
    }
    if (unsubscribed_.empty()) {
        look_for_keyless(*impl_);
        return std::nullopt;
    }
    SubscriptionChange gone{std::move(unsubscribed_.back()), false};
    unsubscribed_.pop_back();
    return gone;
}

void PublisherSocket::cut_off_all() {
    unsubscribed_.assign(topics_.begin(), topics_.end());
    topics_.clear();
    topic_bytes_ = 0;
    impl_ = open_publisher(*context_);
    is_bound_ = false;
    ++cut_off_count_;
}

/// The old socket lets go of its port in a thread of libzmq's: until then it is tried again.
bool PublisherSocket::is_bound_again() {
    if (is_bound_)
        return true;
    try {
        bind_publisher(impl_->socket, bound_);
        is_bound_ = true;
    } catch (const zmq::error_t& e) {
        if (e.num() != EADDRINUSE)
            throw;
    }
    return is_bound_;
}

void PublisherSocket::publish(std::string_view topic, const protocol::Packet& packet) {
    publish_packet(impl_->socket, topic, packet);
}

Result<SubscriberSocket> SubscriberSocket::connect(const Context& context,
                                                   const std::string& endpoint) {
    try {
        SubscriberSocket subscriber(open(context, zmq::socket_type::sub));
        subscriber.impl_->socket.set(zmq::sockopt::rcvhwm, stream_queue_max);
        set_options_to_connect(subscriber.impl_->socket);
        set_client_keys(subscriber.impl_->socket, context, endpoint);
        connect_to(subscriber.impl_->socket, context, endpoint);
        return subscriber;
    } catch (const zmq::error_t& e) {
        return refused("subscribe at", endpoint, e);
    }
}

void SubscriberSocket::subscribe(std::string_view topic) {
    impl_->socket.set(zmq::sockopt::subscribe, topic);
}

void SubscriberSocket::unsubscribe(std::string_view topic) {
    impl_->socket.set(zmq::sockopt::unsubscribe, topic);
}

std::optional<PublishedMessage> SubscriberSocket::receive() {
    zmq::message_t topic;
    if (!take(impl_->socket, topic))
        return std::nullopt;
    return PublishedMessage{topic.to_string(), take_rest(impl_->socket, topic.more())};
}

// ---------------------------------------------------------------------------------------- waiting

void wait(const std::vector<Waitable>& waitables, Duration timeout) {
    std::vector<zmq::pollitem_t> items;
    items.reserve(waitables.size());
    for (const Waitable& w : waitables)
        items.push_back(
            {w.socket, w.fd, static_cast<short>(w.to_write ? ZMQ_POLLOUT : ZMQ_POLLIN), 0});
    // Rounded up, so that a deadline has passed when the wait is over; at most a minute, so that it
    // fits.
    const auto bounded = std::clamp<Duration>(timeout, Duration::zero(), 1min);
    try {
        zmq::poll(items, std::chrono::ceil<std::chrono::milliseconds>(bounded));
    } catch (const zmq::error_t& e) {
        if (e.num() != EINTR)
            throw;
    }
}

void wait(std::initializer_list<Waitable> waitables, Duration timeout) {
    wait(std::vector<Waitable>(waitables), timeout);
}

} // namespace fraja::net
