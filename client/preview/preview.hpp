// Preview: a picture so far as a terminal shows it. Which way is chosen by what the terminal can;
// what is made of a picture depends on nothing but the arguments.
#pragma once

#include "client/preview/blocks.hpp"
#include "client/preview/fit.hpp"
#include "common/base/result.hpp"
#include "common/image/film.hpp"

#include <cstdint>
#include <functional>
#include <string>

namespace fraja::client {

enum class PreviewMode : std::uint8_t { automatic, kitty, sixel, blocks, none };

/// What the environment says of a terminal.
struct TerminalWords {
    /// TERM, TERM_PROGRAM, COLORTERM; empty: unset
    std::string term{}, term_program{}, colorterm{};
    bool kitty_window = false; ///< KITTY_WINDOW_ID
    bool multiplexed = false;  ///< TMUX or STY: others' pictures get lost in there
};
[[nodiscard]] TerminalWords terminal_words();

/// What is best on a terminal with colours: kitty's protocol where it is known to be understood,
/// sixels where `has_sixel` says so (it is asked last, as that takes time), else blocks; none where
/// the terminal cannot move its cursor. Never automatic.
[[nodiscard]] PreviewMode best_mode(const TerminalWords& words,
                                    const std::function<bool()>& has_sixel);
[[nodiscard]] ColorDepth color_depth(const TerminalWords& words);

/// What is written to show it, from the cursor's place on; the cursor may be anywhere afterwards.
struct Preview {
    std::string bytes;
    std::uint32_t rows = 0; ///< that it takes
    std::string removal;    ///< what is written to take it away, beyond clearing its rows
};

/// The film's region, as large as the window allows. `mode` is kitty, sixel or blocks. Errors: as
/// check_sixel().
[[nodiscard]] Result<Preview> make_preview(const Film& film, const Window& window, PreviewMode mode,
                                           ColorDepth depth);

} // namespace fraja::client
