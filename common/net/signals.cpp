#include "common/net/signals.hpp"

#include "common/base/assert.hpp"

#include <csignal>
#include <sys/signalfd.h>
#include <unistd.h>

namespace fraja::net {

SignalWatch::SignalWatch(std::initializer_list<int> signals) : fd_(-1) {
    sigset_t set;
    sigemptyset(&set);
    for (const int signal : signals)
        sigaddset(&set, signal);
    pthread_sigmask(SIG_BLOCK, &set, nullptr);
    fd_ = signalfd(-1, &set, SFD_NONBLOCK | SFD_CLOEXEC);
    FRAJA_ASSERT(fd_ >= 0);
}

SignalWatch::~SignalWatch() {
    close(fd_);
}

std::optional<int> SignalWatch::receive() const {
    signalfd_siginfo info;
    if (read(fd_, &info, sizeof info) != static_cast<ssize_t>(sizeof info))
        return std::nullopt;
    return static_cast<int>(info.ssi_signo);
}

} // namespace fraja::net
