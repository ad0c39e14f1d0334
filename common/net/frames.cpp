#include "common/net/frames.hpp"

#include "common/protocol/limits.hpp"
#include "common/protocol/packing.hpp"

#include <cerrno>
#include <memory>
#include <span>
#include <utility>

#ifdef __SANITIZE_THREAD__
extern "C" void __tsan_release(void* address);
extern "C" void __tsan_acquire(void* address);
#endif

namespace fraja::net {
namespace {

// The figures behind these: ARCHITECTURE.md, "Socket options".
constexpr std::size_t shared_bytes_min = 4'096; // of a blob; less is copied
/// libzmq's own: smaller frames may lie in one with others, and would keep all of it.
constexpr std::size_t receive_buffer_bytes = 8'192;

// A message that goes by inproc is handed from thread to thread by libzmq, which Debian builds
// without the thread sanitizer: so it is told where a message is given away and where it is taken.
void gives_away([[maybe_unused]] void* data) {
#ifdef __SANITIZE_THREAD__
    __tsan_release(data);
#endif
}
void takes([[maybe_unused]] void* data) {
#ifdef __SANITIZE_THREAD__
    __tsan_acquire(data);
#endif
}

std::span<const std::byte> bytes_of(const zmq::message_t& part) {
    return {static_cast<const std::byte*>(part.data()), part.size()};
}

} // namespace

bool take(zmq::socket_t& socket, zmq::message_t& part) {
    try {
        if (!socket.recv(part, zmq::recv_flags::dontwait))
            return false;
        takes(part.data());
        return true;
    } catch (const zmq::error_t& e) {
        if (e.num() == EINTR)
            return false;
        throw;
    }
}

zmq::message_t take_next(zmq::socket_t& socket) {
    zmq::message_t part;
    while (!take(socket, part)) // a signal may interrupt
        continue;
    return part;
}

Blob blob_of(zmq::message_t part) {
    if (part.size() <= receive_buffer_bytes)
        return Blob::copy(bytes_of(part));
    const auto owner = std::make_shared<const zmq::message_t>(std::move(part));
    return {owner, bytes_of(*owner)};
}

Frames take_frames(zmq::socket_t& socket, zmq::message_t first) {
    const bool more = first.more();
    Blob packed = blob_of(std::move(first));
    if (!more)
        return protocol::unpack(packed);
    (void)take_rest(socket, more);
    return {std::move(packed)};
}

// libzmq bounds the size of a part, not their number: what is beyond the limit is taken and dropped
// one by one.
Frames take_rest(zmq::socket_t& socket, bool more) {
    Frames frames;
    while (more) {
        zmq::message_t part = take_next(socket);
        more = part.more();
        if (frames.size() <= protocol::message_frames_max)
            frames.push_back(blob_of(std::move(part)));
    }
    return frames;
}

namespace {

/// `make()` is the part, and is called again if a signal interrupts.
template <class Make>
SendStatus send_part(zmq::socket_t& socket, Make make, bool more) {
    const auto flags =
        zmq::send_flags::dontwait | (more ? zmq::send_flags::sndmore : zmq::send_flags::none);
    for (;;) {
        try {
            zmq::message_t frame = make();
            gives_away(frame.data());
            return socket.send(frame, flags) ? SendStatus::sent : SendStatus::full;
        } catch (const zmq::error_t& e) {
            if (e.num() == EHOSTUNREACH)
                return SendStatus::unreachable;
            if (e.num() != EINTR)
                throw;
        }
    }
}

SendStatus send_copy(zmq::socket_t& socket, const void* data, std::size_t size, bool more) {
    return send_part(
        socket, [&] { return zmq::message_t(data, size); }, more);
}

/// libzmq has sent it, or gives it up; in a thread of its own.
void let_go(void*, void* kept) {
    takes(kept);
    delete static_cast<Blob*>(kept);
}

/// What is large is not copied: it stays as long as libzmq needs it.
SendStatus send_blob(zmq::socket_t& socket, const Blob& blob, bool more) {
    if (blob.size() < shared_bytes_min)
        return send_copy(socket, blob.data(), blob.size(), more);
    return send_part(
        socket,
        [&] {
            auto kept = std::make_unique<Blob>(blob);
            gives_away(kept.get());
            // libzmq takes a pointer to what may be changed, and changes nothing.
            zmq::message_t frame(const_cast<std::byte*>(blob.data()), blob.size(), let_go,
                                 kept.get());
            (void)kept.release();
            return frame;
        },
        more);
}

/// What follows an envelope goes with it, or the connection has just ended. (After a refused
/// routing id a message sent alone would be swallowed in silence: hence the early returns below.)
SendStatus behind_envelope(SendStatus status) {
    return status == SendStatus::sent ? status : SendStatus::unreachable;
}

SendStatus send_envelope(zmq::socket_t& socket, std::string_view envelope) {
    return send_copy(socket, envelope.data(), envelope.size(), true);
}

SendStatus send_all(zmq::socket_t& socket, const protocol::Packet& packet) {
    return send_part(
        socket,
        [&] {
            zmq::message_t part(protocol::packed_size(packet));
            protocol::pack(packet, {static_cast<std::byte*>(part.data()), part.size()});
            return part;
        },
        false);
}

} // namespace

SendStatus send_packet(zmq::socket_t& socket, std::optional<std::string_view> peer,
                       const protocol::Packet& packet) {
    if (!peer)
        return send_all(socket, packet);
    const auto first = send_envelope(socket, *peer);
    return first == SendStatus::sent ? behind_envelope(send_all(socket, packet)) : first;
}

SendStatus send_packed(zmq::socket_t& socket, std::string_view peer, const Blob& packed) {
    const auto first = send_envelope(socket, peer);
    return first == SendStatus::sent ? behind_envelope(send_blob(socket, packed, false)) : first;
}

void publish_packet(zmq::socket_t& socket, std::string_view topic, const protocol::Packet& packet) {
    if (send_envelope(socket, topic) != SendStatus::sent)
        return;
    (void)send_copy(socket, packet.header.data(), packet.header.size(), true);
    (void)send_copy(socket, packet.body.data(), packet.body.size(), !packet.blobs.empty());
    for (std::size_t i = 0; i < packet.blobs.size(); ++i)
        (void)send_blob(socket, packet.blobs[i], i + 1 < packet.blobs.size());
}

void send_text(zmq::socket_t& socket, std::string_view text, bool more) {
    (void)send_copy(socket, text.data(), text.size(), more);
}

SendStatus send_probe(zmq::socket_t& socket, std::string_view peer) {
    const auto status = send_envelope(socket, peer);
    if (status == SendStatus::sent)
        (void)send_copy(socket, nullptr, 0, false);
    return status;
}

bool is_probe(const Frames& frames) {
    return frames.size() == 1 && frames.front().empty();
}

} // namespace fraja::net
