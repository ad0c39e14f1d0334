#include "common/image_io/picture_file.hpp"

#include "common/base/text.hpp"
#include "common/image/quantise.hpp"
#include "common/image_io/replace_file.hpp"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <algorithm>
#include <array>
#include <cctype>
#include <memory>
#include <string_view>

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

/// OpenEXR would start a pool as wide as the machine, under the feet of the render threads. One
/// picture at the end of a job needs none. (So would OpenImageIO, but not where a file is taken row
/// by row; its attribute "threads" would start the pool before it makes it small.)
void keep_openexr_to_one_thread() {
    static const bool done = OIIO::attribute("exr_threads", -1);
    static_cast<void>(done);
}

/// The reason OpenImageIO gives, on one line.
std::string reason_of(std::string text) {
    while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back())))
        text.pop_back();
    std::ranges::replace(text, '\n', ' ');
    return text.empty() ? "OpenImageIO gives no reason" : text;
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
        message.append(": unknown extension (did you mean '.").append(*nearest).append("'?)");
    else
        message.append(": unknown extension; use one of").append(all);
    return Error{ErrorCode::invalid_argument, std::move(message)};
}

bool write_rows(OIIO::ImageOutput& out, const OIIO::ImageSpec& spec, const void* pixels) {
    const auto* row = static_cast<const std::byte*>(pixels);
    for (int y = spec.y; y < spec.y + spec.height; ++y, row += spec.scanline_bytes())
        if (!out.write_scanline(y, 0, spec.format, row))
            return false;
    return true;
}

/// Encodes in memory and then writes the file ourselves: where a disk is full, libjpeg would end
/// the process, and others close their file without a word.
Result<void> write_file(const std::filesystem::path& path, const Format& format,
                        OIIO::ImageSpec spec, const void* pixels) {
    keep_openexr_to_one_thread();
    std::vector<unsigned char> bytes;
    OIIO::Filesystem::IOVecOutput memory(bytes);
    OIIO::Filesystem::IOProxy* proxy = &memory;
    spec.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    const std::string name(format.extension.substr(1));
    const std::unique_ptr<OIIO::ImageOutput> out = OIIO::ImageOutput::create(name);
    if (!out)
        return io_error(path, reason_of(OIIO::geterror()));
    if (!out->open("picture." + name, spec) || !write_rows(*out, spec, pixels) || !out->close())
        return io_error(path, reason_of(out->geterror()));
    return replace_file(path, std::as_bytes(std::span(bytes)));
}

OIIO::ImageSpec rgb_spec(std::uint32_t width, std::uint32_t height, OIIO::TypeDesc type) {
    OIIO::ImageSpec spec(static_cast<int>(width), static_cast<int>(height), 3, type);
    // Where this is missing, .tif and .exr get the time of day, and no two files are equal.
    spec.attribute("DateTime", "");
    return spec;
}

Result<void> write_levels_as(const Format& format, const std::filesystem::path& path,
                             const LevelsView& levels) {
    auto spec = rgb_spec(levels.extent.width, levels.extent.height, OIIO::TypeUInt8);
    if (format.extension.starts_with(".jp")) { // .png would keep it as text
        spec.attribute("Compression", "jpeg:95");
        spec.attribute("jpeg:subsampling", "4:4:4"); // colours as sharp as brightness
    }
    return write_file(path, format, std::move(spec), levels.rgb.data());
}

Result<void> write_radiance_as(const Format& format, const std::filesystem::path& path,
                               const Film& film, std::span<const PictureAttribute> attributes) {
    const PixelRect region = film.region();
    auto spec = rgb_spec(region.width, region.height, OIIO::TypeFloat);
    const bool estimates = !film.error().empty();
    if (estimates) {
        spec.nchannels = 5;
        spec.channelnames = {"R", "G", "B", "samples", "error"};
    }
    spec.x = static_cast<int>(region.x);
    spec.y = static_cast<int>(region.y);
    spec.full_width = static_cast<int>(film.size().width);
    spec.full_height = static_cast<int>(film.size().height);
    for (const PictureAttribute& attribute : attributes)
        spec.attribute(attribute.name, attribute.value);
    if (!estimates)
        return write_file(path, format, std::move(spec), film.pixels().data());
    std::vector<float> all;
    all.reserve(5 * region.pixel_count());
    for (std::size_t i = 0; i < region.pixel_count(); ++i) {
        const auto rgb = film.pixels().subspan(3 * i, 3);
        all.insert(all.end(), rgb.begin(), rgb.end());
        all.push_back(film.samples()[i]);
        all.push_back(film.error()[i]);
    }
    return write_file(path, format, std::move(spec), all.data());
}

Result<std::unique_ptr<OIIO::ImageInput>> open_file(const std::filesystem::path& path) {
    keep_openexr_to_one_thread();
    std::error_code ec;
    if (!std::filesystem::exists(path, ec))
        return io_error(path, ec ? ec.message() : "there is no such file");
    // Levels as they stand: no multiplication with alpha.
    OIIO::ImageSpec wishes;
    wishes.attribute("oiio:UnassociatedAlpha", 1);
    std::unique_ptr<OIIO::ImageInput> in = OIIO::ImageInput::open(path.string(), &wishes);
    if (!in)
        return io_error(path, reason_of(OIIO::geterror()));
    return in;
}

/// All channels of the first picture in the file.
template <class T>
Result<std::vector<T>> read_channels(const std::filesystem::path& path, OIIO::ImageInput& in) {
    const OIIO::ImageSpec& spec = in.spec();
    if (spec.width < 1 || spec.height < 1 || spec.depth != 1 || spec.nchannels < 1)
        return io_error(path, "this is not a flat picture");
    const auto width = static_cast<std::uint64_t>(spec.width);
    const std::uint64_t pixel_count = width * static_cast<std::uint64_t>(spec.height);
    const auto channels = static_cast<std::size_t>(spec.nchannels);
    if (pixel_count > picture_pixels_max || channels > 5)
        return Error{ErrorCode::limit_exceeded, path.string() + ": too many pixels or channels"};
    std::vector<T> all(pixel_count * channels);
    for (int y = 0; y < spec.height; ++y)
        if (!in.read_scanline(spec.y + y, 0, OIIO::BaseTypeFromC<T>::value,
                              &all[static_cast<std::size_t>(y) * width * channels]))
            return io_error(path, reason_of(in.geterror()));
    return all;
}

/// Of those channels the three that are colours.
template <class T>
std::vector<T> colours_of(std::vector<T> all, std::size_t channels) {
    if (channels == 3)
        return all;
    const std::size_t pixel_count = all.size() / channels;
    std::vector<T> rgb(pixel_count * 3);
    for (std::size_t i = 0; i < pixel_count; ++i)
        for (std::size_t c = 0; c < 3; ++c)
            rgb[3 * i + c] = all[channels * i + (channels < 3 ? 0 : c)];
    return rgb;
}

/// One of those channels, by its name; empty without it.
std::vector<float> channel_of(const std::vector<float>& all, const OIIO::ImageSpec& spec,
                              std::string_view name) {
    const int index = spec.channelindex(name);
    std::vector<float> values;
    if (index >= 0)
        for (auto i = static_cast<std::size_t>(index); i < all.size();
             i += static_cast<std::size_t>(spec.nchannels))
            values.push_back(all[i]);
    return values;
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
    return check_replaceable(path);
}

Result<void> write_picture(const std::filesystem::path& path, const Film& film,
                           std::span<const PictureAttribute> attributes) {
    FRAJA_ASSERT(!film.region().empty());
    const Extent extent{film.region().width, film.region().height};
    const auto format = find_format(path, extent);
    if (!format)
        return format.error();
    if (format->kind == PixelKind::radiance)
        return write_radiance_as(*format, path, film, attributes);
    const auto levels = quantise(film.pixels());
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
    const auto in = open_file(path);
    if (!in)
        return in.error();
    const OIIO::ImageSpec& spec = (*in)->spec();
    if (spec.format != OIIO::TypeUInt8)
        return io_error(path, std::string("holds ") + spec.format.c_str() + ", not 8-bit levels");
    auto all = read_channels<std::uint8_t>(path, **in);
    if (!all)
        return all.error();
    return LevelsPicture{
        {static_cast<std::uint32_t>(spec.width), static_cast<std::uint32_t>(spec.height)},
        colours_of(*std::move(all), static_cast<std::size_t>(spec.nchannels))};
}

Result<RadiancePicture> read_radiance(const std::filesystem::path& path) {
    const auto in = open_file(path);
    if (!in)
        return in.error();
    const OIIO::ImageSpec& spec = (*in)->spec();
    if (spec.format != OIIO::TypeFloat && spec.format != OIIO::TypeHalf)
        return io_error(path, std::string("holds ") + spec.format.c_str() + ", not linear floats");
    if (spec.x < 0 || spec.y < 0 || spec.full_width < 1 || spec.full_height < 1)
        return io_error(path, "its pixels lie outside of its picture");
    auto all = read_channels<float>(path, **in);
    if (!all)
        return all.error();
    RadiancePicture picture;
    picture.extent = {static_cast<std::uint32_t>(spec.full_width),
                      static_cast<std::uint32_t>(spec.full_height)};
    picture.window = {static_cast<std::uint32_t>(spec.x), static_cast<std::uint32_t>(spec.y),
                      static_cast<std::uint32_t>(spec.width),
                      static_cast<std::uint32_t>(spec.height)};
    picture.samples = channel_of(*all, spec, "samples");
    picture.error = channel_of(*all, spec, "error");
    picture.rgb = colours_of(*std::move(all), static_cast<std::size_t>(spec.nchannels));
    for (const OIIO::ParamValue& value : spec.extra_attribs)
        if (value.type() == OIIO::TypeString)
            picture.attributes.push_back({value.name().string(), value.get_string()});
    std::ranges::sort(picture.attributes, {}, &PictureAttribute::name);
    return picture;
}

} // namespace fraja
