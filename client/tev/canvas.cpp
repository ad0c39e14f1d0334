#include "client/tev/canvas.hpp"

#include "client/tev/packets.hpp"
#include "common/base/assert.hpp"

#include <algorithm>
#include <utility>

namespace fraja::client::tev {
namespace {

bool contains(const PixelRect& outer, const PixelRect& inner) {
    return inner.x >= outer.x && inner.y >= outer.y &&
           inner.x + inner.width <= outer.x + outer.width &&
           inner.y + inner.height <= outer.y + outer.height;
}

PixelRect around(const PixelRect& a, const PixelRect& b) {
    const std::uint32_t x = std::min(a.x, b.x), y = std::min(a.y, b.y);
    return {x, y, std::max(a.x + a.width, b.x + b.width) - x,
            std::max(a.y + a.height, b.y + b.height) - y};
}

} // namespace

void Canvas::begin(std::string name, const Film& film) {
    name_ = std::move(name);
    std::erase(name_, '\0');
    region_ = film.region();
    rgb_.assign(3 * region_.pixel_count(), 0.0F);
    flush_.clear();
    send_all();
}

void Canvas::update(PixelRect rect, const Film& film) {
    FRAJA_ASSERT(film.region() == region_ && contains(region_, rect));
    rect.x -= region_.x;
    rect.y -= region_.y;
    for (std::size_t y = 0; y < rect.height; ++y) {
        const std::size_t at = 3 * ((rect.y + y) * region_.width + rect.x);
        const auto row = film.pixels().subspan(at, std::size_t{3} * rect.width);
        std::ranges::copy(row, rgb_.begin() + static_cast<std::ptrdiff_t>(at));
    }
    mark(rect);
}

void Canvas::mark(PixelRect rect) {
    const auto holds = [](const PixelRect& a) {
        return [a](const PixelRect& b) { return contains(a, b); };
    };
    if (std::ranges::any_of(dirty_, [&](const PixelRect& d) { return contains(d, rect); }))
        return;
    std::erase_if(dirty_, holds(rect));
    dirty_.push_back(rect);
    if (dirty_.size() <= dirty_max)
        return;
    for (const PixelRect& d : dirty_)
        rect = around(rect, d);
    dirty_ = {rect};
}

void Canvas::send_all() {
    create_ = region_.pixel_count() > 0;
    dirty_.clear();
    if (create_)
        dirty_.push_back({0, 0, region_.width, region_.height});
}

void Canvas::begin_flush() {
    opening_.clear();
    flush_.clear();
    if (std::exchange(create_, false)) { // another one of that name would stay beside it
        opening_.push_back(close_image(name_));
        opening_.push_back(create_image(name_, true, {region_.width, region_.height}));
    }
    for (const PixelRect& d : std::exchange(dirty_, {})) {
        const auto rows = static_cast<std::uint32_t>(
            std::max<std::size_t>(1, update_bytes / (sizeof(float) * 3 * d.width)));
        for (std::uint32_t y = 0; y < d.height; y += rows)
            flush_.push_back({d.x, d.y + y, d.width, std::min(rows, d.height - y)});
    }
}

std::optional<Bytes> Canvas::next_packet() {
    if (!opening_.empty()) {
        Bytes packet = std::move(opening_.front());
        opening_.pop_front();
        return packet;
    }
    if (flush_.empty())
        return std::nullopt;
    const PixelRect rect = flush_.front();
    flush_.pop_front();
    std::vector<float> rgb;
    rgb.reserve(3 * rect.pixel_count());
    for (std::size_t y = rect.y; y < std::size_t{rect.y} + rect.height; ++y) {
        const auto begin =
            rgb_.begin() + static_cast<std::ptrdiff_t>(3 * (y * region_.width + rect.x));
        rgb.insert(rgb.end(), begin, begin + std::ptrdiff_t{3} * rect.width);
    }
    return update_image(name_, rect, rgb);
}

} // namespace fraja::client::tev
