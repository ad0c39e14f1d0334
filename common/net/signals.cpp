#include "common/net/signals.hpp"

#include "common/base/assert.hpp"

#include <sys/signalfd.h>
#include <unistd.h>

namespace fraja::net {

SignalWatch::SignalWatch(std::initializer_list<int> signals) : signals_{}, fd_(-1) {
    sigemptyset(&signals_);
    for (const int signal : signals)
        sigaddset(&signals_, signal);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
    fd_ = signalfd(-1, &signals_, SFD_NONBLOCK | SFD_CLOEXEC);
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

Unwatched::Unwatched(const SignalWatch* watch) : watch_(watch) {
    if (watch_)
        pthread_sigmask(SIG_UNBLOCK, &watch_->signals_, nullptr);
}

Unwatched::~Unwatched() {
    if (watch_)
        pthread_sigmask(SIG_BLOCK, &watch_->signals_, nullptr);
}

} // namespace fraja::net
