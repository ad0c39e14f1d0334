#include "client/outlet.hpp"

#include "common/net/sockets.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <climits>
#include <poll.h>

namespace fraja::client {
namespace {

/// A pipe that has room at all has room for so much: such a write does not wait. (To make the
/// descriptor itself non-blocking would make it so for everybody who has it, a shell among them.)
constexpr std::size_t write_bytes_max = PIPE_BUF;

bool has_room(int fd) {
    pollfd entry{fd, POLLOUT, 0};
    return ::poll(&entry, 1, 0) == 1;
}

} // namespace

void Outlet::pump() {
    while (!is_empty() && !failed_ && has_room(fd_)) {
        const std::size_t size = std::min(kept_.size() - begin_, write_bytes_max);
        const ssize_t written = ::write(fd_, kept_.data() + begin_, size);
        if (written >= 0)
            begin_ += static_cast<std::size_t>(written);
        else if (errno == EAGAIN) // somebody else has made it non-blocking
            break;
        else if (errno != EINTR)
            failed_ = true;
    }
    if (failed_ || 2 * begin_ > kept_.size())
        kept_.erase(0, std::exchange(begin_, 0));
    if (failed_)
        kept_.clear();
}

std::optional<int> Outlet::drain(const net::SignalWatch* signals) {
    using namespace std::chrono_literals;
    for (pump(); !is_empty(); pump()) {
        if (const auto signal = signals ? signals->receive() : std::nullopt)
            return signal;
        if (signals)
            net::wait({net::Waitable::writable(fd_), net::Waitable(signals->fd())}, 1min);
        else
            net::wait({net::Waitable::writable(fd_)}, 1min);
    }
    return std::nullopt;
}

} // namespace fraja::client
