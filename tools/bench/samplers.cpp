#include "tools/bench/samplers.hpp"

#include "common/render/sampling/owen_sobol.hpp"
#include "tools/bench/measure.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <unordered_map>
#include <vector>

namespace fraja {
namespace {

struct Colour {
    double rgb[3] = {};
    Colour& operator+=(const Colour& o) {
        for (int c = 0; c < 3; ++c)
            rgb[c] += o.rgb[c];
        return *this;
    }
};
Colour operator*(double weight, const Colour& c) {
    return {{weight * c.rgb[0], weight * c.rgb[1], weight * c.rgb[2]}};
}
double difference(const Colour& a, const Colour& b) {
    return std::abs(a.rgb[0] - b.rgb[0]) + std::abs(a.rgb[1] - b.rgb[1]) +
           std::abs(a.rgb[2] - b.rgb[2]);
}

/// Places to look at, in pixels, and what is seen there.
class Samples {
public:
    Samples(const CompiledScene& scene, const RenderSettings& settings, RenderControl& control)
        : scene_(scene), settings_(settings), control_(control) {}

    void add(double x, double y) {
        x_.push_back(x / settings_.size.width);
        y_.push_back(y / settings_.size.height);
    }
    /// Of all that were added since the last time.
    std::vector<Colour> draw() {
        std::vector<Colour> seen(x_.size());
        std::vector<double> rgb(3 * block_samples_max);
        std::vector<std::uint32_t> rays(block_samples_max);
        for (std::size_t first = 0; first < x_.size(); first += block_samples_max) {
            const std::size_t n = std::min<std::size_t>(block_samples_max, x_.size() - first);
            const auto drawn = scene_.draw_samples(settings_,
                                                   {.x = {x_.data() + first, n},
                                                    .y = {y_.data() + first, n},
                                                    .rgb = {rgb.data(), 3 * n},
                                                    .lost = {},
                                                    .cut = {},
                                                    .paths = {},
                                                    .rays = {rays.data(), n}},
                                                   control_);
            if (!drawn)
                fail(drawn.error().message);
            counts_ += drawn->rays;
            for (std::size_t i = 0; i < n; ++i)
                for (std::size_t c = 0; c < 3; ++c)
                    seen[first + i].rgb[c] = rgb[3 * i + c];
        }
        x_.clear(), y_.clear();
        return seen;
    }
    [[nodiscard]] const RayCounts& counts() const { return counts_; }

private:
    const CompiledScene& scene_;
    const RenderSettings& settings_;
    RenderControl& control_;
    std::vector<double> x_, y_;
    RayCounts counts_;
};

double fraction(std::uint64_t key) {
    return (mixed(key) + 0.5) * 0x1p-32;
}

/// n x n places of a pixel, one in each cell.
void add_jittered(Samples& samples, std::uint32_t column, std::uint32_t row, std::uint32_t n) {
    const std::uint64_t key = std::uint64_t{mixed(std::uint64_t{row} << 32 | column)} << 20;
    for (std::uint32_t i = 0; i < n * n; ++i)
        samples.add(column + (i % n + fraction(key + 2 * i)) / n,
                    row + (i / n + fraction(key + 2 * i + 1)) / n);
}

RenderedTile tile_of(PixelRect rect, const std::vector<Colour>& pixels, const Samples& samples) {
    RenderedTile tile{.tile = {.rect = rect, .rgb = {}}};
    for (const Colour& pixel : pixels)
        for (const double component : pixel.rgb)
            tile.tile.rgb.push_back(static_cast<float>(component));
    tile.rays = samples.counts();
    return tile;
}

} // namespace

std::string text_of(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%g", value);
    return text;
}

RenderedTile JitteredSampler::draw(const CompiledScene& scene, const RenderSettings& settings,
                                   PixelRect rect, RenderControl& control) const {
    Samples samples(scene, settings, control);
    for (std::uint32_t row = rect.y; row < rect.y + rect.height; ++row)
        for (std::uint32_t column = rect.x; column < rect.x + rect.width; ++column)
            add_jittered(samples, column, row, n);
    const std::vector<Colour> seen = samples.draw();
    std::vector<Colour> pixels(rect.pixel_count());
    for (std::size_t i = 0; i < seen.size(); ++i)
        pixels[i / (n * n)] += 1.0 / (n * n) * seen[i];
    return tile_of(rect, pixels, samples);
}

RenderedTile ContrastSampler::draw(const CompiledScene& scene, const RenderSettings& settings,
                                   PixelRect rect, RenderControl& control) const {
    Samples samples(scene, settings, control);
    // The pixels to the left and above, and those right and below, which look at this tile's.
    const std::uint32_t left = std::max(rect.x, 1u) - 1, top = std::max(rect.y, 1u) - 1;
    const std::uint32_t right = std::min(rect.x + rect.width + 1, settings.size.width);
    const std::uint32_t bottom = std::min(rect.y + rect.height + 1, settings.size.height);
    const std::uint32_t width = right - left;
    for (std::uint32_t row = top; row < bottom; ++row)
        for (std::uint32_t column = left; column < right; ++column)
            samples.add(column + 0.5, row + 0.5);
    const std::vector<Colour> middle = samples.draw();
    std::vector<bool> contrasts(middle.size());
    const auto compare = [&](std::size_t a, std::size_t b) {
        if (difference(middle[a], middle[b]) > threshold)
            contrasts[a] = contrasts[b] = true;
    };
    for (std::uint32_t y = 0; y < bottom - top; ++y)
        for (std::uint32_t x = 0; x < width; ++x) {
            const std::size_t i = std::size_t{y} * width + x;
            if (x > 0)
                compare(i, i - 1);
            if (y > 0)
                compare(i, i - width);
        }
    std::vector<Colour> pixels(rect.pixel_count());
    std::vector<std::size_t> refined;
    for (std::size_t i = 0; i < pixels.size(); ++i) {
        const auto column = rect.x + static_cast<std::uint32_t>(i % rect.width);
        const auto row = rect.y + static_cast<std::uint32_t>(i / rect.width);
        const std::size_t at = std::size_t{row - top} * width + (column - left);
        pixels[i] = middle[at];
        if (!contrasts[at])
            continue;
        refined.push_back(i);
        add_jittered(samples, column, row, n);
    }
    const std::vector<Colour> seen = samples.draw();
    for (std::size_t k = 0; k < refined.size(); ++k) {
        Colour sum = pixels[refined[k]];
        for (std::size_t i = 0; i < n * n; ++i)
            sum += seen[k * n * n + i];
        pixels[refined[k]] = 1.0 / (n * n + 1) * sum;
    }
    return tile_of(rect, pixels, samples);
}

RenderedTile SubdividingSampler::draw(const CompiledScene& scene, const RenderSettings& settings,
                                      PixelRect rect, RenderControl& control) const {
    Samples samples(scene, settings, control);
    // Corners by place, in units of the smallest part.
    const std::uint32_t side = 1u << depth;
    std::unordered_map<std::uint64_t, Colour> corners;
    std::vector<std::uint64_t> wanted;
    const auto key_of = [](std::uint64_t x, std::uint64_t y) { return y << 32 | x; };
    const auto want = [&](std::uint64_t x, std::uint64_t y) {
        if (corners.try_emplace(key_of(x, y)).second) {
            wanted.push_back(key_of(x, y));
            samples.add(static_cast<double>(x) / side, static_cast<double>(y) / side);
        }
    };
    struct Part {
        std::size_t pixel;
        std::uint64_t x, y, size;
    };
    std::vector<Part> parts;
    for (std::size_t i = 0; i < rect.pixel_count(); ++i)
        parts.push_back({i, side * (rect.x + std::uint64_t{i % rect.width}),
                         side * (rect.y + std::uint64_t{i / rect.width}), side});
    std::vector<Colour> pixels(rect.pixel_count());
    while (!parts.empty()) {
        for (const Part& p : parts)
            for (const std::uint64_t dy : {std::uint64_t{0}, p.size})
                for (const std::uint64_t dx : {std::uint64_t{0}, p.size})
                    want(p.x + dx, p.y + dy);
        const std::vector<Colour> seen = samples.draw();
        for (std::size_t i = 0; i < wanted.size(); ++i)
            corners[wanted[i]] = seen[i];
        wanted.clear();
        std::vector<Part> smaller;
        for (const Part& p : parts) {
            const Colour corner[] = {corners[key_of(p.x, p.y)], corners[key_of(p.x + p.size, p.y)],
                                     corners[key_of(p.x, p.y + p.size)],
                                     corners[key_of(p.x + p.size, p.y + p.size)]};
            bool differ = false;
            for (int a = 0; a < 4; ++a)
                for (int b = a + 1; b < 4; ++b)
                    differ |= difference(corner[a], corner[b]) > threshold;
            const std::uint64_t half = p.size / 2;
            if (differ && half > 0) {
                for (const std::uint64_t dy : {std::uint64_t{0}, half})
                    for (const std::uint64_t dx : {std::uint64_t{0}, half})
                        smaller.push_back({p.pixel, p.x + dx, p.y + dy, half});
                continue;
            }
            const double share = static_cast<double>(p.size) / side;
            for (const Colour& c : corner)
                pixels[p.pixel] += 0.25 * share * share * c;
        }
        parts = std::move(smaller);
    }
    return tile_of(rect, pixels, samples);
}

} // namespace fraja
