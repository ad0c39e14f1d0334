#include "common/net/waker.hpp"

#include "common/base/assert.hpp"

#include <cstdint>
#include <sys/eventfd.h>
#include <unistd.h>

namespace fraja::net {

Waker::Waker() : fd_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
    FRAJA_ASSERT(fd_ >= 0);
}
Waker::~Waker() {
    close(fd_);
}

void Waker::wake() const {
    const std::uint64_t one = 1;
    // It can only fail when the counter is full, and then the loop is awake already.
    [[maybe_unused]] const auto written = write(fd_, &one, sizeof one);
}

void Waker::drain() const {
    std::uint64_t count = 0;
    [[maybe_unused]] const auto taken = read(fd_, &count, sizeof count);
}

} // namespace fraja::net
