// The sockets: with frames.hpp, keys, doorman and handshakes, the only code that knows ZeroMQ.
// Options and their reasons are those of ARCHITECTURE.md.
//
// A socket belongs to one thread at a time. Nothing here blocks but `wait`.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/instant.hpp"
#include "common/base/result.hpp"
#include "common/net/allow_list.hpp"
#include "common/net/keys.hpp"
#include "common/net/unsent.hpp"
#include "common/protocol/codec.hpp"

#include <cstdint>
#include <deque>
#include <initializer_list>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::net {

/// Whose key was refused.
struct Stranger {
    std::string key; ///< Z85
    std::string address;
    std::string why; ///< for people
};

/// Owns the I/O thread; outlives its sockets. Peers in one process meet through one context
/// (inproc). May be shared between threads.
class Context {
public:
    /// With keys what leaves this process is encrypted, and goes to nobody but Keys::broker.
    explicit Context(std::optional<Keys> keys = {});
    ~Context();
    Context(Context&&) noexcept;
    Context& operator=(Context&&) noexcept;

    /// Of whom we connect to. Null: there are no keys.
    [[nodiscard]] const PublicKey* farm() const;

    /// From now on whoever connects to a socket that is bound (but for inproc) shows a key of the
    /// list, or the own one, which other brokers of the farm have. Called again it replaces the
    /// list: what RouterSocket says of senders follows at once, connections that stand are not
    /// ended. Call it first before anything is bound, and with keys. Errors: io.
    [[nodiscard]] Result<void> admit(AllowList list) const;
    /// Null: everybody may come in.
    [[nodiscard]] std::shared_ptr<const AllowList> admitted() const;
    /// Handshakes that were refused over a key, so far.
    [[nodiscard]] std::uint64_t refused_count() const;
    /// Handshakes that ended before a key was shown, so far: of peers that have none, know another
    /// farm's, or speak something else.
    [[nodiscard]] std::uint64_t keyless_count() const;
    /// Of these since the last time, each key once in a while, and no more than a log bears.
    [[nodiscard]] std::vector<Stranger> take_strangers() const;

    struct Impl;
    [[nodiscard]] Impl& impl() const { return *impl_; }

private:
    std::unique_ptr<Impl> impl_;
};

/// The frames of a message without its envelope. At most message_frames_max + 1 are kept; decode()
/// refuses more.
using Frames = std::vector<Blob>;

/// A connection, as the ROUTER names it. It changes with every reconnect.
using PeerId = std::string;

enum class SendStatus : std::uint8_t {
    sent,        ///< handed to ZeroMQ; it may still be lost
    unreachable, ///< no such connection (any more)
    full,        ///< the peer does not read; nothing was queued
};

struct SocketImpl;

/// What the sockets share: ownership and being waited for.
class Socket {
public:
    Socket(Socket&&) noexcept;
    Socket& operator=(Socket&&) noexcept;
    ~Socket();
    [[nodiscard]] void* handle() const; ///< for `wait`
    // For Poller.
    /// Becomes readable when `readable` may have become true, unless a call has found that already.
    [[nodiscard]] int event_fd() const;
    [[nodiscard]] bool readable() const;

protected:
    explicit Socket(std::unique_ptr<SocketImpl> impl);
    std::unique_ptr<SocketImpl> impl_;
};

struct RoutedMessage {
    PeerId peer;
    Frames frames;
    /// Whose key the connection showed, as the list has it now. Null: there are no keys here.
    AllowList::Holder holder;
};
class Doorman;

/// The broker's side of every session.
class RouterSocket : public Socket {
public:
    /// Errors: invalid_argument, io (the port is taken, no permission), with the endpoint and the
    /// reason.
    [[nodiscard]] static Result<RouterSocket> bind(const Context& context,
                                                   const std::string& endpoint);
    /// Where it is really bound: port 0 is replaced.
    [[nodiscard]] const std::string& endpoint() const { return bound_; }
    [[nodiscard]] std::optional<RoutedMessage> receive();
    /// `full` also when too many bytes wait for it.
    SendStatus send(const PeerId& peer, const protocol::Packet& packet);
    /// Besides, connects to a CalleeSocket; again and again, as a DealerSocket does. It is a peer
    /// when it has said something. The context stays where it is.
    [[nodiscard]] Result<void> call(const std::string& endpoint);

private:
    RouterSocket(std::unique_ptr<SocketImpl> impl, const Context& context);
    const Context* context_;
    std::string bound_;
    std::shared_ptr<const Doorman> doorman_; // null: there are no keys
    Unsent unsent_;
    bool calls_ = false;
};

/// A worker's side where brokers connect to it: the broker's RouterSocket calls. One caller is
/// served at a time, for as long as it is there; others wait for their turn, in the order in which
/// they called, and are not heard meanwhile. Nor is who has lost the right to call.
class CalleeSocket : public Socket {
public:
    /// Errors: as RouterSocket::bind.
    [[nodiscard]] static Result<CalleeSocket> bind(const Context& context,
                                                   const std::string& endpoint);
    /// Where it is really bound: port 0 is replaced.
    [[nodiscard]] std::string endpoint() const;
    /// Whose turn it is: each has a number of its own. 0: nobody calls. Another caller's turn may
    /// come in any of the calls below.
    [[nodiscard]] std::uint64_t caller() const { return caller_; }
    /// From the caller; it may also be none though there is more to receive: wait, and try again.
    [[nodiscard]] std::optional<Frames> receive();
    /// To the caller. `unreachable`: it is gone, and the turn has passed on. `full` also when
    /// nobody calls.
    SendStatus send(const protocol::Packet& packet);
    /// It is the next caller's turn, though this one may still be there: it has another turn after
    /// all who wait (at once, if nobody does), or, `for_good`, none.
    void hang_up(bool for_good);
    /// As DealerSocket's.
    void set_linger(Duration linger);

private:
    CalleeSocket(std::unique_ptr<SocketImpl> impl, const Context& context);
    void note_call(PeerId peer);
    [[nodiscard]] bool is_there(const PeerId& peer);
    void pass_on();

    std::shared_ptr<const Doorman> doorman_; // null: there are no keys
    PeerId peer_;                            // of caller_
    std::uint64_t caller_ = 0, callers_so_far_ = 0;
    std::deque<PeerId> waiting_;
};

/// A worker's or client's side. It reconnects by itself, for ever, with back-off, as long as
/// somebody tries to send: also where it was refused.
class DealerSocket : public Socket {
public:
    /// Whether refusal() is known, which takes two more sockets.
    enum class Telling : bool { nothing, refusals };
    [[nodiscard]] static Result<DealerSocket> connect(const Context& context,
                                                      const std::string& endpoint,
                                                      Telling telling = Telling::refusals);
    [[nodiscard]] std::optional<Frames> receive();
    /// `full` also when there is no connection at the moment.
    SendStatus send(const protocol::Packet& packet);
    /// Why whoever listens there does not let us in, for people: keys that do not fit. Found out
    /// when nothing could be sent; empty: nothing is known of that.
    [[nodiscard]] const std::string& refusal() const;
    /// How long destruction waits for what was sent: zero unless a Goodbye is worth a moment.
    void set_linger(Duration linger);

private:
    using Socket::Socket;
};

struct SubscriptionChange {
    std::string topic;
    bool subscribed = false; ///< the first subscriber came; false: the last one left
};

/// The broker's side of the stream. libzmq keeps every topic that anybody subscribes to, and does
/// not tell who it was: so when there are more than `topics_max`, or longer ones than so many
/// should be, all subscribers are cut off, and their topics are unsubscribed. Whoever means it
/// comes back and subscribes anew.
class PublisherSocket : public Socket {
public:
    /// Errors: as RouterSocket::bind. The context stays where it is.
    [[nodiscard]] static Result<PublisherSocket>
    bind(const Context& context, const std::string& endpoint, std::size_t topics_max);
    /// Where it is really bound: port 0 is replaced.
    [[nodiscard]] const std::string& endpoint() const { return bound_; }
    [[nodiscard]] std::optional<SubscriptionChange> receive();
    /// Never waits: subscribers that are too slow lose the message.
    void publish(std::string_view topic, const protocol::Packet& packet);
    /// Whoever still may comes back.
    void cut_off_all();
    /// How often all were cut off.
    [[nodiscard]] std::uint64_t cut_off_count() const { return cut_off_count_; }

private:
    PublisherSocket(std::unique_ptr<SocketImpl> impl, const Context& context,
                    std::size_t topics_max);
    [[nodiscard]] bool is_bound_again();

    const Context* context_;
    std::string bound_;
    std::size_t topics_max_, topic_bytes_ = 0;
    std::set<std::string> topics_;          ///< that have a subscriber
    std::vector<std::string> unsubscribed_; ///< of those who were cut off, to be told
    bool is_bound_ = true;                  ///< not until its port is free again
    std::uint64_t cut_off_count_ = 0;
};

struct PublishedMessage {
    std::string topic;
    Frames frames;
};

/// A watcher's side of the stream.
class SubscriberSocket : public Socket {
public:
    [[nodiscard]] static Result<SubscriberSocket> connect(const Context& context,
                                                          const std::string& endpoint);
    void subscribe(std::string_view topic);
    void unsubscribe(std::string_view topic);
    [[nodiscard]] std::optional<PublishedMessage> receive();

private:
    using Socket::Socket;
};

/// Something to wait for: a socket, or a file descriptor that becomes readable, or writable.
struct Waitable {
    void* socket = nullptr;
    int fd = -1;
    bool to_write = false;
    Waitable(const Socket& s) : socket(s.handle()) {}
    Waitable(int file_descriptor) : fd(file_descriptor) {}
    [[nodiscard]] static Waitable writable(int file_descriptor) {
        Waitable w(file_descriptor);
        w.to_write = true;
        return w;
    }
};

/// Returns when one of them has something to receive or room to write, or after `timeout`;
/// sometimes early. Receive from all of them until they are empty before waiting again.
void wait(std::initializer_list<Waitable> waitables, Duration timeout);
void wait(const std::vector<Waitable>& waitables, Duration timeout);

} // namespace fraja::net
