// Poller: waits for many sockets at a cost that depends on how many are busy.
#pragma once

#include "common/base/instant.hpp"
#include "common/net/sockets.hpp"

#include <cstddef>
#include <vector>

namespace fraja::net {

/// Belongs to the thread that owns the sockets.
class Poller {
public:
    Poller();
    ~Poller();
    Poller(const Poller&) = delete;
    Poller& operator=(const Poller&) = delete;

    /// A file descriptor that ends a wait while it is readable.
    void add(int fd);
    /// `index` names the socket, and is not in use. The socket stays where it is until it is
    /// removed.
    void add(std::size_t index, const Socket& socket);
    void remove(std::size_t index);

    /// To be called after anything was sent or received by that socket: ZeroMQ may have found then
    /// that messages are there, and gives no further sign of them.
    void look_again(std::size_t index);

    /// Sockets that have something to receive, at most `timeout` later; none: a file descriptor is
    /// readable, or the time is up, or nothing. No more need be received than one likes: those that
    /// were returned are looked at again. Valid until the next call.
    [[nodiscard]] const std::vector<std::size_t>& wait(Duration timeout);

private:
    struct Entry {
        const Socket* socket = nullptr;
        bool to_look_at = false;
    };
    void take_if_readable(std::size_t index);

    int epoll_;
    std::vector<Entry> entries_; // at the sockets' indices
    std::vector<std::size_t> to_look_at_, ready_;
};

} // namespace fraja::net
