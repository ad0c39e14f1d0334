#include "common/net/poller.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <poll.h>
#include <sys/epoll.h>
#include <unistd.h>
#include <utility>

namespace fraja::net {
namespace {

using namespace std::chrono_literals;

constexpr std::uint64_t no_socket = ~std::uint64_t{0}; ///< a plain file descriptor's

void watch(int epoll, int fd, std::uint64_t index) {
    epoll_event event{.events = EPOLLIN, .data = {.u64 = index}};
    FRAJA_ASSERT(epoll_ctl(epoll, EPOLL_CTL_ADD, fd, &event) == 0);
}

/// epoll_wait knows milliseconds only, and a deadline should not wait for the next one.
void wait_for(int epoll, Duration timeout) {
    const auto bounded = std::clamp<Duration>(timeout, Duration::zero(), 1min);
    const auto whole = std::chrono::floor<std::chrono::seconds>(bounded);
    const timespec time{.tv_sec = whole.count(), .tv_nsec = (bounded - whole).count()};
    pollfd waited{.fd = epoll, .events = POLLIN, .revents = 0};
    (void)ppoll(&waited, 1, &time, nullptr); // an interruption is an early return
}

} // namespace

Poller::Poller() : epoll_(epoll_create1(EPOLL_CLOEXEC)) {
    FRAJA_ASSERT(epoll_ >= 0);
}
Poller::~Poller() {
    close(epoll_);
}

void Poller::add(int fd) {
    watch(epoll_, fd, no_socket);
}

void Poller::add(std::size_t index, const Socket& socket) {
    if (index >= entries_.size())
        entries_.resize(index + 1);
    FRAJA_ASSERT(!entries_[index].socket);
    entries_[index].socket = &socket;
    watch(epoll_, socket.event_fd(), index);
    look_again(index);
}

void Poller::remove(std::size_t index) {
    FRAJA_ASSERT(entries_.at(index).socket);
    FRAJA_ASSERT(epoll_ctl(epoll_, EPOLL_CTL_DEL, entries_[index].socket->event_fd(), nullptr) ==
                 0);
    entries_[index].socket = nullptr;
}

void Poller::look_again(std::size_t index) {
    if (!std::exchange(entries_.at(index).to_look_at, true))
        to_look_at_.push_back(index);
}

const std::vector<std::size_t>& Poller::wait(Duration timeout) {
    ready_.clear();
    for (const std::size_t index : std::exchange(to_look_at_, {})) {
        entries_[index].to_look_at = false;
        take_if_readable(index);
    }
    if (ready_.empty() && timeout > Duration::zero())
        wait_for(epoll_, timeout);
    std::array<epoll_event, 256> events;
    const int count = epoll_wait(epoll_, events.data(), static_cast<int>(events.size()), 0);
    for (int i = 0; i < count; ++i) // less than none: interrupted
        if (const std::uint64_t index = events[static_cast<std::size_t>(i)].data.u64;
            index != no_socket && !entries_[index].to_look_at)
            take_if_readable(index);
    return ready_;
}

/// Asking it takes the sign that its file descriptor gives.
void Poller::take_if_readable(std::size_t index) {
    if (!entries_[index].socket || !entries_[index].socket->readable())
        return;
    ready_.push_back(index);
    look_again(index);
}

} // namespace fraja::net
