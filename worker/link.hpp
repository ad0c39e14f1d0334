// Link: a session on its socket, with what waits to leave.
#pragma once

#include "common/base/instant.hpp"
#include "common/net/sockets.hpp"
#include "worker/pool.hpp"
#include "worker/session.hpp"

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace fraja::worker {

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
    [[nodiscard]] std::string refusal() const {
        const auto* dealer = std::get_if<net::DealerSocket>(&socket_);
        return dealer ? dealer->refusal() : std::string();
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

/// One broker, or those that call one after the other. Used by one thread, whose loop it never
/// blocks.
class Link {
public:
    struct Who {
        SessionIndex index{};
        std::string title; ///< in the log
    };
    using OnLog = std::function<void(const LogLine&)>;

    /// `on_log`, which may be empty, and `pool` must outlive this.
    Link(Who who, const OnLog& on_log, Line line, Session session, Pool& pool);

    void step(const Event& event);
    /// As much as there is, but for a flood.
    void receive_some();
    void keep_time(Instant now);
    [[nodiscard]] Instant next_deadline() const;

    [[nodiscard]] std::optional<FinishReason> finished() const { return finished_; }
    /// Nothing is left to do, or it has taken too long.
    [[nodiscard]] bool over(Instant now) const;
    [[nodiscard]] const net::Socket& socket() const { return line_.socket(); }

private:
    void step_session(const Event& event);
    void heed_caller();
    void perform(Send action);
    void perform(CompileScene action) { pool_.perform(who_.index, std::move(action)); }
    void perform(StartTile action) { pool_.perform(who_.index, action); }
    void perform(StopTile action) { pool_.perform(who_.index, action); }
    void perform(ForgetScene action) { pool_.perform(who_.index, action); }
    void perform(HangUp action) { line_.hang_up(action.for_good); }
    void perform(Log action);
    void perform(Finished action);
    void flush();

    Who who_;
    const OnLog& on_log_;
    Line line_;
    Session session_;
    Pool& pool_;
    std::uint64_t caller_; // whom the session speaks to
    std::vector<Action> actions_;
    std::deque<protocol::Packet> outbox_;
    Instant resend_at_ = Instant::never();
    Duration resend_pause_{};
    std::string refusal_; // that the session has been told
    std::optional<FinishReason> finished_;
    Instant finished_at_{};
};

} // namespace fraja::worker
