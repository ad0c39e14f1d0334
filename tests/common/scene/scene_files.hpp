// Where the collection of scenes is, for tests.
#pragma once

#include "tests/support/file_bytes.hpp"

#include <algorithm>
#include <filesystem>
#include <vector>

namespace fraja {

inline std::filesystem::path scenes_folder() {
    return std::filesystem::path(FRAJA_SOURCE_DIR) / "scenes";
}

/// The .raj files of a folder, sorted.
inline std::vector<std::filesystem::path> raj_files(const std::filesystem::path& folder) {
    std::vector<std::filesystem::path> paths;
    for (const auto& entry : std::filesystem::directory_iterator(folder))
        if (entry.path().extension() == ".raj")
            paths.push_back(entry.path());
    std::ranges::sort(paths);
    return paths;
}

/// All of scenes/ but missing_texture.raj, which Raja reads and fails to draw.
inline std::vector<std::filesystem::path> valid_scene_files() {
    auto paths = raj_files(scenes_folder());
    std::erase_if(paths, [](const auto& path) { return path.filename() == "missing_texture.raj"; });
    return paths;
}

} // namespace fraja
