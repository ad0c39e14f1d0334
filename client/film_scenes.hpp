// The scenes of a film's frames: one scene, and a list of cameras.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/base/result.hpp"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace fraja::client {

class FilmScenes {
public:
    /// Errors: as read_scene_file()'s, of either file. Warnings open with their place.
    [[nodiscard]] static Result<FilmScenes> read(const std::filesystem::path& scene,
                                                 const std::filesystem::path& travel,
                                                 std::vector<std::string>& warnings);

    [[nodiscard]] std::uint32_t frame_count() const;

    struct Text {
        Blob text;
        ContentHash hash;
    };
    /// The scene with the camera of that frame, 1 to frame_count(), in place of its own; as text,
    /// which is the same whenever the scene and the camera are. Errors: limit_exceeded. Threads may
    /// share this.
    [[nodiscard]] Result<Text> frame(std::uint32_t number) const;

private:
    struct Parts;
    std::shared_ptr<const Parts> parts_;
};

} // namespace fraja::client
