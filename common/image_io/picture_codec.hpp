// What makes pixels a file's bytes, and back: OpenImageIO, behind an interface, in a library that
// is loaded when the first picture needs it. It brings 260 others and takes a quarter of a second;
// commands that touch no picture need not wait for it.
#pragma once

#include "common/image_io/picture_file.hpp"

#include <string_view>
#include <variant>

namespace fraja {

/// A picture to encode. There is at least one pixel.
struct PictureToEncode {
    std::string_view format; ///< an extension, without its dot
    Extent extent;           ///< of the whole picture
    PixelRect window;        ///< of it that the pixels are; levels are all of it
    /// Row-major from the top left: RGB; behind the floats of a pixel one of each further channel.
    std::variant<std::span<const std::uint8_t>, std::span<const float>> pixels;
    std::span<const std::string_view> channels; ///< their names
    bool half = false;                          ///< colours as 16-bit floats
    std::span<const PictureAttribute> attributes;
};

/// What a format can hold.
struct PictureFormat {
    PixelKind kind;
    std::uint32_t side_max; ///< in pixels
};

class PictureCodec {
public:
    virtual ~PictureCodec() = default;
    /// Of the files that are written with that extension (without its dot, in lower case). Errors:
    /// not_found (there is no such format), invalid_argument (its files are not written well),
    /// saying only why.
    [[nodiscard]] virtual Result<PictureFormat> format_of(std::string_view extension) const = 0;
    /// The same picture gives the same bytes, at any time. Its format must be one that format_of()
    /// knows. Errors: io, saying only why.
    [[nodiscard]] virtual Result<std::vector<unsigned char>>
    encode(const PictureToEncode& picture) const = 0;
    /// As fraja::read_levels().
    [[nodiscard]] virtual Result<LevelsPicture>
    read_levels(const std::filesystem::path& path) const = 0;
    /// As fraja::read_radiance().
    [[nodiscard]] virtual Result<RadiancePicture>
    read_radiance(const std::filesystem::path& path) const = 0;
};

/// The codec, loaded at the first call, for good; may be called by any thread. The library lies at
/// ../lib/fraja, seen from the program's own folder. Errors: io, naming the library and the reason.
[[nodiscard]] Result<const PictureCodec*> picture_codec();

} // namespace fraja
