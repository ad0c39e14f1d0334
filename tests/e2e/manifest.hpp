// The rows of Raja's manifest, drawn by the programs and compared with Raja's own pictures.
#pragma once

#include "common/image_io/picture_file.hpp"
#include "tests/e2e/farm.hpp"
#include "tests/support/middle.hpp"

#include <cstdlib>
#include <fstream>
#include <functional>
#include <regex>

namespace fraja::e2e {

struct ManifestRow {
    std::string scene;   ///< a path
    std::string picture; ///< a path
    Words options;       ///< fraja-submit's: Raja's -D is `-a 0 --order diadic`
    bool large = false;  ///< 640x480
    bool dear = false;   ///< many rays for a pixel
};

inline std::vector<ManifestRow> manifest() {
    const std::string golden = FRAJA_SOURCE_DIR "/tests/golden/";
    std::ifstream in(golden + "manifest.csv");
    REQUIRE(in.good());
    const std::regex pattern("(scenes/[a-z_]+\\.raj),([^,]*),(reference/[^,]+\\.png),.*");
    std::vector<ManifestRow> rows;
    std::smatch match;
    for (std::string line; std::getline(in, line);) {
        if (!std::regex_match(line, match, pattern))
            continue;
        ManifestRow row{FRAJA_SOURCE_DIR "/" + match[1].str(), golden + match[3].str(), {}};
        std::istringstream words(match[2].str());
        bool diadic = false;
        for (std::string word, last; words >> word; last = word) {
            row.large |= word == "640x480";
            row.dear |= (last == "-a" && word >= "3") || (last == "-d" && word.size() > 1);
            diadic |= word == "-D";
            if (word != "-D")
                row.options.push_back(word);
        }
        if (diadic) { // it wins over -a
            const auto aa = std::ranges::find(row.options, "-a");
            if (aa != row.options.end())
                row.options.erase(aa, aa + 2);
            row.options.insert(row.options.end(), {"--order", "diadic"});
        }
        rows.push_back(std::move(row));
    }
    REQUIRE(rows.size() >= 51);
    return rows;
}

/// Of rows that take a minute the middle, unless FRAJA_WHOLE is set, as tests/golden draws them
/// whole; in an instrumented build of all rows.
inline PixelRect region_of(const ManifestRow& row, Extent size) {
    if (instrumented)
        return middle_of(size, row.dear ? 4 : 2);
    const bool is_short = row.large && row.dear && !std::getenv("FRAJA_WHOLE");
    return middle_of(size, is_short ? 2 : 1);
}

/// Draws a row with `submit` and the reference kernel, and holds it against Raja's picture: 0
/// differing pixels.
inline void check_row(const ManifestRow& row, const std::function<RunResult(Words)>& submit) {
    CAPTURE(row.picture);
    const auto want = read_levels(row.picture);
    REQUIRE(want.has_value());
    const Extent size = want->extent;
    const PixelRect region = region_of(row, size);
    const Scratch scratch;
    Words arguments{row.scene, "--kernel", "reference", "-o", scratch.file("row.png")};
    arguments.insert(arguments.end(), row.options.begin(), row.options.end());
    if (Extent{region.width, region.height} != size)
        arguments.insert(arguments.end(),
                         {"--crop", std::to_string(region.x) + "," + std::to_string(region.y) +
                                        "," + std::to_string(region.width) + "," +
                                        std::to_string(region.height)});
    const auto result = submit(arguments);
    INFO(result.err);
    REQUIRE(result.exit == 0);
    const auto got = read_levels(scratch.file("row.png"));
    REQUIRE(got.has_value());
    REQUIRE(got->extent == Extent{region.width, region.height});
    std::size_t differing = 0;
    for (std::uint32_t y = 0; y < region.height; ++y)
        for (std::uint32_t x = 0; x < region.width; ++x) {
            const auto* a = &got->rgb[(std::size_t{y} * region.width + x) * 3];
            const auto* b = &want->rgb[(std::size_t{y + region.y} * size.width + x + region.x) * 3];
            differing += !std::equal(a, a + 3, b);
        }
    CHECK(differing == 0);
}

/// Those of the manifest that are large, or those that are not.
inline std::vector<ManifestRow> rows(bool large) {
    std::vector<ManifestRow> rows = manifest();
    std::erase_if(rows, [&](const ManifestRow& row) { return row.large != large; });
    return rows;
}

inline void check_locally(const std::vector<ManifestRow>& rows) {
    for (const ManifestRow& row : rows)
        check_row(row, [](Words words) {
            words.push_back("--local");
            return submit(words);
        });
}

inline void check_on_a_farm(const std::vector<ManifestRow>& rows) {
    Farm farm;
    farm.add_worker("one");
    farm.add_worker("two");
    for (const ManifestRow& row : rows)
        check_row(row, [&](const Words& words) { return farm.submit(words); });
}

} // namespace fraja::e2e
