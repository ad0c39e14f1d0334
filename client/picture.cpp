#include "client/picture.hpp"

#include "common/base/version.hpp"
#include "common/net/clock.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <string>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration rewrite_pause = 500ms;

static_assert(std::endian::native == std::endian::little, "pixels travel little-endian");

/// The floats of a tile: its blobs one after the other. A float may be cut in two.
std::vector<float> floats_of(const std::vector<Blob>& blobs, std::size_t float_count) {
    std::vector<float> rgb(float_count);
    auto* to = reinterpret_cast<std::byte*>(rgb.data());
    std::size_t left = float_count * sizeof(float);
    for (const Blob& blob : blobs) {
        FRAJA_ASSERT(blob->size() <= left);
        if (!blob->empty())
            std::memcpy(to, blob->data(), blob->size());
        to += blob->size();
        left -= blob->size();
    }
    FRAJA_ASSERT(left == 0);
    return rgb;
}

} // namespace

Picture::Picture(const protocol::PictureSettings& settings) : film_(settings.size, settings.crop) {}

void Picture::place(const protocol::TileDone& tile) {
    film_.place(Tile{tile.rect, floats_of(tile.blobs, 3 * tile.rect.pixel_count())});
    pixels_placed_ += tile.rect.pixel_count();
}

Result<void> Picture::write(const std::filesystem::path& path,
                            const std::vector<PictureAttribute>& attributes) const {
    return write_picture(path, film_, attributes);
}

std::vector<PictureAttribute> picture_attributes(const ContentHash& scene,
                                                 const protocol::PictureSettings& s) {
    return {{"Software", "Fraja " + std::string(fraja::version)},
            {"fraja:scene", fraja::to_string(scene)},
            {"fraja:size", std::to_string(s.size.width) + "x" + std::to_string(s.size.height)},
            {"fraja:depth", std::to_string(s.depth)},
            {"fraja:aa", std::to_string(s.aa)},
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

void LivePicture::begin(const protocol::JobState& job, std::filesystem::path path) {
    picture_.emplace(job.settings);
    path_ = std::move(path);
    attributes_ = picture_attributes(job.scene, job.settings);
}

void LivePicture::place(const protocol::TileDone& tile) {
    FRAJA_ASSERT(picture_.has_value());
    picture_->place(tile);
    changed_ = true;
}

Result<Instant> LivePicture::tick(Instant now) {
    if (!changed_)
        return Instant::never();
    if (now < due_)
        return due_;
    const Instant begin = net::now();
    if (auto written = finish(); !written)
        return written.error();
    const Duration took = net::now() - begin;
    due_ = now + took + std::max<Duration>(rewrite_pause, 4 * took);
    return Instant::never();
}

Result<void> LivePicture::finish() {
    if (!changed_)
        return {};
    changed_ = false;
    return picture_->write(path_, attributes_);
}

} // namespace fraja::client
