#include "common/render/sampling/sample_queue.hpp"

#include <algorithm>

namespace fraja {

struct SampleQueue::Buffers {
    struct Run {
        std::uint32_t pixel, first;
        std::uint16_t samples;
    };
    Run runs[block_samples_max];
    double x[block_samples_max], y[block_samples_max];
    double rgb[3 * block_samples_max], lost[3 * block_samples_max], cut[3 * block_samples_max];
    std::uint64_t paths[block_samples_max];
    std::uint32_t rays[block_samples_max];
};

SampleQueue::SampleQueue(const CompiledScene& scene, const RenderSettings& settings,
                         PixelRect places, RenderControl& control)
    : scene_(scene), settings_(settings), places_(settings, places, scene.two_pictures()),
      control_(control), buffers_(new Buffers) {}

SampleQueue::~SampleQueue() = default;

/// As many as there is room for.
std::uint32_t SampleQueue::put(std::uint32_t pixel, std::uint32_t column, std::uint32_t row,
                               std::uint64_t first, std::uint64_t count) {
    Buffers& b = *buffers_;
    const auto now =
        static_cast<std::uint32_t>(std::min<std::uint64_t>(count, block_samples_max - samples_));
    places_.fill(column, row, first, now, b.x + samples_, b.y + samples_);
    b.runs[run_count_++] = {pixel,
                            static_cast<std::uint32_t>(std::min<std::uint64_t>(first, UINT32_MAX)),
                            static_cast<std::uint16_t>(now)};
    samples_ += now;
    return now;
}

bool SampleQueue::draw_block() {
    Buffers& b = *buffers_;
    const std::size_t n = samples_;
    if (n == 0)
        return true;
    const auto if_asked = [](bool asked, auto* buffer, std::size_t count) {
        return asked ? std::span(buffer, count) : std::span(buffer, 0);
    };
    const auto drawn = scene_.draw_samples(settings_,
                                           {.x = {b.x, n},
                                            .y = {b.y, n},
                                            .rgb = {b.rgb, 3 * n},
                                            .lost = if_asked(extras_.lost, b.lost, 3 * n),
                                            .cut = if_asked(extras_.cut, b.cut, 3 * n),
                                            .paths = if_asked(extras_.paths, b.paths, n),
                                            .rays = {b.rays, n}},
                                           control_);
    if (!drawn) {
        error_ = drawn.error();
        return false;
    }
    rays_ += drawn->rays;
    budget_spent_ = drawn->budget_spent;
    skipped_ = drawn->skipped;
    return true;
}

/// `sample`: where it starts, then where the next one does.
PixelRun SampleQueue::run(std::size_t index, std::size_t& sample) const {
    const Buffers& b = *buffers_;
    const std::size_t begin = sample, n = b.runs[index].samples;
    sample += n;
    PixelRun run{.pixel = b.runs[index].pixel,
                 .first = b.runs[index].first,
                 .rgb = {b.rgb + 3 * begin, 3 * n},
                 .lost = {},
                 .cut = {},
                 .paths = {},
                 .rays = {b.rays + begin, n}};
    if (extras_.lost)
        run.lost = {b.lost + 3 * begin, 3 * n};
    if (extras_.cut)
        run.cut = {b.cut + 3 * begin, 3 * n};
    if (extras_.paths)
        run.paths = {b.paths + begin, n};
    return run;
}

} // namespace fraja
