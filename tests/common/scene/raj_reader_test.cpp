#include "common/scene/raj_reader.hpp"

#include "tests/common/scene/scene_files.hpp"
#include "tests/common/scene/scene_text.hpp"

#include <cmath>
#include <doctest/doctest.h>

using namespace fraja;

namespace {

/// The scene, which must be readable.
Scene read(std::string_view text) {
    const auto scene = read_raj(text, "test.raj");
    INFO((scene ? "" : scene.error().message));
    REQUIRE(scene.has_value());
    return *scene;
}

double radius_read(std::string_view number) {
    return std::get<Sphere>(read(scene_with_number(number)).forms.at(0)).radius;
}

LocalTexture local_texture_read(std::string_view fields) {
    return std::get<PlainTexture>(read(scene_with_local_texture(fields)).textures.at(0)).local;
}

} // namespace

TEST_CASE("every scene that Raja draws is read without error") {
    CHECK(valid_scene_files().size() == 23);
    for (const auto& path : valid_scene_files()) {
        CAPTURE(path.filename().string());
        const auto scene = read_raj_file(path);
        INFO((scene ? "" : scene.error().message));
        CHECK(scene.has_value());
    }
}

TEST_CASE("labels.raj means what its comments say") {
    std::vector<std::string> warnings;
    const auto read_scene = read_raj_file(scenes_folder() / "labels.raj", {}, &warnings);
    REQUIRE(read_scene.has_value());
    const Scene& scene = *read_scene;

    const Rgb grey(0.2), p(0.2, 0.15, 0.1);
    CHECK(scene.world.ambient_light == grey);
    CHECK(scene.world.background_light == grey);
    const PointLight lamp{{-3, -4, 7}, Rgb(0.8)};
    CHECK(scene.world.lights == std::vector<Light>{lamp, DirectionalLight{{1, -1, -0.5}, p}, lamp});

    REQUIRE(scene.solids.size() == 5);
    CHECK(scene.solid_names[0].label == "@a");
    CHECK(scene.solid_names[0].line == 15);
    CHECK(scene.solid_names[4].label.empty());
    const auto& all = std::get<Aggregate>(scene.solids[4]);
    CHECK(all.members ==
          std::vector<SolidIndex>{SolidIndex{0}, SolidIndex{1}, SolidIndex{2}, SolidIndex{3}});
    const Priority a_over_b{SolidIndex{0}, SolidIndex{1}}, c_over_a{SolidIndex{2}, SolidIndex{0}},
        c_over_b{SolidIndex{2}, SolidIndex{1}};
    CHECK(all.priorities == std::vector<Priority>{a_over_b, a_over_b, c_over_a, c_over_b});

    CHECK(scene.textures.size() == 2); // @t everywhere, and the chequers
    const LocalTexture lt{.kd = p, .krl = Rgb(0.5), .krg = Rgb(0.1), .ktg = Rgb(0.6), .ns = 30};
    CHECK(scene.textures[0] == Texture(PlainTexture{lt}));
    const auto& b = std::get<BasicSolid>(scene.solids[1]);
    CHECK(b.volume == Volume(IsotropicVolume{1.5}));
    const auto& cut = std::get<Intersection>(scene.textured_forms[as_size(b.textured_form)]);
    REQUIRE(cut.members.size() == 3);
    CHECK(cut.members[0] == cut.members[2]); // @big, the same object

    REQUIRE(warnings.size() == 2);
    CHECK(warnings[0].ends_with("labels.raj:10:53: label '@p' is defined again"));
    CHECK(warnings[1].ends_with("label '@x' is defined again"));
}

TEST_CASE("numbers are the nearest doubles") {
    struct Row {
        std::string_view text;
        double want;
    };
    const std::string zeros(400, '0');
    const std::string tiny = "0." + zeros + "1", minus_tiny = "-." + zeros + "1";
    const std::string padded = zeros + "2.50" + zeros, small = "0." + std::string(323, '0') + "5";
    for (const Row& row :
         {Row{"7", 7}, Row{"007", 7}, Row{"-3", -3}, Row{"1.", 1}, Row{".5", 0.5}, Row{"-.5", -0.5},
          Row{"00.8", 0.8}, Row{"0.1000000000000000055511151231257827021181583404541015625", 0.1},
          Row{"9007199254740993", 9007199254740992.0}, Row{tiny, 0.0}, Row{padded, 2.5},
          Row{small, 5e-324}}) {
        CAPTURE(row.text);
        CHECK(radius_read(row.text) == row.want);
    }
    CHECK(std::signbit(radius_read("-0.0")));
    CHECK(std::signbit(radius_read(minus_tiny)));
}

TEST_CASE("fields come in any order and the last value counts") {
    const Scene scene = read(scene_with_form("raja.shape.Sphere { radius = [ ] radius = 1 center "
                                             "= raja.Point3D { 1 ; 2 ; 3 } radius = 2 }"));
    CHECK(std::get<Sphere>(scene.forms.at(0)) == Sphere{{1, 2, 3}, 2});
}

TEST_CASE("ignored fields take any value") {
    for (const std::string_view value :
         {"3", "[ ]", "[[ ]]", "raja.Point3D (@p) { 1 ; 2 ; 3 }", "[ raja.Point3D { 1 ; 2 ; 3 } ]",
          "raja.Point3D (@p) { 1 ; 2 ; 3 } pixelHeight = [[ @p >> @p ]]"}) {
        CAPTURE(value);
        const Scene scene = read(scene_with_camera(
            "raja.renderer.HorizontalCamera { origin = raja.Point3D { 0 ; 0 ; 0 } direction = "
            "raja.Vector3D { 1 ; 0 ; 0 } focal = 1 screenWidth = 1 screenHeight = 0.75 "
            "pixelWidth = " +
            std::string(value) + " }"));
        CHECK(scene == read(scene_with_camera(a_camera)));
    }
}

TEST_CASE("a stereo camera has a step and ignores cross") {
    const Scene scene = read(scene_with_camera(
        "raja.renderer.StereoCamera { origin = raja.Point3D { 1 ; 2 ; 3 } direction = "
        "raja.Vector3D { 1 ; 0 ; 0 } focal = 4 screenWidth = 5 screenHeight = 6 step = -0.5 "
        "cross = [ ] pixelwidth = 1 pixelheight = 2 }"));
    const HorizontalCamera eye{.origin = {1, 2, 3},
                               .direction = {1, 0, 0},
                               .focal = 4,
                               .screen_width = 5,
                               .screen_height = 6};
    CHECK(scene.camera == Camera(StereoCamera{eye, -0.5}));
}

TEST_CASE("a texture hides textureIn and textureOut of any type") {
    const Scene scene = read(scene_with_textured_form(
        "raja.shape.BasicTexturedForm { form = " + std::string(a_form) +
        " textureIn = 7 textureOut = [ ] texture = " + std::string(a_texture) + " }"));
    CHECK(scene.textures.size() == 1);
    const auto& basic = std::get<BasicTexturedForm>(scene.textured_forms.at(0));
    CHECK(basic.texture_in == basic.texture_out);
}

TEST_CASE("a local texture is grey or coloured and truncates ns") {
    const LocalTexture grey =
        local_texture_read("kd = 0.5 krl = 0.25 krg = 0 ktg = 1 ns = 40.9 nt = -7.5");
    CHECK(grey ==
          LocalTexture{.kd = Rgb(0.5), .krl = Rgb(0.25), .krg = Rgb(0), .ktg = Rgb(1), .ns = 40});
    const LocalTexture tinted =
        local_texture_read("color = raja.RGB { 1 ; 0.5 ; 0 } kd = 0.5 krl = 0.25 krg = 0 ktl = 9 "
                           "ktg = 1 ns = -1.5 nt = 1");
    CHECK(tinted.kd == Rgb(0.5, 0.25, 0));
    CHECK(tinted.krl == Rgb(0.25));
    CHECK(tinted.ns == -1);
    CHECK(local_texture_read("kd = -0 krl = 0 krg = 0 ktg = 0 ns = 99999999999 nt = 0").ns ==
          2147483647);
    CHECK(local_texture_read("kd = -0 krl = 0 krg = 0 ktg = 0 ns = -99999999999 nt = 0").ns ==
          -2147483647 - 1);
}

TEST_CASE("a solid may stand in the place of a volume") {
    const Scene scene = read(scene_with_world(
        "ambiantVolume = raja.shape.Aggregate (@air) { solids = [ ] priorities = [[ ]] }\n"
        "solid = raja.shape.BasicSolid { volume = @air texturedForm = " +
        a_textured_form() + " }"));
    CHECK(scene.world.ambient_volume == Volume(SolidIndex{0}));
    CHECK(std::get<BasicSolid>(scene.solids.at(1)).volume == Volume(SolidIndex{0}));
    CHECK(scene.world.solid == SolidIndex{1});
}

TEST_CASE("empty lists and what is left out have their meaning") {
    const Scene scene = read(
        scene_with_solid("raja.shape.Aggregate { solids = [ raja.shape.BasicSolid { texturedForm = "
                         "raja.shape.Union { texturedForms = [ ] } } ] priorities = [[ ]] }"));
    CHECK(scene.forms.empty());
    CHECK(scene.world.lights.empty());
    CHECK(scene.world.ambient_light == Rgb(0));
    CHECK(scene.world.ambient_volume == Volume(IsotropicVolume{1}));
    CHECK(std::get<BasicSolid>(scene.solids.at(0)).volume == Volume(IsotropicVolume{1}));
}

TEST_CASE("tables hold what the scene uses and nothing else") {
    const Scene scene = read(scene_with_world(
        "solid = raja.shape.BasicSolid (@s) { texturedForm = " + a_textured_form() +
        " }\nsolid = raja.shape.BasicSolid (@s) { texturedForm = " + a_textured_form() + " }"));
    CHECK(scene.solids.size() == 1);
    CHECK(scene.solid_names.at(0).line == 4);
    CHECK(scene.textured_forms.size() == 1);
    CHECK(scene.forms.size() == 1);
    CHECK(scene.textures.size() == 1);
}

TEST_CASE("what follows the scene is not read") {
    CHECK(read(scene_with_solid(a_solid()) + "{ [ # 1e5 \xEF\xBB\xBF") ==
          read(scene_with_solid(a_solid())));
}

TEST_CASE("line ends are one or two characters") {
    const std::string text = scene_with_form(a_form) + "// end";
    for (const std::string_view line_end : {"\n", "\r\n", "\r"}) {
        std::string other;
        for (const char c : text)
            other += c == '\n' ? std::string(line_end) : std::string(1, c);
        CHECK(read(other) == read(text));
    }
}

TEST_CASE("a priority that no Aggregate asks for is left out with a warning") {
    std::vector<std::string> warnings;
    const auto scene = read_raj(
        scene_with_solid("raja.shape.Aggregate { solids = [ raja.shape.Aggregate (@a) { solids = [ "
                         "raja.shape.Aggregate (@b) { solids = [ ] priorities = [[ ]] } ] "
                         "priorities = [[ ]] } ]\npriorities = [[ @a >> @b, @a >> @a ]] }"),
        "test.raj", {}, &warnings);
    REQUIRE(scene.has_value());
    const SolidIndex a{1};
    CHECK(std::get<Aggregate>(scene->solids.at(2)).priorities == std::vector<Priority>{{a, a}});
    CHECK(warnings == std::vector<std::string>{"test.raj:3:17: a priority without effect: not "
                                               "between members of this raja.shape.Aggregate"});
}

TEST_CASE("an odd refractive index is read with a warning") {
    for (const std::string index : {"0", "-1.5"}) {
        std::vector<std::string> warnings;
        CHECK(read_raj(scene_with_world("ambiantVolume = raja.shape.IsotropicVolume { " + index +
                                        " } solid = " + a_solid()),
                       "test.raj", {}, &warnings)
                  .has_value());
        CHECK(warnings.size() == 1);
    }
}

TEST_CASE("warnings beyond the first twenty are only counted") {
    std::string fields = "solid = " + a_solid();
    for (int i = 0; i < 100; ++i)
        fields += " ambiantLight = raja.RGB (@l) { 0 ; 0 ; 0 }";
    std::vector<std::string> warnings;
    CHECK(read_raj(scene_with_world(fields), "test.raj", {}, &warnings).has_value());
    REQUIRE(warnings.size() == 21);
    CHECK(warnings.back() == "test.raj: and 79 more warnings");
}

TEST_CASE("a file that cannot be read is an error of input and output") {
    const auto missing = read_raj_file(scenes_folder() / "no_such.raj");
    REQUIRE_FALSE(missing.has_value());
    CHECK(missing.error().code == ErrorCode::io);
    CHECK(missing.error().message.find("no_such.raj: there is no such file") != std::string::npos);
    const auto folder = read_raj_file(scenes_folder());
    REQUIRE_FALSE(folder.has_value());
    CHECK(folder.error().code == ErrorCode::io);
    CHECK(folder.error().message.ends_with("scenes: this is a directory, not a scene file"));
    CHECK_FALSE(read_raj_file("").has_value());
}
