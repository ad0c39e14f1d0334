#include "tests/support/terminal.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

namespace fraja {

using TerminalClock = std::chrono::steady_clock;

Terminal::Terminal(Extent size) : fd_(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC)) {
    FRAJA_ASSERT(fd_ >= 0 && ::grantpt(fd_) == 0 && ::unlockpt(fd_) == 0);
    termios settings{};
    FRAJA_ASSERT(::tcgetattr(fd_, &settings) == 0);
    settings.c_oflag &= ~static_cast<tcflag_t>(OPOST); // what is written arrives as it is
    FRAJA_ASSERT(::tcsetattr(fd_, TCSANOW, &settings) == 0);
    resize(size);
}

Terminal::~Terminal() {
    ::close(fd_);
}

std::vector<std::string> Terminal::command(const std::vector<std::string>& argv) const {
    std::array<char, 64> name{};
    FRAJA_ASSERT(::ptsname_r(fd_, name.data(), name.size()) == 0);
    // A test may run where Ctrl-C is ignored, and a program that is born so stays so.
    std::vector<std::string> all = {
        "/bin/sh", "-c",
        "exec setsid --ctty --wait env --default-signal=INT \"$@\" <\"$0\" >\"$0\" 2>&1",
        name.data()};
    all.insert(all.end(), argv.begin(), argv.end());
    return all;
}

bool Terminal::read(Duration timeout) {
    pollfd entry{fd_, POLLIN, 0};
    const auto ms = std::chrono::ceil<std::chrono::milliseconds>(timeout).count();
    if (::poll(&entry, 1, static_cast<int>(std::max<std::int64_t>(ms, 0))) != 1)
        return true;
    std::array<char, 65536> buffer;
    const ssize_t n = ::read(fd_, buffer.data(), buffer.size());
    if (n > 0)
        text_.append(buffer.data(), static_cast<std::size_t>(n));
    return n > 0 || errno == EINTR;
}

bool Terminal::wait_for(std::string_view words, Duration timeout) {
    const auto deadline = TerminalClock::now() + timeout;
    while (true) {
        if (const auto at = text_.find(words, seen_); at != std::string::npos) {
            seen_ = at + words.size();
            return true;
        }
        const auto left = deadline - TerminalClock::now();
        if (left <= Duration::zero() || !read(left))
            return false;
    }
}

bool Terminal::wait_for_end(Duration timeout) {
    const auto deadline = TerminalClock::now() + timeout;
    while (read(deadline - TerminalClock::now()))
        if (TerminalClock::now() >= deadline)
            return false;
    return true;
}

void Terminal::type(std::string_view keys) {
    FRAJA_ASSERT(::write(fd_, keys.data(), keys.size()) == std::ssize(keys));
}

void Terminal::resize(Extent size) {
    winsize window{};
    window.ws_col = static_cast<unsigned short>(size.width);
    window.ws_row = static_cast<unsigned short>(size.height);
    FRAJA_ASSERT(::ioctl(fd_, TIOCSWINSZ, &window) == 0);
}

bool Terminal::is_sane() const {
    termios settings{};
    FRAJA_ASSERT(::tcgetattr(fd_, &settings) == 0);
    return (settings.c_lflag & ICANON) != 0 && (settings.c_lflag & ECHO) != 0 &&
           (settings.c_lflag & ISIG) != 0 && settings.c_cc[VSUSP] != _POSIX_VDISABLE;
}

} // namespace fraja
