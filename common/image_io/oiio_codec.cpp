// The codec over OpenImageIO: a library of its own, see picture_codec.hpp.
#include "common/image_io/picture_codec.hpp"
#include "common/image_io/replace_file.hpp"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <algorithm>
#include <array>
#include <cctype>
#include <memory>

namespace fraja {
namespace {

/// Of a file that is read: colours, samples, error, layers.
constexpr std::size_t channels_max = 5 + layer_names.size();

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

/// A writer of OpenImageIO's, or an extension of one, that is not used.
struct Unfit {
    std::string_view name, why;
};

/// As of OpenImageIO 2.4.
constexpr std::array unfit_writers{
    Unfit{"avif", "OpenImageIO writes a .heic under that name"},
    Unfit{"gif", "it has 256 colours, and OpenImageIO crashes over large ones"},
    Unfit{"iff", "OpenImageIO crashes over small ones"},
    Unfit{"jpeg2000", "OpenImageIO writes an empty file"},
    Unfit{"null", "it holds nothing"},
    Unfit{"pbm", "it holds no colours"},
    Unfit{"pgm", "it holds no colours"}};

/// The longest side of formats that have a limit, which their writers find only in the end.
struct SideLimit {
    std::string_view format;
    std::uint32_t side_max;
};
constexpr std::array side_limits{SideLimit{"jpeg", 65'500}, SideLimit{"targa", 65'535},
                                 SideLimit{"webp", 16'383}};
/// libpng's; it serves for those that have none.
constexpr std::uint32_t side_max = 1'000'000;

PixelKind kind_of(std::string_view format, std::string_view extension) {
    if (format == "openexr")
        return PixelKind::radiance_and_more;
    return format == "hdr" || extension == "pfm" ? PixelKind::radiance : PixelKind::levels8;
}

bool write_rows(OIIO::ImageOutput& out, const OIIO::ImageSpec& spec, const void* pixels) {
    const auto* row = static_cast<const std::byte*>(pixels);
    const std::size_t row_bytes = spec.format.size() * static_cast<std::size_t>(spec.nchannels) *
                                  static_cast<std::size_t>(spec.width);
    for (int y = spec.y; y < spec.y + spec.height; ++y, row += row_bytes)
        if (!out.write_scanline(y, 0, spec.format, row))
            return false;
    return true;
}

OIIO::ImageSpec spec_of(const PictureToEncode& picture, std::string_view format) {
    const PixelRect& window = picture.window;
    const bool floats = std::holds_alternative<std::span<const float>>(picture.pixels);
    OIIO::ImageSpec spec(static_cast<int>(window.width), static_cast<int>(window.height), 3,
                         floats ? OIIO::TypeFloat : OIIO::TypeUInt8);
    // Where this is missing, .tif and .exr get the time of day, and no two files are equal.
    spec.attribute("DateTime", "");
    for (const std::string_view channel : picture.channels)
        spec.channelnames.emplace_back(channel);
    spec.nchannels = static_cast<int>(spec.channelnames.size());
    if (picture.half) {
        spec.channelformats.assign(spec.channelnames.size(), OIIO::TypeFloat);
        std::fill_n(spec.channelformats.begin(), 3, OIIO::TypeHalf);
    }
    if (format == "jpeg") { // .png would keep it as text
        spec.attribute("Compression", "jpeg:95");
        spec.attribute("jpeg:subsampling", "4:4:4"); // colours as sharp as brightness
    }
    spec.x = static_cast<int>(window.x);
    spec.y = static_cast<int>(window.y);
    spec.full_width = static_cast<int>(picture.extent.width);
    spec.full_height = static_cast<int>(picture.extent.height);
    for (const PictureAttribute& attribute : picture.attributes)
        spec.attribute(attribute.name, attribute.value);
    return spec;
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
    if (pixel_count > picture_pixels_max || channels > channels_max)
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

/// Those behind the colours, by name.
std::vector<Channel> further_channels(const std::vector<float>& all, const OIIO::ImageSpec& spec) {
    std::vector<Channel> channels;
    for (std::size_t c = 3; c < spec.channelnames.size(); ++c) {
        std::vector<float> values;
        for (std::size_t i = c; i < all.size(); i += spec.channelnames.size())
            values.push_back(all[i]);
        channels.push_back({spec.channelnames[c], std::move(values)});
    }
    std::ranges::sort(channels, {}, &Channel::name);
    return channels;
}

class OiioCodec final : public PictureCodec {
public:
    Result<PictureFormat> format_of(std::string_view extension) const override {
        const std::unique_ptr<OIIO::ImageOutput> out =
            OIIO::ImageOutput::create(std::string(extension));
        if (!out) {
            static_cast<void>(OIIO::geterror()); // it would be kept for another's
            return Error{ErrorCode::not_found, "unknown extension"};
        }
        const std::string_view format = out->format_name();
        for (const Unfit& unfit : unfit_writers)
            if (unfit.name == format || unfit.name == extension)
                return Error{ErrorCode::invalid_argument, std::string(unfit.why)};
        // Those write their file themselves, and not all of them say that a disk is full.
        if (!out->supports("ioproxy"))
            return Error{ErrorCode::invalid_argument, "OpenImageIO cannot write it in memory"};
        const auto limit = std::ranges::find(side_limits, format, &SideLimit::format);
        return PictureFormat{kind_of(format, extension),
                             limit == side_limits.end() ? side_max : limit->side_max};
    }

    Result<std::vector<unsigned char>> encode(const PictureToEncode& picture) const override {
        keep_openexr_to_one_thread();
        const std::string name(picture.format);
        const std::unique_ptr<OIIO::ImageOutput> out = OIIO::ImageOutput::create(name);
        if (!out)
            return Error{ErrorCode::io, reason_of(OIIO::geterror())};
        OIIO::ImageSpec spec = spec_of(picture, out->format_name());
        std::vector<unsigned char> bytes;
        OIIO::Filesystem::IOVecOutput memory(bytes);
        OIIO::Filesystem::IOProxy* proxy = &memory;
        spec.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
        const auto write = [&](const auto& pixels) {
            return out->open("picture." + name, spec) && write_rows(*out, spec, pixels.data()) &&
                   out->close();
        };
        if (!std::visit(write, picture.pixels))
            return Error{ErrorCode::io, reason_of(out->geterror())};
        return bytes;
    }

    Result<LevelsPicture> read_levels(const std::filesystem::path& path) const override {
        const auto in = open_file(path);
        if (!in)
            return in.error();
        const OIIO::ImageSpec& spec = (*in)->spec();
        if (spec.format != OIIO::TypeUInt8)
            return io_error(path,
                            std::string("holds ") + spec.format.c_str() + ", not 8-bit levels");
        auto all = read_channels<std::uint8_t>(path, **in);
        if (!all)
            return all.error();
        return LevelsPicture{
            {static_cast<std::uint32_t>(spec.width), static_cast<std::uint32_t>(spec.height)},
            colours_of(*std::move(all), static_cast<std::size_t>(spec.nchannels))};
    }

    Result<RadiancePicture> read_radiance(const std::filesystem::path& path) const override {
        const auto in = open_file(path);
        if (!in)
            return in.error();
        const OIIO::ImageSpec& spec = (*in)->spec();
        if (spec.format != OIIO::TypeFloat && spec.format != OIIO::TypeHalf)
            return io_error(path,
                            std::string("holds ") + spec.format.c_str() + ", not linear floats");
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
        picture.channels = further_channels(*all, spec);
        picture.rgb = colours_of(*std::move(all), static_cast<std::size_t>(spec.nchannels));
        for (const OIIO::ParamValue& value : spec.extra_attribs)
            if (value.type() == OIIO::TypeString)
                picture.attributes.push_back({value.name().string(), value.get_string()});
        std::ranges::sort(picture.attributes, {}, &PictureAttribute::name);
        return picture;
    }
};

} // namespace
} // namespace fraja

extern "C" [[gnu::visibility("default")]] const fraja::PictureCodec* FRAJA_PICTURE_CODEC_ENTRY() {
    static const fraja::OiioCodec codec;
    return &codec;
}
