// golden_picture SCENE REFERENCE.png [-r WxH] [-d N] [-a N] [-e] [-D] [--middle N] [--only-fast]
//     --fast PERMILLE
//
// Draws a scene and compares it, level by level, with the picture that Raja made of it: by the
// reference kernel, and by the fast one, of which that share of the pixels may differ by more than
// one level; --only-fast leaves out the first. --middle does so only for the middle, 1/N of the
// picture's width and of its height. When they differ, the picture, the reference and the
// difference are left side by side in a file in the current directory.
#include "common/base/text.hpp"
#include "common/image/quantise.hpp"
#include "common/image_io/picture_file.hpp"
#include "common/scene/raj_reader.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/middle.hpp"

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>

namespace fraja {
namespace {

struct Options {
    std::filesystem::path scene, reference;
    RenderSettings settings;
    std::uint32_t middle = 1;
    bool only_fast = false;
    std::uint32_t may_differ_permille = 0; ///< by more than one level, of the fast kernel
};

[[noreturn]] void fail(const std::string& why) {
    std::fprintf(stderr, "%s\n", why.c_str());
    std::exit(1);
}

template <class T>
T require(Result<T> result) {
    if (!result)
        fail(result.error().message);
    return std::move(result).value();
}

std::uint32_t count_or_fail(std::string_view text) {
    const auto count = parse_count(text);
    if (!count)
        fail("not a number: " + std::string(text));
    return static_cast<std::uint32_t>(*count);
}

Options parse(std::span<char*> words) {
    if (words.size() < 3)
        fail("golden_picture SCENE REFERENCE.png [Raja's options] [--middle N] [--only-fast] "
             "--fast PERMILLE");
    Options options{.scene = words[1], .reference = words[2], .settings = {}};
    bool diadic = false;
    for (std::size_t i = 3; i < words.size(); ++i) {
        const std::string_view word = words[i];
        const std::string_view value = i + 1 < words.size() ? words[i + 1] : "";
        if (word == "-e")
            options.settings.exact = true;
        else if (word == "-D")
            diadic = true;
        else if (word == "--only-fast")
            options.only_fast = true;
        else if (word == "-d")
            options.settings.depth = count_or_fail(value), ++i;
        else if (word == "--middle")
            options.middle = std::max(1u, count_or_fail(value)), ++i;
        else if (word == "--fast")
            options.may_differ_permille = count_or_fail(value), ++i;
        else if (word == "-a")
            options.settings.aa = count_or_fail(value), ++i;
        else if (const auto size = parse_extent(value); word == "-r" && size)
            options.settings.size = *size, ++i;
        else
            fail("what is " + std::string(word) + "?");
    }
    if (diadic) // the pixels of -a 0, in another order
        options.settings.aa = 0;
    return options;
}

std::vector<std::uint8_t> cut_out(const LevelsPicture& picture, PixelRect region) {
    std::vector<std::uint8_t> levels;
    for (std::size_t y = region.y; y < region.y + region.height; ++y) {
        const auto row = picture.rgb.begin() +
                         static_cast<std::ptrdiff_t>(3 * (y * picture.extent.width + region.x));
        levels.insert(levels.end(), row, row + 3 * std::ptrdiff_t{region.width});
    }
    return levels;
}

/// Picture, reference, and the difference with a floor that makes one level visible.
void write_side_by_side(const std::filesystem::path& path, PixelRect region,
                        std::span<const std::uint8_t> ours, std::span<const std::uint8_t> theirs) {
    const std::size_t row_bytes = 3 * std::size_t{region.width};
    std::vector<std::uint8_t> levels;
    for (std::size_t y = 0; y < region.height; ++y) {
        const auto a = ours.subspan(y * row_bytes, row_bytes);
        const auto b = theirs.subspan(y * row_bytes, row_bytes);
        levels.insert(levels.end(), a.begin(), a.end());
        levels.insert(levels.end(), b.begin(), b.end());
        for (std::size_t i = 0; i < row_bytes; ++i) {
            const int difference = std::abs(int{a[i]} - int{b[i]});
            levels.push_back(
                static_cast<std::uint8_t>(difference ? std::min(255, 63 + 16 * difference) : 0));
        }
    }
    const auto written = write_levels(path, {{3 * region.width, region.height}, levels});
    std::fprintf(stderr, "%s\n",
                 written ? ("picture | reference | difference: " + path.string()).c_str()
                         : written.error().message.c_str());
}

/// How two pictures differ.
struct Difference {
    int greatest = 0;                         ///< in levels
    std::size_t pixels = 0, clear_pixels = 0; ///< that differ; by more than one level
    std::size_t first = 0;                    ///< pixel that differs most clearly
};

Difference compare(std::span<const std::uint8_t> ours, std::span<const std::uint8_t> theirs) {
    Difference d;
    for (std::size_t pixel = ours.size() / 3; pixel-- > 0;) {
        int difference = 0;
        for (std::size_t i = 3 * pixel; i < 3 * pixel + 3; ++i)
            difference = std::max(difference, std::abs(int{ours[i]} - int{theirs[i]}));
        d.pixels += difference > 0;
        d.clear_pixels += difference > 1;
        if (difference > 0 && difference >= std::min(d.greatest, 2))
            d.first = pixel;
        d.greatest = std::max(d.greatest, difference);
    }
    return d;
}

/// Whether the picture of that kernel is as good as it must be; says how it differs.
bool check(const std::shared_ptr<const Scene>& scene, Kernel kernel, const Options& options,
           PixelRect region, std::span<const std::uint8_t> theirs) {
    const auto compiled = compile_scene(scene, kernel);
    const Drawn drawn = require(draw(*compiled, options.settings, region));
    const std::vector<std::uint8_t> ours = quantise(drawn.film.pixels());
    const Difference d = compare(ours, theirs);
    const std::size_t pixels = ours.size() / 3;
    const std::string_view name = kernel == Kernel::reference ? "reference" : "fast";
    std::printf("%-9s: %llu rays, %llu shadow rays; %zu of %zu pixels differ, %zu by more than one "
                "level, by up to %d; one at %zu,%zu\n",
                name.data(), static_cast<unsigned long long>(drawn.rays.traced()),
                static_cast<unsigned long long>(drawn.rays.shadow), d.pixels, pixels,
                d.clear_pixels, d.greatest, region.x + d.first % region.width,
                region.y + d.first / region.width);
    const bool good = kernel == Kernel::reference
                          ? d.pixels == 0
                          : 1000 * d.clear_pixels <= options.may_differ_permille * pixels;
    if (!good)
        write_side_by_side(std::string(name) + "_differs_" + options.reference.filename().string(),
                           region, ours, theirs);
    return good;
}

int run(const Options& options) {
    const auto scene = std::make_shared<const Scene>(require(read_raj_file(options.scene)));
    const LevelsPicture reference = require(read_levels(options.reference));
    if (reference.extent != options.settings.size)
        fail("the reference has another size");
    const PixelRect region = middle_of(options.settings.size, options.middle);
    const std::vector<std::uint8_t> theirs = cut_out(reference, region);
    const bool reference_good =
        options.only_fast || check(scene, Kernel::reference, options, region, theirs);
    const bool fast_good = check(scene, Kernel::fast, options, region, theirs);
    return reference_good && fast_good ? 0 : 1;
}

} // namespace
} // namespace fraja

int main(int argc, char** argv) {
    return fraja::run(fraja::parse({argv, static_cast<std::size_t>(argc)}));
}
