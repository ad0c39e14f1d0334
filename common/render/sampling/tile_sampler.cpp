#include "common/render/sampling/tile_sampler.hpp"

#include <algorithm>
#include <limits>

namespace fraja {
namespace {

/// The last guard: absurd colours (1e300 times 1e300) must not put into a picture what is no
/// number.
float as_float(double radiance) {
    constexpr double most = static_cast<double>(std::numeric_limits<float>::max());
    const double positive = radiance > 0 ? radiance : 0;
    return static_cast<float>(positive < most ? positive : most);
}

constexpr std::uint32_t block_side_max = 32; ///< pixels

/// Blocks are as square as they can be, so that their rays go the same way.
std::uint32_t block_side(std::uint64_t samples_per_pixel) {
    std::uint32_t side = block_side_max;
    while (side > 1 && side * side * samples_per_pixel > block_samples_max)
        side /= 2;
    return side;
}

/// Calls f(column, row) for the pixels of a rectangle in squares of four by four, which a kernel
/// draws together, until it answers false.
template <class F>
bool for_each_pixel(PixelRect rect, F&& f) {
    constexpr std::uint32_t side = 4;
    const std::uint32_t right = rect.x + rect.width, bottom = rect.y + rect.height;
    for (std::uint32_t y = rect.y; y < bottom; y += side)
        for (std::uint32_t x = rect.x; x < right; x += side)
            for (std::uint32_t row = y; row < std::min(y + side, bottom); ++row)
                for (std::uint32_t column = x; column < std::min(x + side, right); ++column)
                    if (!f(column, row))
                        return false;
    return true;
}

} // namespace

/// The block at work.
struct TileSampler::Buffers {
    /// A pixel's samples, behind those of the one before.
    struct Span {
        std::uint32_t pixel;
        std::uint16_t samples;
        bool first; ///< among them is the pixel's first
    };
    Span spans[block_samples_max];
    std::uint32_t span_count = 0, samples = 0;
    double x[block_samples_max], y[block_samples_max];
    double rgb[3 * block_samples_max];
    double lost[3 * block_samples_max];
    std::uint32_t rays[block_samples_max];
};

TileSampler::TileSampler(const CompiledScene& scene, const RenderSettings& settings, PixelRect rect,
                         RenderControl& control)
    : scene_(scene), settings_(settings), places_(settings, rect),
      control_(control), result_{.tile = {.rect = rect, .rgb = {}}, .rays = {}, .truncated = {}},
      pixels_(rect.pixel_count()), buffers_(new Buffers) {}

Result<RenderedTile> TileSampler::draw() {
    if (!draw_all_alike())
        return *error_;
    finish();
    return std::move(result_);
}

bool TileSampler::draw_all_alike() {
    const std::uint64_t per_pixel = settings_.depth == 0 ? 1 : settings_.samples_per_pixel();
    const std::uint32_t side = block_side(per_pixel);
    const PixelRect& rect = result_.tile.rect;
    for (std::uint32_t y = 0; y < rect.height; y += side)
        for (std::uint32_t x = 0; x < rect.width; x += side) {
            const PixelRect square{rect.x + x, rect.y + y, std::min(side, rect.width - x),
                                   std::min(side, rect.height - y)};
            const bool drawn = for_each_pixel(square, [&](std::uint32_t column, std::uint32_t row) {
                return add(column, row, 0, per_pixel);
            });
            if (!drawn || !draw_block())
                return false;
        }
    return true;
}

/// Asks for samples of a pixel.
bool TileSampler::add(std::uint32_t column, std::uint32_t row, std::uint64_t first,
                      std::uint64_t count) {
    const PixelRect& rect = result_.tile.rect;
    const std::uint32_t pixel = (row - rect.y) * rect.width + (column - rect.x);
    Buffers& b = *buffers_;
    while (count > 0) {
        if (b.samples == block_samples_max && !draw_block())
            return false;
        const auto now = static_cast<std::uint32_t>(
            std::min<std::uint64_t>(count, block_samples_max - b.samples));
        places_.fill(column, row, first, now, b.x + b.samples, b.y + b.samples);
        b.spans[b.span_count++] = {pixel, static_cast<std::uint16_t>(now), first == 0};
        b.samples += now, first += now, count -= now;
    }
    return true;
}

/// Draws what was asked for, if anything.
bool TileSampler::draw_block() {
    Buffers& b = *buffers_;
    const std::size_t n = b.samples;
    if (n == 0)
        return true;
    const auto drawn = scene_.draw_samples(
        settings_,
        {.x = {b.x, n},
         .y = {b.y, n},
         .rgb = {b.rgb, 3 * n},
         .lost = settings_.truncation ? std::span(b.lost, 3 * n) : std::span<double>(),
         .paths = {},
         .rays = {b.rays, n}},
        control_);
    if (!drawn) {
        error_ = drawn.error();
        return false;
    }
    collect(*drawn);
    b.span_count = b.samples = 0;
    return true;
}

/// To their pixels.
void TileSampler::collect(const DrawnBlock& drawn) {
    const Buffers& b = *buffers_;
    result_.rays += drawn.rays;
    const double* rgb = b.rgb;
    for (std::size_t s = 0; s < b.span_count; ++s) {
        Pixel& pixel = pixels_[b.spans[s].pixel];
        pixel.samples += b.spans[s].samples;
        for (const double* const end = rgb + 3 * b.spans[s].samples; rgb < end; rgb += 3)
            pixel.rgb[0] += rgb[0], pixel.rgb[1] += rgb[1], pixel.rgb[2] += rgb[2];
    }
    if (drawn.skipped)
        for (std::size_t s = 0; s < b.span_count; ++s)
            result_.rays.skipped_pixels += b.spans[s].first;
    if (settings_.truncation || drawn.budget_spent)
        collect_losses();
}

void TileSampler::collect_losses() {
    const Buffers& b = *buffers_;
    losses_.resize(pixels_.size());
    std::size_t i = 0;
    for (std::size_t s = 0; s < b.span_count; ++s) {
        Loss& loss = losses_[b.spans[s].pixel];
        for (const std::size_t end = i + b.spans[s].samples; i < end; ++i) {
            if (settings_.truncation)
                for (std::size_t c = 0; c < 3; ++c)
                    loss.rgb[c] += b.lost[3 * i + c];
            loss.budget_spent |= b.rays[i] > rays_per_sample_max;
        }
    }
}

void TileSampler::finish() {
    result_.tile.rgb.resize(3 * pixels_.size());
    float* rgb = result_.tile.rgb.data();
    std::uint64_t samples = 1;
    double weight = 1;
    for (const Pixel& pixel : pixels_) {
        if (pixel.samples != samples)
            samples = pixel.samples, weight = 1.0 / static_cast<double>(samples);
        for (const double sum : pixel.rgb)
            *rgb++ = as_float(sum * weight);
    }
    for (const Loss& loss : losses_)
        result_.rays.truncated_pixels += loss.budget_spent;
    if (settings_.truncation)
        for (std::size_t i = 0; i < pixels_.size(); ++i)
            result_.truncated.push_back(
                as_float(*std::max_element(losses_[i].rgb, losses_[i].rgb + 3) /
                         static_cast<double>(pixels_[i].samples)));
}

Result<RenderedTile> CompiledScene::render_tile(const RenderSettings& settings, PixelRect rect,
                                                RenderControl& control) const {
    FRAJA_ASSERT(!rect.empty() && rect.inside(settings.size));
    return TileSampler(*this, settings, rect, control).draw();
}

} // namespace fraja
