#include "client/console.hpp"

#include "client/columns.hpp"
#include "common/base/text.hpp"
#include "common/service/json_line.hpp"

#include <chrono>
#include <fmt/core.h>
#include <poll.h>
#include <unistd.h>
#include <utility>

namespace fraja::client {
namespace {

constexpr const char* red = "\x1b[1;31m";
constexpr const char* yellow = "\x1b[1;33m";
constexpr const char* plain = "\x1b[0m";

/// A terminal that knows how shows all that is between them at once.
constexpr std::string_view update_begin = "\x1b[?2026h", update_end = "\x1b[?2026l";

constexpr int room_awaited_ms = 1000; // for a message, of a reader who takes none

bool has_room(std::FILE* out) {
    pollfd entry{fileno(out), POLLOUT, 0};
    return ::poll(&entry, 1, room_awaited_ms) == 1;
}

} // namespace

Console::Console(ConsoleOptions options, std::FILE* out)
    : options_(std::move(options)), out_(out), terminal_(isatty(fileno(out)) == 1),
      color_(service::wants_color(options_.color, fileno(out))) {}

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

void Console::located_error(std::string_view text) {
    if (options_.json)
        say(LogLevel::error, {}, nullptr, text);
    else
        line(printable(text));
}

void Console::located_warning(std::string_view text) {
    if (options_.json)
        say(LogLevel::warning, {}, nullptr, text);
    else if (options_.level <= LogLevel::warning)
        line(fmt::format("{}warning:{} {}", color_ ? yellow : "", color_ ? plain : "",
                         printable(text)));
}

void Console::say(LogLevel level, std::string_view word, const char* color, std::string_view text) {
    if (level < options_.level)
        return;
    if (options_.json)
        return line(service::json_line(std::chrono::system_clock::now(), options_.program,
                                       {{level, {}, {}, std::string(text)}, 0}));
    const bool painted = color_ && color;
    line(fmt::format("{}: {}{}{}{}", options_.program, painted ? color : "", word,
                     painted ? plain : "", printable(text)));
}

void Console::line(std::string_view text) {
    if (picture_)
        return put(fmt::format("{}{}{}\n{}{}", update_begin, taken_away(), text, picture_and_line(),
                               update_end));
    const std::string redrawn = std::exchange(redrawn_, {});
    put(fmt::format("{}{}\n", redrawn.empty() ? "" : "\r\x1b[K", text));
    if (!redrawn.empty())
        redraw(redrawn);
}

void Console::redraw(std::string_view text) {
    redrawn_ = first_columns(text, window().columns - 1);
    put("\r\x1b[K" + redrawn_);
}

void Console::show(Preview picture) {
    const Window now = window();
    std::string text(update_begin);
    if (picture_ && now != drawn_in_) // nobody knows where what was there has gone
        text += picture_->removal + "\x1b[H\x1b[2J";
    else if (picture_ && picture_->rows == picture.rows) // what is the same does not flicker
        text += fmt::format("\r\x1b[{}A", picture_->rows);
    else if (picture_)
        text += taken_away();
    picture_ = std::move(picture);
    drawn_in_ = now;
    redrawn_ = first_columns(redrawn_, now.columns - 1);
    put(text + picture_and_line() + std::string(update_end));
}

std::string Console::picture_and_line() const {
    // First room is made, as the window may have to scroll for it. The picture leaves the cursor
    // where its kind does, so the place is remembered.
    return fmt::format("\r{}\x1b[{}A\x1b"
                       "7{}\x1b"
                       "8\x1b[{}B\r\x1b[K{}",
                       std::string(picture_->rows, '\n'), picture_->rows, picture_->bytes,
                       picture_->rows, redrawn_);
}

std::string Console::taken_away() const {
    return fmt::format("\r\x1b[{}A{}\x1b[J", picture_->rows, picture_->removal);
}

ExitCode Console::checked(ExitCode code) {
    return checked(code, std::fflush(stdout) != 0 || std::ferror(stdout) != 0);
}

ExitCode Console::checked(ExitCode code, bool lost) {
    if (!lost)
        return code;
    error("standard output cannot be written to");
    return code == ExitCode::done ? ExitCode::job_failed : code;
}

void Console::end_redraw() {
    const bool any = picture_ || !redrawn_.empty();
    picture_.reset();
    redrawn_.clear();
    if (any)
        put("\n");
}

void Console::put(std::string_view text) {
    if (!has_room(out_))
        return;
    std::fwrite(text.data(), 1, text.size(), out_);
    std::fflush(out_);
    std::clearerr(out_); // there may be room again for what comes next
}

} // namespace fraja::client
