#include "client/live_preview.hpp"

#include "client/preview/sixel.hpp"
#include "common/net/clock.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration redraw_pause = 250ms;
constexpr std::uint32_t rows_left = 2; // of the window: for the line below, and one above

} // namespace

LivePreview::LivePreview(Console& console, PreviewMode mode)
    : console_(console), mode_(mode), depth_(color_depth(terminal_words())) {}

PreviewMode LivePreview::chosen(PreviewMode mode, const Console& console) {
    if (!console.is_terminal())
        return PreviewMode::none;
    if (mode != PreviewMode::automatic)
        return mode;
    if (!console.uses_color())
        return PreviewMode::none;
    return best_mode(terminal_words(),
                     [&] { return check_sixel().has_value() && console.answers_sixel(); });
}

Instant LivePreview::tick(Instant now, const Film& film) {
    if (!is_on() || (!changed_ && console_.window() == drawn_in_))
        return Instant::never();
    if (now < due_)
        return due_;
    const Instant begin = net::now();
    draw(film);
    const Duration took = net::now() - begin;
    due_ = now + took + std::max<Duration>(redraw_pause, 4 * took);
    return Instant::never();
}

void LivePreview::finish(const Film& film) {
    if (is_on() && changed_)
        draw(film);
}

void LivePreview::draw(const Film& film) {
    changed_ = false;
    drawn_in_ = console_.window();
    Window room = drawn_in_;
    room.rows -= std::min(rows_left, room.rows - 1);
    auto picture = make_preview(film, room, mode_, depth_);
    if (picture)
        return console_.show(*std::move(picture));
    console_.warning("no preview: " + picture.error().message);
    mode_ = PreviewMode::none;
}

} // namespace fraja::client
