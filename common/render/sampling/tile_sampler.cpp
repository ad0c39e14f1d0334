#include "common/render/sampling/tile_sampler.hpp"

#include "common/image/quantise.hpp"
#include "common/render/layers.hpp"
#include "common/render/sampling/estimate.hpp"
#include "common/render/sampling/sample_queue.hpp"

#include <algorithm>
#include <limits>
#include <vector>

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

/// Calls f(square) for the parts of a rectangle, until it answers false.
template <class F>
bool for_each_square(PixelRect rect, std::uint32_t side, F&& f) {
    for (std::uint32_t y = 0; y < rect.height; y += side)
        for (std::uint32_t x = 0; x < rect.width; x += side)
            if (!f({rect.x + x, rect.y + y, std::min(side, rect.width - x),
                    std::min(side, rect.height - y)}))
                return false;
    return true;
}

std::uint32_t index_in(const PixelRect& rect, std::uint32_t column, std::uint32_t row) {
    return (row - rect.y) * rect.width + (column - rect.x);
}

/// What few settings, or few pixels, need.
class Losses {
public:
    Losses(std::uint64_t pixels, bool wanted) : pixels_(pixels), wanted_(wanted) {}

    void add(const PixelRun& run, bool budget_spent) {
        if (!wanted_ && !budget_spent)
            return;
        of_.resize(pixels_);
        Loss& loss = of_[run.pixel];
        for (std::size_t i = 0; i < run.lost.size(); ++i)
            loss.rgb[i % 3] += run.lost[i];
        for (const std::uint32_t rays : run.rays)
            loss.budget_spent |= rays > rays_per_sample_max;
    }
    [[nodiscard]] std::uint64_t budgets_spent() const {
        return static_cast<std::uint64_t>(std::ranges::count(of_, true, &Loss::budget_spent));
    }
    /// Of a pixel's samples, in the colour that has the most.
    [[nodiscard]] double greatest(std::size_t pixel) const {
        const auto& rgb = of_[pixel].rgb;
        return *std::max_element(rgb, rgb + 3);
    }

private:
    struct Loss {
        double rgb[3] = {};
        bool budget_spent = false;
    };
    std::uint64_t pixels_;
    bool wanted_;
    std::vector<Loss> of_;
};

} // namespace

// --------------------------------------------------------------------------------- as many for
// each

Result<RenderedTile> draw_uniform(const CompiledScene& scene, const RenderSettings& settings,
                                  PixelRect rect, RenderControl& control) {
    RenderedTile result{.tile = {.rect = rect, .rgb = {}}};
    struct Sum {
        double rgb[3] = {};
    };
    std::vector<Sum> sums(rect.pixel_count());
    const bool judges = settings.estimates() || settings.pass;
    std::vector<PixelSamples> judged(judges && settings.depth > 0 ? rect.pixel_count() : 0,
                                     PixelSamples(settings.spp));
    Losses losses(rect.pixel_count(), settings.truncation);
    SampleQueue queue(scene, settings, rect, control);
    queue.set_extras({.lost = settings.truncation, .cut = judges});
    std::uint64_t skipped_pixels = 0;
    const auto collect = [&](const PixelRun& run) {
        skipped_pixels += queue.skipped() && run.first == settings.first_sample;
        double* const sum = sums[run.pixel].rgb;
        for (std::size_t i = 0; i < run.rgb.size(); i += 3)
            sum[0] += run.rgb[i], sum[1] += run.rgb[i + 1], sum[2] += run.rgb[i + 2];
        if (!judged.empty())
            judged[run.pixel].add(run.rgb, run.cut);
        losses.add(run, queue.budget_spent());
    };
    const std::uint64_t per_pixel = settings.depth == 0 ? 1 : settings.samples_per_pixel();
    const bool drawn = for_each_square(rect, block_side(per_pixel), [&](PixelRect square) {
        return for_each_pixel(square,
                              [&](std::uint32_t column, std::uint32_t row) {
                                  return queue.add(index_in(rect, column, row), column, row,
                                                   settings.first_sample, per_pixel, collect);
                              }) &&
               queue.draw(collect);
    });
    if (!drawn)
        return queue.error();
    const double weight = 1.0 / static_cast<double>(per_pixel);
    result.tile.rgb.resize(3 * sums.size());
    float* to = result.tile.rgb.data();
    for (const Sum& sum : sums)
        for (const double component : sum.rgb)
            *to++ = as_float(component * weight);
    if (settings.estimates()) {
        result.tile.samples.assign(sums.size(), static_cast<float>(settings.spp));
        result.tile.error.assign(sums.size(), 0.0F);
    }
    if (settings.pass) {
        result.tile.variance.assign(sums.size(), 0.0F);
        result.tile.cut.assign(sums.size(), 0.0F);
    }
    BaseSamples unknown; // what is around
    unknown.one_path = false;
    for (std::size_t i = 0; i < judged.size(); ++i) {
        judged[i].judge();
        if (settings.pass) {
            const double spread = judged[i].spread();
            result.tile.variance[i] = as_float(spread * spread);
            result.tile.cut[i] = as_float(judged[i].cut());
        } else {
            result.tile.error[i] = as_float(judged[i].error(unknown));
        }
    }
    if (settings.truncation)
        for (std::size_t i = 0; i < sums.size(); ++i)
            result.truncated.push_back(as_float(losses.greatest(i) * weight));
    result.rays = queue.rays();
    result.rays.skipped_pixels = skipped_pixels;
    result.rays.truncated_pixels = losses.budgets_spent();
    return result;
}

// ----------------------------------------------------------------------------- as many as needed

namespace {

/// The pixels of a tile and those around it, in the picture.
PixelRect with_frame(PixelRect rect, Extent size) {
    const std::uint32_t left = std::max(rect.x, 1u) - 1, top = std::max(rect.y, 1u) - 1;
    const std::uint32_t right = std::min(rect.x + rect.width + 1, size.width);
    const std::uint32_t bottom = std::min(rect.y + rect.height + 1, size.height);
    return {left, top, right - left, bottom - top};
}

struct Pixel {
    std::uint32_t column, row;
};

/// How many of a pixel's base samples the one beside it looks at: all within a cell of the
/// picture; across a cell's border one, of every other pixel. A tile of whole cells so draws
/// 66 samples for what is around it and not 528, and a border still is not a blind spot: from each
/// pixel at least one is seen beyond it.
std::uint32_t samples_seen(Pixel beside, Pixel from) {
    constexpr std::uint32_t cell_side = 32;
    if (beside.column / cell_side == from.column / cell_side &&
        beside.row / cell_side == from.row / cell_side)
        return base_samples;
    return (beside.column + beside.row) % 2 == 0 ? 1 : 0;
}

class AdaptiveTile {
public:
    AdaptiveTile(const CompiledScene& scene, const RenderSettings& settings, PixelRect rect,
                 RenderControl& control)
        : settings_(settings), rect_(rect), around_(with_frame(rect, settings.size)),
          queue_(scene, settings, around_, control), base_(around_.pixel_count()),
          base_around_pixel_(rect.pixel_count()), pixels_(rect.pixel_count()),
          losses_(rect.pixel_count(), settings.truncation) {}

    Result<RenderedTile> draw() {
        if (!draw_base() || !refine())
            return queue_.error();
        return result();
    }

private:
    [[nodiscard]] bool draw_base();
    [[nodiscard]] bool refine();
    [[nodiscard]] bool enough(std::uint32_t pixel);
    [[nodiscard]] std::uint32_t samples_needed(Pixel beside) const;
    [[nodiscard]] BaseSamples base_around(Pixel pixel) const;
    [[nodiscard]] RenderedTile result() const;

    const RenderSettings& settings_;
    PixelRect rect_, around_;
    SampleQueue queue_;
    struct Seen {
        BaseSamples first, all;
    };
    std::vector<Seen> base_; ///< of around_
    std::vector<BaseSamples> base_around_pixel_;
    std::vector<PixelSamples> pixels_;
    Losses losses_;
    std::uint64_t skipped_pixels_ = 0;
    struct Waiting {
        std::uint32_t pixel;
        Pixel at;
    };
    std::vector<Waiting> waiting_; ///< for more samples
};

/// Of a pixel beside the tile.
std::uint32_t AdaptiveTile::samples_needed(Pixel beside) const {
    std::uint32_t most = 0;
    for_each_pixel(with_frame({beside.column, beside.row, 1, 1}, settings_.size),
                   [&](std::uint32_t column, std::uint32_t row) {
                       if (PixelRect{column, row, 1, 1}.inside(rect_))
                           most = std::max(most, samples_seen(beside, {column, row}));
                       return true;
                   });
    return most;
}

bool AdaptiveTile::draw_base() {
    queue_.set_extras({.lost = settings_.truncation, .cut = true, .paths = true});
    const auto collect = [&](PixelRun run) {
        Seen& seen = base_[run.pixel];
        if (run.first == 0)
            seen.first.add(run.rgb.first(3), run.paths.first(1), true);
        seen.all.add(run.rgb, run.paths, run.first == 0);
        const std::uint32_t column = around_.x + run.pixel % around_.width;
        const std::uint32_t row = around_.y + run.pixel / around_.width;
        if (!PixelRect{column, row, 1, 1}.inside(rect_))
            return;
        skipped_pixels_ += queue_.skipped() && run.first == 0;
        run.pixel = index_in(rect_, column, row);
        pixels_[run.pixel].add(run.rgb, run.cut);
        losses_.add(run, queue_.budget_spent());
    };
    const auto add = [&](std::uint32_t column, std::uint32_t row, std::uint32_t count) {
        return queue_.add(index_in(around_, column, row), column, row, 0, count, collect);
    };
    const bool drawn =
        for_each_square(rect_, block_side(base_samples),
                        [&](PixelRect square) {
                            return for_each_pixel(square,
                                                  [&](std::uint32_t column, std::uint32_t row) {
                                                      return add(column, row, base_samples);
                                                  }) &&
                                   queue_.draw(collect);
                        }) &&
        for_each_pixel(around_,
                       [&](std::uint32_t column, std::uint32_t row) {
                           return PixelRect{column, row, 1, 1}.inside(rect_) ||
                                  add(column, row, samples_needed({column, row}));
                       }) &&
        queue_.draw(collect);
    if (!drawn)
        return false;
    for_each_pixel(rect_, [&](std::uint32_t column, std::uint32_t row) {
        const std::uint32_t pixel = index_in(rect_, column, row);
        base_around_pixel_[pixel] = base_around({column, row});
        if (!enough(pixel))
            waiting_.push_back({pixel, {column, row}});
        return true;
    });
    return true;
}

/// Doubles the samples of those that wait, until none does.
bool AdaptiveTile::refine() {
    queue_.set_extras({.lost = settings_.truncation, .cut = true});
    const auto collect = [&](const PixelRun& run) {
        pixels_[run.pixel].add(run.rgb, run.cut);
        losses_.add(run, queue_.budget_spent());
    };
    while (!waiting_.empty()) {
        for (const auto& [pixel, at] : waiting_) {
            const std::uint32_t count = pixels_[pixel].count();
            pixels_[pixel].double_expected();
            if (!queue_.add(pixel, at.column, at.row, count, count, collect))
                return false;
        }
        if (!queue_.draw(collect))
            return false;
        std::erase_if(waiting_, [&](const Waiting& waiting) { return enough(waiting.pixel); });
    }
    return true;
}

bool AdaptiveTile::enough(std::uint32_t index) {
    PixelSamples& pixel = pixels_[index];
    pixel.judge();
    return pixel.count() > settings_.max_samples / 2 ||
           pixel.bound(base_around_pixel_[index]) <= settings_.error / levels_per_unit;
}

BaseSamples AdaptiveTile::base_around(Pixel pixel) const {
    BaseSamples joined = base_[index_in(around_, pixel.column, pixel.row)].all;
    for_each_pixel(with_frame({pixel.column, pixel.row, 1, 1}, settings_.size),
                   [&](std::uint32_t column, std::uint32_t row) {
                       const Seen& seen = base_[index_in(around_, column, row)];
                       const std::uint32_t samples = samples_seen({column, row}, pixel);
                       if (samples > 0)
                           joined.join(samples == 1 ? seen.first : seen.all);
                       return true;
                   });
    return joined;
}

RenderedTile AdaptiveTile::result() const {
    RenderedTile result{.tile = {.rect = rect_, .rgb = {}}};
    for (std::size_t i = 0; i < pixels_.size(); ++i) {
        const PixelSamples& pixel = pixels_[i];
        for (const double component : pixel.mean())
            result.tile.rgb.push_back(as_float(component));
        result.tile.samples.push_back(static_cast<float>(pixel.count()));
        result.tile.error.push_back(as_float(pixel.error(base_around_pixel_[i])));
        if (settings_.truncation)
            result.truncated.push_back(as_float(losses_.greatest(i) / pixel.count()));
    }
    result.rays = queue_.rays();
    result.rays.skipped_pixels = skipped_pixels_;
    result.rays.truncated_pixels = losses_.budgets_spent();
    return result;
}

} // namespace

Result<RenderedTile> draw_adaptive(const CompiledScene& scene, const RenderSettings& settings,
                                   PixelRect rect, RenderControl& control) {
    return AdaptiveTile(scene, settings, rect, control).draw();
}

Result<RenderedTile> CompiledScene::render_tile(const RenderSettings& settings, PixelRect rect,
                                                RenderControl& control) const {
    FRAJA_ASSERT(!rect.empty() && rect.inside(settings.size));
    auto tile = settings.adaptive() ? draw_adaptive(*this, settings, rect, control)
                                    : draw_uniform(*this, settings, rect, control);
    if (tile && settings.layers)
        if (const auto added = add_layers(*this, settings, *tile, control); !added)
            return added.error();
    return tile;
}

} // namespace fraja
