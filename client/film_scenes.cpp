#include "client/film_scenes.hpp"

#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "common/scene/raj_reader.hpp"
#include "common/scene/raj_writer.hpp"

#include <utility>

namespace fraja::client {

struct FilmScenes::Parts {
    Scene scene;
    std::vector<Camera> cameras;
};

Result<FilmScenes> FilmScenes::read(const std::filesystem::path& scene_path,
                                    const std::filesystem::path& travel,
                                    std::vector<std::string>& warnings) {
    auto scene = read_raj_file(scene_path, {}, &warnings);
    if (!scene)
        return scene.error();
    auto cameras = read_raj_cameras_file(travel);
    if (!cameras)
        return cameras.error();
    FilmScenes film;
    film.parts_ = std::make_shared<const Parts>(Parts{*std::move(scene), *std::move(cameras)});
    return film;
}

std::uint32_t FilmScenes::frame_count() const {
    return static_cast<std::uint32_t>(parts_->cameras.size());
}

Result<FilmScenes::Text> FilmScenes::frame(std::uint32_t number) const {
    Scene scene = parts_->scene;
    scene.camera = parts_->cameras.at(number - 1);
    Bytes bytes = to_bytes(write_raj(scene));
    if (bytes.size() > protocol::scene_bytes_max)
        return Error{ErrorCode::limit_exceeded,
                     "frame " + std::to_string(number) + ": a scene has at most " +
                         std::to_string(protocol::scene_bytes_max) + " bytes"};
    Text text{.text = Blob(std::move(bytes)), .hash = {}};
    text.hash = protocol::content_hash(text.text);
    return text;
}

} // namespace fraja::client
