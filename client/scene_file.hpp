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

} // namespace fraja::client
