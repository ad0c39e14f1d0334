// Picture files: what is written, what is read back. The only room that knows OpenImageIO.
#pragma once

#include "common/base/pixel_rect.hpp"
#include "common/base/result.hpp"
#include "common/image/film.hpp"
#include "common/image/quantise.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace fraja {

/// More pixels than this are not read from a file, whatever its header says.
inline constexpr std::uint64_t picture_pixels_max = std::uint64_t{1} << 28;

/// What the pixels of a format are.
enum class PixelKind {
    levels8,           ///< 0..255, encoded for a display: .png .tif .jpg .webp ...
    radiance,          ///< scene-linear floats, the colours alone: .hdr .pfm
    radiance_and_more, ///< likewise, with channels, halves, attributes and a place: .exr
};

/// How a film's floats become a file's numbers.
struct PictureEncoding {
    Transfer transfer = Transfer::raja; ///< to the levels of 8-bit formats
    /// In an .exr, colours as 16-bit floats, and so half as large; what else there is of a pixel
    /// stays as it is.
    bool half = false;
};

/// A name and its value, carried by formats that keep any (.exr); others leave them out.
struct PictureAttribute {
    std::string name, value;
    friend bool operator==(const PictureAttribute&, const PictureAttribute&) = default;
};

/// Encoded RGB, row-major from the top left: 3 * extent.pixel_count() levels.
struct LevelsView {
    Extent extent;
    std::span<const std::uint8_t> rgb;
};

/// What a file says of each pixel beside its colours.
struct Channel {
    std::string name; ///< `samples`, `error`, or one of layer_names
    std::vector<float> values;
};

struct RadiancePicture {
    Extent extent;
    PixelRect window;
    std::vector<float> rgb;
    std::vector<Channel> channels;            ///< the others, by name
    std::vector<PictureAttribute> attributes; ///< every text attribute of the file, by name
};

struct LevelsPicture {
    Extent extent;
    std::vector<std::uint8_t> rgb;
    friend bool operator==(const LevelsPicture&, const LevelsPicture&) = default;
};

/// The kind of pixels that `path` will hold, from its extension in either case: one of those that
/// help texts name, or any that OpenImageIO writes (which is loaded to ask it, 0.25 s, once).
/// Errors: invalid_argument, naming the nearest extension, or why that format is not written; io.
[[nodiscard]] Result<PixelKind> pixel_kind(const std::filesystem::path& path);

/// Whether a picture of that size can be put at `path`: to be asked before hours of rendering.
/// Makes and removes an empty file beside it, and loads what encodes pictures (0.25 s, once).
/// Errors: invalid_argument (no such format, too large for it), io (no such directory, no
/// permission, a directory or a write-protected file stands there, nothing that encodes).
[[nodiscard]] Result<void> check_writable(const std::filesystem::path& path,
                                          Extent extent = {1, 1});

/// Write the film's region: as 8-bit levels, or as the floats themselves, in an .exr with the
/// channels `samples` and `error`, and layer_names, if the film keeps these, the attributes and the
/// region's place in the picture. The file appears whole or not at all, and an older one stays
/// until then; the same arguments give the same bytes, at any time. A symbolic link is followed.
/// The region must not be empty (asserted). Needs memory for the whole file. Errors: as
/// check_writable(), and io for a full disk.
[[nodiscard]] Result<void> write_picture(const std::filesystem::path& path, const Film& film,
                                         std::span<const PictureAttribute> attributes = {},
                                         const PictureEncoding& encoding = {});

/// Write levels as they are, likewise, to a format that holds 8 bits. There must be as many as the
/// extent says, and at least one pixel (asserted).
[[nodiscard]] Result<void> write_levels(const std::filesystem::path& path,
                                        const LevelsView& levels);

/// Read a picture of 8-bit levels, exactly as they stand in the file. Grey is spread over the three
/// channels; alpha is left out. Errors: io (also for a file with other than 8 bits).
[[nodiscard]] Result<LevelsPicture> read_levels(const std::filesystem::path& path);

/// Read a picture of floats (or halves), likewise.
[[nodiscard]] Result<RadiancePicture> read_radiance(const std::filesystem::path& path);

} // namespace fraja
