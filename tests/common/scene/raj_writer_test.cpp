#include "common/scene/raj_writer.hpp"

#include "common/scene/raj_reader.hpp"
#include "tests/common/scene/scene_files.hpp"
#include "tests/support/random_scene.hpp"
#include "tests/support/seeds.hpp"

#include <doctest/doctest.h>
#include <limits>

using namespace fraja;

namespace {

/// The scene of a file of scenes/, which must be valid.
Scene scene_of(const std::filesystem::path& path) {
    return read_raj_file(path).value();
}

Scene read_back(const Scene& scene) {
    const std::string text = write_raj(scene);
    const auto again = read_raj(text, "written.raj");
    INFO((again ? "" : again.error().message + "\n" + text));
    REQUIRE(again.has_value());
    return *again;
}

} // namespace

TEST_CASE("every scene of the collection survives being written and read") {
    for (const auto& path : valid_scene_files()) {
        CAPTURE(path.filename().string());
        const Scene scene = scene_of(path);
        CHECK(read_back(scene) == scene);
    }
}

TEST_CASE("every random scene survives being written and read") {
    for_each_seed(300, [](Rng& rng) {
        const Scene scene = random_scene(rng);
        CHECK(read_back(scene) == scene);
    });
}

TEST_CASE("solids keep labels that can be written and are their own") {
    Scene scene = scene_of(scenes_folder() / "labels.raj");
    REQUIRE(scene.solid_names.size() == 5);
    scene.solid_names[0].label = "@kept";
    scene.solid_names[1].label = "@twice";
    scene.solid_names[2].label = "@twice";
    scene.solid_names[3].label = "@no-label";
    const Scene again = read_back(scene);
    CHECK(again == scene);
    CHECK(again.solid_names[0].label == "@kept");
    CHECK(again.solid_names[1].label != again.solid_names[2].label);
    CHECK(again.solid_names[3].label.empty()); // it has no priority, so it needs none
}

TEST_CASE("labels made up for what is shared avoid those that solids have") {
    Scene scene = scene_of(scenes_folder() / "labels.raj");
    scene.solid_names[0].label = "@texture_0";
    scene.solid_names[1].label = "@texture_0_";
    scene.solid_names[2].label = "@part_1";
    CHECK(read_back(scene) == scene);
}

TEST_CASE("numbers are written without exponents and read back to the same bits") {
    Scene scene = scene_of(scenes_folder() / "single_solid.raj");
    auto& eye = std::get<HorizontalCamera>(scene.camera);
    using Limits = std::numeric_limits<double>;
    for (const double number :
         {0.1, 1.0 / 3, 1e22, 1e23, 123456789012345678.0, 5e-324, -5e-324, Limits::min(),
          Limits::max(), Limits::lowest(), Limits::epsilon()}) {
        CAPTURE(number);
        eye.screen_width = number;
        CHECK(write_raj(scene).find("e+") == std::string::npos);
        CHECK(std::get<HorizontalCamera>(read_back(scene).camera).screen_width == number);
    }
    eye.screen_width = -0.0;
    CHECK(std::signbit(std::get<HorizontalCamera>(read_back(scene).camera).screen_width));
}

TEST_CASE("canonical order drops what nothing refers to and changes nothing else") {
    for_each_seed(100, [](Rng& rng) {
        const Scene scene = random_scene(rng);
        Scene padded = scene;
        padded.forms.push_back(Sphere{{1, 2, 3}, 4});
        padded.textures.push_back(PlainTexture{});
        padded.textured_forms.push_back(Union{});
        padded.solids.push_back(Aggregate{{scene.world.solid}, {}});
        padded.solid_names.push_back({"@unused", 7});
        CHECK(canonical_order(padded) == scene);
        CHECK(canonical_order(scene) == scene);
    });
}
