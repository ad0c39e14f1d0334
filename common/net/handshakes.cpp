#include "common/net/handshakes.hpp"

#include "common/net/frames.hpp"

#include <cerrno>
#include <cstdint>
#include <cstring>

namespace fraja::net {
namespace {

/// So often in a row who listens has hung up in the middle: then it is no accident.
constexpr int broken_off_max = 3;

constexpr int wanted_events = ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL |
                              ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL |
                              ZMQ_EVENT_HANDSHAKE_FAILED_AUTH | ZMQ_EVENT_HANDSHAKE_SUCCEEDED;

std::string new_endpoint() {
    static std::atomic<std::uint64_t> count = 0;
    return "inproc://fraja-handshakes-" + std::to_string(++count);
}

zmq::socket_t monitor(zmq::context_t& context, zmq::socket_t& socket, int wanted) {
    zmq::socket_t events(context, zmq::socket_type::pair);
    const std::string endpoint = new_endpoint();
    if (zmq_socket_monitor(socket.handle(), endpoint.c_str(), wanted) != 0)
        throw zmq::error_t();
    events.set(zmq::sockopt::linger, 0);
    events.set(zmq::sockopt::rcvhwm, 0);
    events.connect(endpoint);
    return events;
}

/// Each that has happened goes to `note(event, value)`.
template <class F>
void take_events(zmq::socket_t& events, F note) {
    zmq::message_t event;
    while (net::take(events, event)) {
        std::uint16_t number = 0;
        std::uint32_t value = 0;
        if (event.size() == sizeof number + sizeof value) {
            std::memcpy(&number, event.data(), sizeof number);
            std::memcpy(&value, static_cast<const char*>(event.data()) + sizeof number,
                        sizeof value);
            note(number, value);
        }
        if (event.more()) // the endpoint
            (void)take_next(events);
    }
}

} // namespace

Handshakes::Handshakes(zmq::context_t& context, zmq::socket_t& socket, bool have_keys)
    : events_(monitor(context, socket, wanted_events)), have_keys_(have_keys) {}

void Handshakes::look() {
    take_events(events_, [this](int event, unsigned value) { note(event, value); });
}

/// Of two whose mechanisms differ either may see it first, and hang up.
Keyless::Keyless(zmq::context_t& context, zmq::socket_t& socket, std::atomic<std::uint64_t>& count)
    : events_(monitor(context, socket,
                      ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL)),
      count_(&count) {}

void Keyless::look() {
    take_events(events_, [this](int, unsigned) { ++*count_; });
}

// Seen with libzmq 4.3.4: who is refused by ZAP hears 400. Where one of two has keys, both see that
// their mechanisms differ, or one that the other has hung up already. Who knows a wrong key of the
// broker's sees it hang up each time, with EPIPE; a broker that is stopped is waited for in vain,
// which is another error and takes the whole time of a handshake.
void Handshakes::note(int event, unsigned value) {
    if (event == ZMQ_EVENT_HANDSHAKE_SUCCEEDED) {
        forget();
    } else if (event == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH) {
        why_ = "it refuses our key: ask for a line in its allow-list (fraja-broker --allow)";
        is_over_ = true;
    } else if (event == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL &&
               value == ZMQ_PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH) {
        why_ = have_keys_ ? "it has no keys, and we do: nothing is said to it unencrypted (leave "
                            "out --key-file, or give it keys)"
                          : "it has keys, and we have none: --key-file FILE names ours (fraja-ctl "
                            "keygen makes them)";
        is_over_ = true;
    } else if (event == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL) {
        is_over_ = true; // who does not speak ZeroMQ: as if nobody were there
    } else if (have_keys_ && value == EPIPE && ++broken_off_ >= broken_off_max && why_.empty()) {
        why_ = "it breaks off every handshake: its key is another than --broker-key says, or it "
               "has no keys, or is no broker";
    }
}

} // namespace fraja::net
