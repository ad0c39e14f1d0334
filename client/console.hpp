// Console: what a program says to its user, on stderr: messages by level; and on a terminal one
// line that is redrawn, with a picture above it where that is wanted.
#pragma once

#include "client/exit_code.hpp"
#include "client/preview/preview.hpp"
#include "client/terminal.hpp"
#include "common/base/log_line.hpp"
#include "common/service/color.hpp"

#include <cstdio>
#include <optional>
#include <string>
#include <string_view>

namespace fraja::client {

struct ConsoleOptions {
    std::string program; ///< opens every message
    LogLevel level = LogLevel::info;
    bool json = false; ///< messages as objects, a line each
    service::ColorChoice color = service::ColorChoice::automatic;
};

class Console {
public:
    /// `out` is stderr but in tests.
    explicit Console(ConsoleOptions options, std::FILE* out = stderr);
    ~Console(); ///< ends the line that is redrawn
    Console(const Console&) = delete;
    Console& operator=(const Console&) = delete;

    void error(std::string_view text);
    void warning(std::string_view text);
    void info(std::string_view text);
    void debug(std::string_view text);
    /// An error or warning that has its own opening, as `scene.raj:1:2: ...`.
    void located_error(std::string_view text);
    void located_warning(std::string_view text);

    /// A line of its own, whatever the level.
    void line(std::string_view text);
    /// Takes the place of the last redrawn line. Only for terminals; cut to their width.
    void redraw(std::string_view text);
    /// Takes the place of the last picture, above the redrawn line. Only for terminals. The picture
    /// must leave room for that line in the window.
    void show(Preview picture);
    /// The redrawn line and the picture stay as they are.
    void end_redraw();

    /// `code`, or job_failed where the result on stdout got lost (a full disk), which is then said.
    [[nodiscard]] ExitCode checked(ExitCode code);
    /// The same, of what went to stdout by another way: `lost` says that it did.
    [[nodiscard]] ExitCode checked(ExitCode code, bool lost);

    [[nodiscard]] bool is_terminal() const { return terminal_; }
    [[nodiscard]] bool uses_color() const { return color_; }
    /// Of the terminal.
    [[nodiscard]] Window window() const { return window_of(fileno(out_)); }
    [[nodiscard]] bool answers_sixel() const { return client::answers_sixel(fileno(out_)); }

private:
    void say(LogLevel level, std::string_view word, const char* color, std::string_view text);
    /// A picture is not given up because a message cannot be written, nor kept waiting for long:
    /// that gets lost.
    void put(std::string_view text);
    /// From the beginning of the picture's place on, with room for it below.
    [[nodiscard]] std::string picture_and_line() const;
    /// To where the picture begins, and all is clear from there on.
    [[nodiscard]] std::string taken_away() const;

    ConsoleOptions options_;
    std::FILE* out_;
    bool terminal_, color_;
    // On the terminal now:
    std::string redrawn_;
    std::optional<Preview> picture_;
    Window drawn_in_; ///< the window when the picture was drawn
};

} // namespace fraja::client
