#include "broker/http_stream.hpp"

#include "common/net/clock.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <poll.h>
#include <sys/socket.h>

namespace fraja::broker {

/// Until the socket is ready; false: the time is up, or this is to stop.
bool HttpStream::wait_for(short events) const {
    std::array<pollfd, 2> fds{{{socket_, events, 0}, {stop_fd_, POLLIN, 0}}};
    for (;;) {
        const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline_ - net::now());
        if (left.count() <= 0)
            return false;
        const int ready = poll(fds.data(), fds.size(), static_cast<int>(left.count()));
        if (ready > 0 && fds[1].revents == 0)
            return true;
        if (ready >= 0 || errno != EINTR)
            return false;
    }
}

bool HttpStream::is_readable() const {
    return begin_ < end_ || (left_bytes_ > 0 && wait_for(POLLIN));
}

bool HttpStream::is_writable() const {
    return wait_for(POLLOUT);
}

ssize_t HttpStream::read(char* ptr, std::size_t size) {
    if (begin_ == end_) {
        if (!is_readable())
            return -1;
        const ssize_t received =
            recv(socket_, buffer_.data(), std::min(buffer_.size(), left_bytes_), MSG_DONTWAIT);
        if (received <= 0)
            return received;
        begin_ = 0;
        end_ = static_cast<std::size_t>(received);
        left_bytes_ -= end_;
    }
    const std::size_t taken = std::min(size, end_ - begin_);
    std::memcpy(ptr, buffer_.data() + begin_, taken);
    begin_ += taken;
    return static_cast<ssize_t>(taken);
}

ssize_t HttpStream::write(const char* ptr, std::size_t size) {
    if (!is_writable())
        return -1;
    return send(socket_, ptr, size, MSG_DONTWAIT | MSG_NOSIGNAL);
}

void HttpStream::finish() {
    shutdown(socket_, SHUT_WR);
    while (wait_for(POLLIN) && left_bytes_ > 0) {
        const ssize_t received =
            recv(socket_, buffer_.data(), std::min(buffer_.size(), left_bytes_), MSG_DONTWAIT);
        if (received <= 0)
            return;
        left_bytes_ -= static_cast<std::size_t>(received);
    }
}

} // namespace fraja::broker
