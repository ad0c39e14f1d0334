// Samples of pixels, gathered until there are enough to be drawn together.
#pragma once

#include "common/render/render.hpp"
#include "common/render/sampling/places.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

namespace fraja {

/// Some samples of one pixel, as they were drawn.
struct PixelRun {
    std::uint32_t pixel;                  ///< as it was asked for
    std::uint32_t first;                  ///< of its samples; the greatest number there is if above
    std::span<const double> rgb;          ///< three to a sample
    std::span<const double> lost;         ///< likewise; empty if not asked for
    std::span<const double> cut;          ///< likewise
    std::span<const std::uint64_t> paths; ///< empty if not asked for
    std::span<const std::uint32_t> rays;
};

/// What is asked of each sample beside its light.
struct SampleExtras {
    bool lost = false, cut = false, paths = false;
};

/// Draws blocks and hands them out pixel by pixel, in the order in which they were asked for.
class SampleQueue {
public:
    SampleQueue(const CompiledScene& scene, const RenderSettings& settings, PixelRect places,
                RenderControl& control);
    ~SampleQueue();

    /// Asks for samples first .. first + count - 1 of a pixel of `places`. `collect(run)` is called
    /// for whatever is drawn meanwhile. False: error() says why.
    template <class F>
    [[nodiscard]] bool add(std::uint32_t pixel, std::uint32_t column, std::uint32_t row,
                           std::uint64_t first, std::uint64_t count, F&& collect) {
        while (count > 0) {
            if (full() && !draw(collect))
                return false;
            const std::uint32_t added = put(pixel, column, row, first, count);
            first += added, count -= added;
        }
        return true;
    }
    /// Draws the rest.
    template <class F>
    [[nodiscard]] bool draw(F&& collect) {
        if (!draw_block())
            return false;
        for (std::size_t i = 0, sample = 0; i < run_count(); ++i)
            collect(run(i, sample));
        clear();
        return true;
    }

    /// From now on.
    void set_extras(SampleExtras extras) { extras_ = extras; }
    [[nodiscard]] const Error& error() const { return *error_; }
    /// Of all that was drawn, but for pixels.
    [[nodiscard]] const RayCounts& rays() const { return rays_; }
    /// For the block handed out nothing was searched for.
    [[nodiscard]] bool skipped() const { return skipped_; }
    /// A sample of the block handed out has more than rays_per_sample_max rays.
    [[nodiscard]] bool budget_spent() const { return budget_spent_; }

private:
    struct Buffers;

    [[nodiscard]] bool full() const { return samples_ == block_samples_max; }
    std::uint32_t put(std::uint32_t pixel, std::uint32_t column, std::uint32_t row,
                      std::uint64_t first, std::uint64_t count);
    [[nodiscard]] bool draw_block();
    [[nodiscard]] std::size_t run_count() const { return run_count_; }
    [[nodiscard]] PixelRun run(std::size_t index, std::size_t& sample) const;
    void clear() { run_count_ = samples_ = 0; }

    const CompiledScene& scene_;
    const RenderSettings& settings_;
    const SamplePlaces places_;
    RenderControl& control_;
    SampleExtras extras_;
    RayCounts rays_;
    bool skipped_ = false, budget_spent_ = false;
    std::optional<Error> error_;
    std::uint32_t run_count_ = 0, samples_ = 0;
    std::unique_ptr<Buffers> buffers_;
};

/// Calls f(column, row) for the pixels of a rectangle in squares of four by four, which kernels
/// draw together, until it answers false.
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

} // namespace fraja
