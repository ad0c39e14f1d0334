// A scene file read for submission: its bytes, which travel, and the proof that they are a scene.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/base/result.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace fraja::client {

struct SceneFile {
    Blob text;
    ContentHash hash;
    std::vector<std::string> warnings; ///< each opens with its place
};

/// Errors: io; limit_exceeded; invalid_scene with place and cure.
[[nodiscard]] Result<SceneFile> read_scene_file(const std::filesystem::path& path);

/// Whether a picture may be written there without the file that it is made of being lost, under
/// whatever name. Errors: invalid_argument.
[[nodiscard]] Result<void> check_apart(const std::filesystem::path& output,
                                       const std::filesystem::path& input);

} // namespace fraja::client
