#include "common/image_io/picture_file.hpp"

#include "common/base/text.hpp"
#include "common/image_io/picture_codec.hpp"
#include "common/image_io/replace_file.hpp"

#include <algorithm>
#include <array>
#include <cctype>

namespace fraja {
namespace {

struct Format {
    std::string_view extension;
    PixelKind kind;
    std::uint32_t side_max;
};

// OpenImageIO knows more; these are the ones whose pixels, and bytes, our tests vouch for.
// The limits are libjpeg's, Targa's and libpng's own; the last serves for those that have none.
constexpr std::array formats{
    Format{".png", PixelKind::levels8, 1'000'000}, Format{".exr", PixelKind::radiance, 1'000'000},
    Format{".tif", PixelKind::levels8, 1'000'000}, Format{".tiff", PixelKind::levels8, 1'000'000},
    Format{".jpg", PixelKind::levels8, 65'500},    Format{".jpeg", PixelKind::levels8, 65'500},
    Format{".bmp", PixelKind::levels8, 1'000'000}, Format{".ppm", PixelKind::levels8, 1'000'000},
    Format{".tga", PixelKind::levels8, 65'535}};

std::string lower_case(std::string text) {
    std::ranges::transform(text, text.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return text;
}

/// The format that the extension of `path` names, if its sides can be that long.
Result<Format> find_format(const std::filesystem::path& path, Extent extent) {
    const std::string extension = lower_case(path.extension().string());
    std::array<std::string_view, formats.size()> names;
    std::string all;
    for (std::size_t i = 0; i < formats.size(); ++i) {
        const Format& format = formats[i];
        if (format.extension == extension) {
            if (extent.width <= format.side_max && extent.height <= format.side_max)
                return format;
            return Error{ErrorCode::invalid_argument,
                         path.string() + ": pictures of this format have at most " +
                             std::to_string(format.side_max) + " pixels a side"};
        }
        names[i] = format.extension.substr(1);
        all.append(" ").append(format.extension);
    }
    std::string message = path.string();
    if (extension.size() < 2)
        message.append(": the extension names the format; use one of").append(all);
    else if (const auto nearest = nearest_name(extension.substr(1), names))
        message += ": unknown extension" + did_you_mean("." + std::string(*nearest));
    else
        message.append(": unknown extension; use one of").append(all);
    return Error{ErrorCode::invalid_argument, std::move(message)};
}

/// Encodes in memory and then writes the file ourselves: where a disk is full, libjpeg would end
/// the process, and others close their file without a word.
Result<void> write_file(const std::filesystem::path& path, const PictureToEncode& picture) {
    const auto codec = picture_codec();
    if (!codec)
        return codec.error();
    const auto bytes = (*codec)->encode(picture);
    if (!bytes)
        return io_error(path, bytes.error().message);
    return replace_file(path, std::as_bytes(std::span(*bytes)));
}

Result<void> write_levels_as(const Format& format, const std::filesystem::path& path,
                             const LevelsView& levels) {
    return write_file(path, {.format = format.extension.substr(1),
                             .extent = levels.extent,
                             .window = {0, 0, levels.extent.width, levels.extent.height},
                             .pixels = levels.rgb,
                             .channels = {},
                             .attributes = {}});
}

Result<void> write_radiance_as(const Format& format, const std::filesystem::path& path,
                               const Film& film, std::span<const PictureAttribute> attributes,
                               bool half) {
    const std::size_t pixel_count = film.region().pixel_count();
    std::vector<std::string_view> names;
    std::vector<std::span<const float>> planes;
    if (!film.error().empty()) {
        names = {"samples", "error"};
        planes = {film.samples(), film.error()};
    }
    for (std::size_t i = 0; !film.layers().empty() && i < layer_names.size(); ++i) {
        names.push_back(layer_names[i]);
        planes.push_back(film.layers().subspan(i * pixel_count, pixel_count));
    }
    PictureToEncode picture{.format = format.extension.substr(1),
                            .extent = film.size(),
                            .window = film.region(),
                            .pixels = film.pixels(),
                            .channels = names,
                            .half = half,
                            .attributes = attributes};
    if (planes.empty())
        return write_file(path, picture);
    std::vector<float> all;
    all.reserve((3 + planes.size()) * pixel_count);
    for (std::size_t i = 0; i < pixel_count; ++i) {
        const auto rgb = film.pixels().subspan(3 * i, 3);
        all.insert(all.end(), rgb.begin(), rgb.end());
        for (const auto& plane : planes)
            all.push_back(plane[i]);
    }
    picture.pixels = std::span<const float>(all);
    return write_file(path, picture);
}

} // namespace

Result<PixelKind> pixel_kind(const std::filesystem::path& path) {
    const auto format = find_format(path, {1, 1});
    if (!format)
        return format.error();
    return format->kind;
}

Result<void> check_writable(const std::filesystem::path& path, Extent extent) {
    if (const auto format = find_format(path, extent); !format)
        return format.error();
    if (const auto replaceable = check_replaceable(path); !replaceable)
        return replaceable.error();
    if (const auto codec = picture_codec(); !codec)
        return codec.error();
    return {};
}

Result<void> write_picture(const std::filesystem::path& path, const Film& film,
                           std::span<const PictureAttribute> attributes,
                           const PictureEncoding& encoding) {
    FRAJA_ASSERT(!film.region().empty());
    const Extent extent{film.region().width, film.region().height};
    const auto format = find_format(path, extent);
    if (!format)
        return format.error();
    if (format->kind == PixelKind::radiance)
        return write_radiance_as(*format, path, film, attributes, encoding.half);
    const auto levels = quantise(film.pixels(), encoding.transfer);
    return write_levels_as(*format, path, {extent, levels});
}

Result<void> write_levels(const std::filesystem::path& path, const LevelsView& levels) {
    FRAJA_ASSERT(levels.extent.pixel_count() > 0);
    FRAJA_ASSERT(levels.rgb.size() == 3 * levels.extent.pixel_count());
    const auto format = find_format(path, levels.extent);
    if (!format)
        return format.error();
    if (format->kind != PixelKind::levels8)
        return Error{ErrorCode::invalid_argument,
                     path.string() + ": this format holds linear floats, not 8-bit levels"};
    return write_levels_as(*format, path, levels);
}

Result<LevelsPicture> read_levels(const std::filesystem::path& path) {
    const auto codec = picture_codec();
    if (!codec)
        return codec.error();
    return (*codec)->read_levels(path);
}

Result<RadiancePicture> read_radiance(const std::filesystem::path& path) {
    const auto codec = picture_codec();
    if (!codec)
        return codec.error();
    return (*codec)->read_radiance(path);
}

} // namespace fraja
