#include "common/service/notifier.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

namespace fraja::service {
namespace {

/// A connected socket; -1: there is nobody, or at an address of another kind.
int connect_to(const char* path) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::size_t length = path ? std::strlen(path) : 0;
    if (length < 2 || length >= sizeof address.sun_path || (*path != '/' && *path != '@'))
        return -1;
    std::memcpy(address.sun_path, path, length);
    if (*path == '@') // the abstract namespace
        address.sun_path[0] = '\0';
    const int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + length);
    if (fd >= 0 && connect(fd, reinterpret_cast<const sockaddr*>(&address), size) == 0)
        return fd;
    if (fd >= 0)
        close(fd);
    return -1;
}

/// A third of the time after which the watchdog bites: one word may be lost.
std::optional<Duration> interval_from_environment() {
    const char* usec = std::getenv("WATCHDOG_USEC");
    const char* pid = std::getenv("WATCHDOG_PID");
    const auto time = parse_count(usec ? usec : "");
    constexpr std::uint64_t day_us = 86'400'000'000;
    if (!time || *time == 0 || (pid && parse_count(pid) != static_cast<std::uint64_t>(getpid())))
        return std::nullopt;
    return std::chrono::microseconds(std::min(*time, day_us)) / 3;
}

} // namespace

Notifier::Notifier() : fd_(connect_to(std::getenv("NOTIFY_SOCKET"))) {
    if (fd_ >= 0)
        alive_interval_ = interval_from_environment();
}

Notifier::~Notifier() {
    if (fd_ >= 0)
        close(fd_);
}

void Notifier::ready(std::string_view status) const {
    send("READY=1\nSTATUS=" + printable(status));
}

void Notifier::status(std::string_view status) const {
    send("STATUS=" + printable(status));
}

void Notifier::stopping(std::string_view status) const {
    send("STOPPING=1\nSTATUS=" + printable(status));
}

void Notifier::alive(Instant now) {
    if (!alive_interval_ || now - alive_at_ < *alive_interval_)
        return;
    alive_at_ = now;
    send("WATCHDOG=1");
}

void Notifier::send(const std::string& words) const {
    if (fd_ >= 0) [[maybe_unused]]
        const auto sent = ::send(fd_, words.data(), words.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
}

} // namespace fraja::service
