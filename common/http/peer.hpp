// Peer: one who is connected to a server: what is waited for, and for how long.
#pragma once

#include "common/http/exchange.hpp"

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>

namespace fraja::http {

/// Where a peer is. Those before `answering` keep the server waiting, and may be given up for
/// others, in this order.
enum class Stage : std::uint8_t {
    over,      ///< closed by the other end, or given up
    leaving,   ///< has all that it gets; to be closed by the other end
    idle,      ///< no byte of a request is there
    asking,    ///< some are
    sending,   ///< an answer is on its way
    answering, ///< a request is whole, and its reply is not there yet
    streaming, ///< has lines without end
};

/// Never waits: its owner polls, and hands in the time. Owns the socket.
class Peer {
public:
    /// What is referred to must outlive it. The socket does not block.
    Peer(int fd, const Limits& limits, const Refusals& refusals, Instant now);
    ~Peer();
    Peer(const Peer&) = delete;
    Peer& operator=(const Peer&) = delete;

    [[nodiscard]] Stage stage() const { return stage_; }
    /// Since when it keeps the server waiting, where it does.
    [[nodiscard]] Instant since() const { return since_; }
    [[nodiscard]] int fd() const { return fd_; }
    /// What it is to be polled for; 0: not at all.
    [[nodiscard]] short events() const;
    /// When to call expire().
    [[nodiscard]] Instant deadline() const;

    /// The socket is ready for some of events(), or in trouble.
    void ready(short events, Instant now);
    void expire(Instant now);
    /// Gives it up.
    void end(Instant now);
    /// A request that is whole; it then waits for its reply.
    [[nodiscard]] std::optional<std::string> take_request();
    /// One without a head ends it.
    void reply(Reply reply, Instant now);
    /// Is to be sent lines, or is already.
    [[nodiscard]] bool has_lines() const { return lines_ != nullptr; }
    /// Where lines are sent, and those before are taken: where they come from. Else null.
    [[nodiscard]] std::shared_ptr<LineSource> wants_lines() const;
    void lines(std::string text, Instant now);

private:
    void enter(Stage stage, Instant now);
    void receive(Instant now);
    void look_for_request(Instant now);
    void send(Instant now);
    void all_sent(Instant now);
    /// Sent, and not yet at the other end.
    [[nodiscard]] int under_way_bytes() const;

    const int fd_;
    const Limits& limits_;
    const Refusals& refusals_;
    Stage stage_ = Stage::idle;
    Instant since_;
    std::string received_;              ///< and in no request yet
    std::string request_;               ///< whole, to be taken; else empty
    std::deque<Body> unsent_;           ///< none is empty
    std::size_t sent_bytes_ = 0;        ///< of the first of them
    int under_way_bytes_ = 0;           ///< when the last of them were sent, or since
    bool keeps_ = false;                ///< the connection, when all is sent
    std::shared_ptr<LineSource> lines_; ///< to be sent when the head is
};

} // namespace fraja::http
