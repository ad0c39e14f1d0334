// Messages in and out of a ZeroMQ socket, frame by frame: for sockets.cpp alone.
#pragma once

#include "common/base/bytes.hpp"
#include "common/net/sockets.hpp"
#include "common/protocol/codec.hpp"

#include <optional>
#include <string_view>
#include <zmq.hpp>

namespace fraja::net {

/// Takes one part of a message if there is one. A signal that interrupts is nothing to take.
[[nodiscard]] bool take(zmq::socket_t& socket, zmq::message_t& part);

/// Takes the next part of a message of which there is one already: they come together.
[[nodiscard]] zmq::message_t take_next(zmq::socket_t& socket);

/// What is large is not copied: it stays where libzmq has received it.
[[nodiscard]] Blob blob_of(zmq::message_t part);

/// Of a session's message, from its first part behind the envelope on: the frames that are packed
/// in it. Nobody sends more parts who speaks this version of the protocol: decode() is told the
/// first.
[[nodiscard]] Frames take_frames(zmq::socket_t& socket, zmq::message_t first);

/// The parts that are still to come of a message that has `more`; no more of them than Frames
/// holds.
[[nodiscard]] Frames take_rest(zmq::socket_t& socket, bool more);

/// On a session: to `peer`, if the socket has several.
SendStatus send_packet(zmq::socket_t& socket, std::optional<std::string_view> peer,
                       const protocol::Packet& packet);
/// The same of a packet that is packed already; it is not copied.
SendStatus send_packed(zmq::socket_t& socket, std::string_view peer, const Blob& packed);

/// On the stream: topic, header, body and blobs, which are not copied.
void publish_packet(zmq::socket_t& socket, std::string_view topic, const protocol::Packet& packet);

/// A part of a message, copied; waits for nobody: it is for peers in this process, which read.
void send_text(zmq::socket_t& socket, std::string_view text, bool more);

/// A message of one empty frame: all that a connection says of itself when it has been made
/// (PROBE_ROUTER), and that is sent to see whether a peer is there. It has nothing to tell.
SendStatus send_probe(zmq::socket_t& socket, std::string_view peer);
[[nodiscard]] bool is_probe(const Frames& frames);

} // namespace fraja::net
