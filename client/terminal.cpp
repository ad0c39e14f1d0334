#include "client/terminal.hpp"

#include "common/net/clock.hpp"

#include <chrono>
#include <poll.h>
#include <string>
#include <string_view>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration answer_max = 200ms;
constexpr std::size_t answer_bytes_max = 64;

bool same_terminal(int a, int b) {
    struct stat sa {
    }, sb{};
    return isatty(a) == 1 && isatty(b) == 1 && fstat(a, &sa) == 0 && fstat(b, &sb) == 0 &&
           sa.st_rdev == sb.st_rdev;
}

bool wait_for_key(Duration timeout) {
    pollfd entry{STDIN_FILENO, POLLIN, 0};
    const auto ms = std::chrono::ceil<std::chrono::milliseconds>(timeout).count();
    return ::poll(&entry, 1, static_cast<int>(ms)) == 1 && (entry.revents & POLLIN) != 0;
}

} // namespace

Window window_of(int fd) {
    winsize size{};
    Window window;
    if (ioctl(fd, TIOCGWINSZ, &size) != 0 || size.ws_col < 2 || size.ws_row < 2)
        return window;
    window.columns = size.ws_col;
    window.rows = size.ws_row;
    if (size.ws_xpixel >= size.ws_col && size.ws_ypixel >= size.ws_row) {
        window.cell_width = size.ws_xpixel / window.columns;
        window.cell_height = size.ws_ypixel / window.rows;
        window.pixels_known = true;
    }
    return window;
}

struct RawKeys::Before {
    termios settings{};
};

RawKeys::RawKeys(std::unique_ptr<Before> before) : before_(std::move(before)) {}
RawKeys::RawKeys(RawKeys&&) noexcept = default;

RawKeys::~RawKeys() {
    if (!before_)
        return;
    tcflush(STDIN_FILENO, TCIFLUSH); // what was typed here is not for whoever comes next
    tcsetattr(STDIN_FILENO, TCSANOW, &before_->settings);
}

std::optional<RawKeys> RawKeys::take() {
    auto before = std::make_unique<Before>();
    if (isatty(STDIN_FILENO) == 0 || tcgetpgrp(STDIN_FILENO) != getpgrp() ||
        tcgetattr(STDIN_FILENO, &before->settings) != 0)
        return std::nullopt;
    termios raw = before->settings;
    raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
    raw.c_cc[VSUSP] = _POSIX_VDISABLE;
    raw.c_cc[VMIN] = 0;
    raw.c_cc[VTIME] = 0;
    if (tcsetattr(STDIN_FILENO, TCSANOW, &raw) != 0)
        return std::nullopt;
    return RawKeys(std::move(before));
}

std::optional<char> RawKeys::read() const {
    char key = 0;
    return ::read(STDIN_FILENO, &key, 1) == 1 ? std::optional(key) : std::nullopt;
}

bool RawKeys::has_left() const {
    bool left = false;
    while (const auto key = read())
        left = left || *key == 'q' || *key == 'Q';
    return left;
}

bool names_sixel(std::string_view answer) {
    const auto begin = answer.find("\x1b[?"), end = answer.find('c', begin);
    return begin != std::string_view::npos &&
           (std::string(answer.substr(begin, end - begin)) + ";").find(";4;") != std::string::npos;
}

bool answers_sixel(int fd) {
    if (!same_terminal(fd, STDIN_FILENO))
        return false;
    const auto keys = RawKeys::take();
    constexpr std::string_view question = "\x1b[c";
    if (!keys || ::write(fd, question.data(), question.size()) != std::ssize(question))
        return false;
    const Instant end = net::now() + answer_max;
    std::string answer;
    while (!answer.ends_with('c') && answer.size() < answer_bytes_max) {
        const Duration left = end - net::now();
        if (left <= Duration::zero() || !wait_for_key(left))
            return false;
        if (const auto byte = keys->read())
            answer += *byte;
    }
    return names_sixel(answer);
}

} // namespace fraja::client
