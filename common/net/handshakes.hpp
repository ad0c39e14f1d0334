// Handshakes: why who listens does not let us in, and who does not come in here for want of a key,
// as libzmq's monitor of a socket tells it. For sockets.cpp alone.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <zmq.hpp>

namespace fraja::net {

/// Of a socket that connects to one endpoint. Used by the socket's thread, which looks at least as
/// often as it finds that nothing can be sent: a monitor that nobody reads stops libzmq.
class Handshakes {
public:
    Handshakes(zmq::context_t& context, zmq::socket_t& socket, bool have_keys);

    /// Takes in what has happened.
    void look();
    /// A message has left: all that was is past.
    void forget() { why_.clear(), broken_off_ = 0, is_over_ = false; }
    /// What people are told; empty: nothing hinders us, as far as is known.
    [[nodiscard]] const std::string& why() const { return why_; }
    /// libzmq does not connect again by itself: who listens has said no.
    [[nodiscard]] bool is_over() const { return is_over_; }
    void begin_anew() { is_over_ = false; }

private:
    void note(int event, unsigned value);

    zmq::socket_t events_;
    bool have_keys_;
    int broken_off_ = 0; ///< handshakes in a row
    bool is_over_ = false;
    std::string why_;
};

/// Of a socket that is bound, and has keys: counts handshakes that ended before the doorman was
/// shown a key. Used by the socket's thread, which looks whenever there is nothing to receive.
class Keyless {
public:
    /// `count` outlives this.
    Keyless(zmq::context_t& context, zmq::socket_t& socket, std::atomic<std::uint64_t>& count);
    void look();

private:
    zmq::socket_t events_;
    std::atomic<std::uint64_t>* count_;
};

} // namespace fraja::net
