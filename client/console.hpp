// Console: what a program says to its user, on stderr: messages by level, and one line that is
// redrawn on a terminal.
#pragma once

#include "client/exit_code.hpp"

#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>

namespace fraja::client {

enum class LogLevel : std::uint8_t { trace, debug, info, warning, error };
enum class ColorChoice : std::uint8_t { automatic, always, never };

struct ConsoleOptions {
    std::string program; ///< opens every message
    LogLevel level = LogLevel::info;
    ColorChoice color = ColorChoice::automatic;
};

class Console {
public:
    /// `out` is stderr but in tests. Colour is used on a terminal, unless NO_COLOR is set.
    explicit Console(ConsoleOptions options, std::FILE* out = stderr);
    ~Console(); ///< ends the line that is redrawn
    Console(const Console&) = delete;
    Console& operator=(const Console&) = delete;

    void error(std::string_view text);
    void warning(std::string_view text);
    void info(std::string_view text);
    void debug(std::string_view text);
    /// A warning that has its own opening, as `scene.raj:1:2: ...`.
    void located_warning(std::string_view text);

    /// A line of its own, whatever the level.
    void line(std::string_view text);
    /// Takes the place of the last redrawn line. Only for terminals; cut to their width.
    void redraw(std::string_view text);
    /// The redrawn line stays as it is.
    void end_redraw();

    /// `code`, or job_failed where the result on stdout got lost (a full disk), which is then said.
    [[nodiscard]] ExitCode checked(ExitCode code);

    [[nodiscard]] bool is_terminal() const { return terminal_; }
    [[nodiscard]] bool uses_color() const { return color_; }

private:
    void say(LogLevel level, std::string_view word, const char* color, std::string_view text);
    /// A picture is not given up because a message cannot be written: that gets lost.
    void put(std::string_view text);

    ConsoleOptions options_;
    std::FILE* out_;
    bool terminal_, color_;
    std::string redrawn_; ///< on the terminal now
};

/// Columns of the terminal behind `file`, or 80.
[[nodiscard]] std::size_t terminal_width(std::FILE* file);

} // namespace fraja::client
