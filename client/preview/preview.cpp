#include "client/preview/preview.hpp"

#include "client/preview/kitty.hpp"
#include "client/preview/shrink.hpp"
#include "client/preview/sixel.hpp"
#include "common/base/assert.hpp"

#include <cstdlib>
#include <unistd.h>
#include <utility>

namespace fraja::client {
namespace {

/// The same for all pictures of this process: each takes the place of the one before.
std::uint32_t kitty_id() {
    return static_cast<std::uint32_t>(getpid());
}

std::string variable(const char* name) {
    const char* value = std::getenv(name);
    return value ? value : "";
}

} // namespace

TerminalWords terminal_words() {
    return {.term = variable("TERM"),
            .term_program = variable("TERM_PROGRAM"),
            .colorterm = variable("COLORTERM"),
            .kitty_window = !variable("KITTY_WINDOW_ID").empty(),
            .multiplexed = !variable("TMUX").empty() || !variable("STY").empty()};
}

PreviewMode best_mode(const TerminalWords& w, const std::function<bool()>& has_sixel) {
    if (w.term.empty() || w.term == "dumb")
        return PreviewMode::none;
    const bool kitty = w.kitty_window || w.term == "xterm-kitty" || w.term == "xterm-ghostty" ||
                       w.term_program == "ghostty" || w.term_program == "WezTerm";
    if (kitty && !w.multiplexed)
        return PreviewMode::kitty;
    return has_sixel() ? PreviewMode::sixel : PreviewMode::blocks;
}

ColorDepth color_depth(const TerminalWords& w) {
    const bool direct =
        w.colorterm == "truecolor" || w.colorterm == "24bit" || w.term.ends_with("-direct");
    return direct ? ColorDepth::direct : ColorDepth::indexed;
}

Result<Preview> make_preview(const Film& film, const Window& window, PreviewMode mode,
                             ColorDepth depth) {
    const Extent size{film.region().width, film.region().height};
    switch (mode) {
    case PreviewMode::kitty: {
        const Fit fit = fit_kitty(size, window);
        return Preview{kitty_image(shrink(film, fit.pixels), kitty_id(), fit.columns, fit.rows),
                       fit.rows, kitty_removal(kitty_id())};
    }
    case PreviewMode::sixel: {
        const Fit fit = fit_sixel(size, window);
        auto image = sixel_image(shrink(film, fit.pixels));
        if (!image)
            return image.error();
        return Preview{*std::move(image), fit.rows, ""};
    }
    case PreviewMode::blocks: {
        const Fit fit = fit_blocks(size, window);
        return Preview{blocks_image(shrink(film, fit.pixels), depth), fit.rows, ""};
    }
    case PreviewMode::automatic:
    case PreviewMode::none:
        break;
    }
    FRAJA_ASSERT(false && "a preview in no way");
    return Preview{};
}

} // namespace fraja::client
