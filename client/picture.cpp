#include "client/picture.hpp"

#include "client/settings_text.hpp"
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
    if (settings.layers)
        tile.layers = next(layer_names.size() * pixels);
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
    : settings_(settings), film_(settings.size, settings.crop,
                                 {.estimates = settings.estimates(), .layers = settings.layers}) {}

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

void Picture::withdraw(const PixelRect& rect) {
    FRAJA_ASSERT(!settings_.limited_in_time());
    pixels_placed_ -= rect.pixel_count();
    protocol::TileDone black;
    black.rect = rect;
    black.blobs = {Blob(Bytes(rect.pixel_count() * settings_.pixel_bytes()))};
    film_.place(tile_of(black, settings_));
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

Result<void> Picture::write(const std::filesystem::path& path, const protocol::JobState& job,
                            const PictureEncoding& encoding,
                            const std::string& more_options) const {
    std::vector<PictureAttribute> more = picture_attributes(job, more_options);
    if (passes_)
        more.push_back({"fraja:passes", std::to_string(passes_->passes_done())});
    if (const auto estimated = estimate())
        more.push_back({"fraja:rms_error", fmt::format("{:.6g}", estimated->rms_error)});
    return write_picture(path, film(), more, encoding);
}

void PictureFile::begin(const protocol::JobState& job, std::filesystem::path path,
                        const PictureEncoding& encoding) {
    path_ = std::move(path);
    job_ = job;
    encoding_ = encoding;
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
    return picture.write(path_, job_, encoding_);
}

} // namespace fraja::client
