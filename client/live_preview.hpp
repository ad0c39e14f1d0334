// LivePreview: the picture so far on the terminal, above the line that is redrawn.
#pragma once

#include "client/console.hpp"
#include "client/preview/preview.hpp"
#include "common/base/instant.hpp"
#include "common/image/film.hpp"

namespace fraja::client {

/// Drawn when something has come or the window is another: at most four times a second, and no more
/// than a fifth of the time.
class LivePreview {
public:
    /// The console must outlive this. `mode` as chosen().
    LivePreview(Console& console, PreviewMode mode);

    /// Where it is left to us, what is best on that terminal; on none, and on one where no colours
    /// are wanted, none.
    [[nodiscard]] static PreviewMode chosen(PreviewMode mode, const Console& console);

    [[nodiscard]] bool is_on() const { return mode_ != PreviewMode::none; }
    void note_change() { changed_ = true; }
    /// Draws what is due. Returns when it wants to be called next.
    Instant tick(Instant now, const Film& film);
    /// Draws how it is at the end.
    void finish(const Film& film);

private:
    void draw(const Film& film);

    Console& console_;
    PreviewMode mode_;
    ColorDepth depth_;
    bool changed_ = false;
    Window drawn_in_;
    Instant due_{};
};

} // namespace fraja::client
