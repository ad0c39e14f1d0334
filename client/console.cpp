#include "client/console.hpp"

#include "common/base/text.hpp"

#include <cstdlib>
#include <fmt/core.h>
#include <sys/ioctl.h>
#include <unistd.h>
#include <utility>

namespace fraja::client {
namespace {

constexpr const char* red = "\x1b[1;31m";
constexpr const char* yellow = "\x1b[1;33m";
constexpr const char* plain = "\x1b[0m";

bool wants_color(ColorChoice choice, bool terminal) {
    const char* no_color = std::getenv("NO_COLOR");
    switch (choice) {
    case ColorChoice::always:
        return true;
    case ColorChoice::never:
        return false;
    case ColorChoice::automatic:
        break;
    }
    return terminal && !(no_color && *no_color);
}

/// The first `columns` characters of UTF-8 text, counting every code point as one column.
std::string_view cut(std::string_view text, std::size_t columns) {
    std::size_t seen = 0;
    for (std::size_t i = 0; i < text.size(); ++i)
        if ((static_cast<unsigned char>(text[i]) & 0xc0) != 0x80 && ++seen > columns)
            return text.substr(0, i);
    return text;
}

} // namespace

Console::Console(ConsoleOptions options, std::FILE* out)
    : options_(std::move(options)), out_(out), terminal_(isatty(fileno(out)) == 1),
      color_(wants_color(options_.color, terminal_)) {}

Console::~Console() {
    end_redraw();
}

void Console::error(std::string_view text) {
    say(LogLevel::error, "error: ", red, text);
}
void Console::warning(std::string_view text) {
    say(LogLevel::warning, "warning: ", yellow, text);
}
void Console::info(std::string_view text) {
    say(LogLevel::info, "", nullptr, text);
}
void Console::debug(std::string_view text) {
    say(LogLevel::debug, "", nullptr, text);
}

void Console::located_warning(std::string_view text) {
    if (options_.level <= LogLevel::warning)
        line(fmt::format("{}warning:{} {}", color_ ? yellow : "", color_ ? plain : "",
                         printable(text)));
}

void Console::say(LogLevel level, std::string_view word, const char* color, std::string_view text) {
    if (level < options_.level)
        return;
    const bool painted = color_ && color;
    line(fmt::format("{}: {}{}{}{}", options_.program, painted ? color : "", word,
                     painted ? plain : "", printable(text)));
}

void Console::line(std::string_view text) {
    const std::string redrawn = std::exchange(redrawn_, {});
    put(fmt::format("{}{}\n", redrawn.empty() ? "" : "\r\x1b[K", text));
    if (!redrawn.empty())
        redraw(redrawn);
}

void Console::redraw(std::string_view text) {
    redrawn_ = cut(text, terminal_width(out_) - 1);
    put("\r\x1b[K" + redrawn_);
}

ExitCode Console::checked(ExitCode code) {
    if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0)
        return code;
    error("standard output cannot be written to");
    return code == ExitCode::done ? ExitCode::job_failed : code;
}

void Console::end_redraw() {
    if (std::exchange(redrawn_, {}).empty())
        return;
    put("\n");
}

void Console::put(std::string_view text) {
    std::fwrite(text.data(), 1, text.size(), out_);
    std::fflush(out_);
    std::clearerr(out_); // there may be room again for what comes next
}

std::size_t terminal_width(std::FILE* file) {
    winsize size{};
    if (ioctl(fileno(file), TIOCGWINSZ, &size) == 0 && size.ws_col > 1)
        return size.ws_col;
    return 80;
}

} // namespace fraja::client
