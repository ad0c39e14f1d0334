// Wire: a line to a broker, or to those that call one after the other, with what waits to leave on
// it.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/log_line.hpp"
#include "common/net/sockets.hpp"
#include "common/protocol/codec.hpp"
#include "worker/session.hpp"

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <variant>

namespace fraja::worker {

/// Of one wire, so that a flood does not keep the others waiting.
inline constexpr int wire_events_per_round = 256;

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
    /// As DealerSocket's.
    [[nodiscard]] const std::string& refusal() const {
        static const std::string none;
        const auto* dealer = std::get_if<net::DealerSocket>(&socket_);
        return dealer ? dealer->refusal() : none;
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

/// Used by one thread, whose loop it never blocks.
class Wire {
public:
    using OnLog = std::function<void(const LogLine&)>;

    /// `title`: in the log. `on_log`, which may be empty, must outlive this.
    Wire(std::string title, const OnLog& on_log, Line line);

    /// The session's next event, if one is here: what the broker has said, that the caller is
    /// another one, who shall be greeted, or that the broker does not let us in.
    [[nodiscard]] std::optional<Event> receive();
    /// Of these, all but what was said. To be asked after whatever was done with this.
    [[nodiscard]] std::optional<Event> heed_line();
    /// False: there is nobody to be greeted.
    [[nodiscard]] bool has_caller() const { return caller_ != 0; }

    /// It leaves with the next flush().
    void post(const Send& send);
    /// What cannot leave is tried again, when it is time for that.
    void flush();
    void flush_if_due(Instant now);
    void hang_up(HangUp action) { line_.hang_up(action.for_good); }
    void log(Log line);
    [[nodiscard]] Instant next_deadline() const { return resend_at_; }

    /// Nothing more is posted.
    void begin_farewell(Instant now) { farewell_by_ = now + farewell_max; }
    /// Likewise, and all has left, or has taken too long.
    [[nodiscard]] bool is_over(Instant now) const {
        return farewell_by_ && (outbox_.empty() || now >= *farewell_by_);
    }
    /// When that is at the latest.
    [[nodiscard]] Instant farewell_deadline() const {
        return farewell_by_.value_or(Instant::never());
    }

    [[nodiscard]] const net::Socket& socket() const { return line_.socket(); }

private:
    /// For the last answers and the Goodbye to leave.
    static constexpr Duration farewell_max = std::chrono::seconds(1);

    void look_at_line();

    std::string title_;
    const OnLog& on_log_;
    Line line_;
    std::uint64_t caller_; // whom the session speaks to
    std::string refusal_;  // that the session has been told
    std::deque<Event> of_line_;
    std::optional<net::Frames> received_; // behind these
    std::deque<protocol::Packet> outbox_;
    Instant resend_at_ = Instant::never();
    Duration resend_pause_;
    std::optional<Instant> farewell_by_;
};

} // namespace fraja::worker
