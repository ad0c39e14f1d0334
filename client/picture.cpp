#include "client/picture.hpp"

#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/image/quantise.hpp"
#include "common/net/clock.hpp"
#include "common/protocol/passes.hpp"
#include "common/protocol/pixels.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fmt/core.h>
#include <string>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration rewrite_pause = 500ms;

Tile tile_of(const protocol::TileDone& done, const protocol::PictureSettings& settings) {
    const std::size_t pixels = done.rect.pixel_count();
    std::vector<float> floats = protocol::floats_of(done.blobs);
    FRAJA_ASSERT(floats.size() * sizeof(float) == pixels * settings.pixel_bytes());
    Tile tile{.rect = done.rect, .rgb = {}};
    auto from = floats.begin() + static_cast<std::ptrdiff_t>(3 * pixels);
    const auto next = [&](std::size_t count) {
        const auto begin = from;
        from += static_cast<std::ptrdiff_t>(count);
        return std::vector<float>(begin, from);
    };
    if (settings.estimates()) {
        tile.samples = next(pixels);
        tile.error = next(pixels);
    } else if (settings.limited_in_time()) {
        tile.variance = next(pixels);
        tile.cut = next(pixels);
    }
    floats.resize(3 * pixels);
    tile.rgb = std::move(floats);
    return tile;
}

PassFilm pass_film(const protocol::PictureSettings& settings, std::uint32_t cell_count) {
    std::vector<std::uint32_t> samples(protocol::pass_count(settings));
    for (std::uint32_t pass = 0; pass < samples.size(); ++pass)
        samples[pass] = protocol::pass_of(pass).count;
    const std::size_t tiles = cell_count / samples.size();
    return {settings.size, settings.crop, std::move(samples), tiles};
}

} // namespace

Picture::Picture(const protocol::PictureSettings& settings)
    : settings_(settings),
      film_(settings.size, settings.crop,
            settings.estimates() ? Film::Keeps::estimates : Film::Keeps::colours) {}

void Picture::place(const protocol::TileDone& tile, std::uint32_t cell_count) {
    if (tile.pass == 0)
        pixels_placed_ += tile.rect.pixel_count();
    if (!settings_.limited_in_time())
        return film_.place(tile_of(tile, settings_));
    if (!passes_) {
        passes_.emplace(pass_film(settings_, cell_count));
        film_ = Film(settings_.size, {}); // not needed any more
    }
    passes_->place(tile.pass, tile_of(tile, settings_));
}

std::optional<Estimate> Picture::estimate() const {
    const auto error = film().error();
    if (error.empty() || pixels_placed_ < error.size())
        return std::nullopt;
    Estimate e;
    for (std::size_t i = 0; i < error.size(); ++i) {
        e.samples += static_cast<double>(film().samples()[i]);
        e.rms_error += static_cast<double>(error[i]) * static_cast<double>(error[i]);
        if (settings_.error > 0 &&
            2 * film().samples()[i] > static_cast<float>(settings_.max_samples) &&
            levels_per_unit * static_cast<double>(error[i]) > settings_.error)
            ++e.pixels_at_ceiling;
    }
    const auto pixels = static_cast<double>(error.size());
    e.samples /= pixels;
    e.rms_error = std::sqrt(e.rms_error / pixels);
    return e;
}

Result<void> Picture::write(const std::filesystem::path& path,
                            const std::vector<PictureAttribute>& attributes) const {
    std::vector<PictureAttribute> more = attributes;
    if (passes_)
        more.push_back({"fraja:passes", std::to_string(passes_->passes_done())});
    if (const auto estimated = estimate())
        more.push_back({"fraja:rms_error", fmt::format("{:.6g}", estimated->rms_error)});
    return write_picture(path, film(), more);
}

std::vector<PictureAttribute> picture_attributes(const ContentHash& scene,
                                                 const protocol::PictureSettings& s) {
    return {{"Software", "Fraja " + std::string(fraja::version)},
            {"fraja:scene", fraja::to_string(scene)},
            {"fraja:size", std::to_string(s.size.width) + "x" + std::to_string(s.size.height)},
            {"fraja:depth", std::to_string(s.depth)},
            {"fraja:aa", std::to_string(s.aa)},
            {"fraja:spp", std::to_string(s.spp)},
            {"fraja:error", fmt::format("{}", s.error)},
            {"fraja:max_samples", std::to_string(s.max_samples)},
            {"fraja:filter", to_string(s.filter)},
            {"fraja:exact", s.exact ? "true" : "false"},
            {"fraja:kernel", to_string(s.kernel)}};
}

std::string to_string(protocol::KernelChoice kernel) {
    switch (kernel) {
    case protocol::KernelChoice::reference:
        return "reference";
    case protocol::KernelChoice::fast:
        return "fast";
    }
    return "unknown";
}

std::string to_string(protocol::PixelFilter filter) {
    switch (filter) {
    case protocol::PixelFilter::box:
        return "box";
    case protocol::PixelFilter::tent:
        return "tent";
    }
    return "unknown";
}

std::string settings_text(const protocol::PictureSettings& s) {
    std::string text = fmt::format("depth {}, ", s.depth);
    if (s.error > 0)
        text += fmt::format("error {} with at most {} samples, ", s.error, s.max_samples);
    else if (s.limited_in_time())
        text += fmt::format("time limit {} s with at most {} samples, ", seconds(s.time_limit),
                            s.max_samples);
    else if (s.spp > 0)
        text += fmt::format("spp {}, ", s.spp);
    else
        text += fmt::format("aa {}, ", s.aa);
    if (s.filter != protocol::PixelFilter::box)
        text += fmt::format("filter {}, ", to_string(s.filter));
    return text + (s.exact ? "exact, " : "") + "kernel " + to_string(s.kernel);
}

void PictureFile::begin(const protocol::JobState& job, std::filesystem::path path) {
    path_ = std::move(path);
    attributes_ = picture_attributes(job.scene, job.settings);
    changed_ = false;
}

Result<Instant> PictureFile::tick(Instant now, const Picture& picture) {
    if (!changed_)
        return Instant::never();
    if (now < due_)
        return due_;
    const Instant begin = net::now();
    if (auto written = finish(picture); !written)
        return written.error();
    const Duration took = net::now() - begin;
    due_ = now + took + std::max<Duration>(rewrite_pause, 4 * took);
    return Instant::never();
}

Result<void> PictureFile::finish(const Picture& picture) {
    if (!changed_)
        return {};
    changed_ = false;
    return picture.write(path_, attributes_);
}

} // namespace fraja::client
