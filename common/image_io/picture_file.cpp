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
    std::string extension; ///< in lower case
    PixelKind kind;
};

struct NamedFormat {
    std::string_view extension;
    PixelKind kind;
};

// Those that help texts and messages name. They are known without loading OpenImageIO, which knows
// more; these are also the ones whose pixels, and bytes, our tests vouch for.
constexpr std::array named_formats{
    NamedFormat{".png", PixelKind::levels8},  NamedFormat{".exr", PixelKind::radiance_and_more},
    NamedFormat{".tif", PixelKind::levels8},  NamedFormat{".tiff", PixelKind::levels8},
    NamedFormat{".jpg", PixelKind::levels8},  NamedFormat{".jpeg", PixelKind::levels8},
    NamedFormat{".bmp", PixelKind::levels8},  NamedFormat{".ppm", PixelKind::levels8},
    NamedFormat{".tga", PixelKind::levels8},  NamedFormat{".hdr", PixelKind::radiance},
    NamedFormat{".webp", PixelKind::levels8}, NamedFormat{".dpx", PixelKind::levels8}};

std::string lower_case(std::string text) {
    std::ranges::transform(text, text.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return text;
}

/// " .png .exr ...".
std::string all_names() {
    std::string all;
    for (const NamedFormat& format : named_formats)
        all.append(" ").append(format.extension);
    return all;
}

/// What may have been meant by an extension that is unknown.
std::string cure_of(std::string_view extension) {
    std::array<std::string_view, named_formats.size()> names;
    std::ranges::transform(named_formats, names.begin(),
                           [](const NamedFormat& f) { return f.extension.substr(1); });
    if (const auto nearest = nearest_name(extension.substr(1), names))
        return did_you_mean("." + std::string(*nearest));
    return "; use one of" + all_names();
}

/// In lower case. Errors: there is none.
Result<std::string> extension_of(const std::filesystem::path& path) {
    std::string extension = lower_case(path.extension().string());
    if (extension.size() < 2)
        return Error{ErrorCode::invalid_argument,
                     path.string() + ": the extension names the format; use one of" + all_names()};
    return extension;
}

const NamedFormat* named_format(std::string_view extension) {
    const auto* const named = std::ranges::find(named_formats, extension, &NamedFormat::extension);
    return named != named_formats.end() ? named : nullptr;
}

/// What there is to say of one that the codec does not write.
Error refusal(const std::filesystem::path& path, std::string_view extension, const Error& why) {
    std::string message = path.string() + ": ";
    if (named_format(extension))
        message += "the OpenImageIO here was built without this format; use .png or .exr";
    else if (why.code == ErrorCode::not_found)
        message += why.message + cure_of(extension);
    else
        message += "this format is not written: " + why.message + "; use one of" + all_names();
    return {ErrorCode::invalid_argument, std::move(message)};
}

/// What the codec says of an extension.
Result<PictureFormat> ask_codec(const std::filesystem::path& path, std::string_view extension) {
    const auto codec = picture_codec();
    if (!codec)
        return codec.error();
    const auto format = (*codec)->format_of(extension.substr(1));
    if (!format)
        return refusal(path, extension, format.error());
    return *format;
}

/// The format that the extension of `path` names, if its sides can be that long.
Result<Format> find_format(const std::filesystem::path& path, Extent extent) {
    const auto extension = extension_of(path);
    if (!extension)
        return extension.error();
    const auto format = ask_codec(path, *extension);
    if (!format)
        return format.error();
    if (extent.width > format->side_max || extent.height > format->side_max)
        return Error{ErrorCode::invalid_argument,
                     path.string() + ": pictures of this format have at most " +
                         std::to_string(format->side_max) + " pixels a side"};
    return Format{*extension, format->kind};
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

/// Colours alone, of a picture that stands for itself.
Result<void> write_plain_as(const Format& format, const std::filesystem::path& path, Extent extent,
                            decltype(PictureToEncode::pixels) pixels) {
    return write_file(path, {.format = std::string_view(format.extension).substr(1),
                             .extent = extent,
                             .window = {0, 0, extent.width, extent.height},
                             .pixels = pixels,
                             .channels = {},
                             .attributes = {}});
}

Result<void> write_all_as(const Format& format, const std::filesystem::path& path, const Film& film,
                          std::span<const PictureAttribute> attributes, bool half) {
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
    PictureToEncode picture{.format = std::string_view(format.extension).substr(1),
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
    const auto extension = extension_of(path);
    if (!extension)
        return extension.error();
    if (const NamedFormat* const named = named_format(*extension))
        return named->kind;
    const auto format = ask_codec(path, *extension);
    if (!format)
        return format.error();
    return format->kind;
}

Result<void> check_writable(const std::filesystem::path& path, Extent extent) {
    if (const auto format = find_format(path, extent); !format)
        return format.error();
    return check_replaceable(path);
}

Result<void> write_picture(const std::filesystem::path& path, const Film& film,
                           std::span<const PictureAttribute> attributes,
                           const PictureEncoding& encoding) {
    FRAJA_ASSERT(!film.region().empty());
    const Extent extent{film.region().width, film.region().height};
    const auto format = find_format(path, extent);
    if (!format)
        return format.error();
    if (format->kind == PixelKind::radiance_and_more)
        return write_all_as(*format, path, film, attributes, encoding.half);
    if (format->kind == PixelKind::radiance)
        return write_plain_as(*format, path, extent, film.pixels());
    const auto levels = quantise(film.pixels(), encoding.transfer);
    return write_plain_as(*format, path, extent, levels);
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
    return write_plain_as(*format, path, levels.extent, levels.rgb);
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
