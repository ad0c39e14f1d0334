// Messages in and out of a ZeroMQ socket, frame by frame: for sockets.cpp alone.
#pragma once

#include "common/base/bytes.hpp"
#include "common/net/sockets.hpp"
#include "common/protocol/codec.hpp"

#include <optional>
#include <string_view>
#include <zmq.hpp>

namespace fraja::net {

/// Takes one frame if there is one. A signal that interrupts is nothing to take.
[[nodiscard]] bool take(zmq::socket_t& socket, zmq::message_t& frame);

/// What is large is not copied: it stays where libzmq has received it.
[[nodiscard]] Blob blob_of(zmq::message_t frame);

/// The frames that are still to come of a message that has `more`; no more of them than Frames
/// holds.
[[nodiscard]] Frames take_rest(zmq::socket_t& socket, bool more);

/// The envelope, if there is one, header, body and blobs.
SendStatus send_packet(zmq::socket_t& socket, std::optional<std::string_view> envelope,
                       const protocol::Packet& packet);

/// A message of one empty frame: all that a connection says of itself when it has been made
/// (PROBE_ROUTER), and that is sent to see whether a peer is there. It has nothing to tell.
SendStatus send_probe(zmq::socket_t& socket, std::string_view peer);
[[nodiscard]] bool is_probe(const Frames& frames);

} // namespace fraja::net
