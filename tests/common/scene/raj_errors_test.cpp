// What is refused, where, and in which words.
#include "common/scene/raj_reader.hpp"

#include "tests/common/scene/scene_files.hpp"
#include "tests/common/scene/scene_text.hpp"

#include <doctest/doctest.h>
#include <sstream>

using namespace fraja;

namespace {

/// The message with which the text is refused; it must be.
std::string refusal(std::string_view text, std::string_view file_name) {
    const auto scene = read_raj(text, file_name);
    REQUIRE_FALSE(scene.has_value());
    CHECK(scene.error().code == ErrorCode::invalid_scene);
    return scene.error().message;
}

std::string refusal_of_invalid(const std::string& file) {
    return refusal(bytes_of(scenes_folder() / "invalid" / file), file);
}

} // namespace

TEST_CASE("every invalid scene is refused with the right words") {
    struct Row {
        std::string_view want;
    };
    std::size_t rows = 0;
    for (
        const Row& row :
        {Row{"block_comment.raj:9:26: expected a field of raja.shape.Sphere or '}', found '/'"},
         Row{"boolean.raj:24:89: expected a number, a label, an object, a list or a graph, found "
             "'true'"},
         Row{"byte_order_mark.raj:1:1: expected a number, a label, an object, a list or a graph, "
             "found a byte order mark"},
         Row{"capital_field.raj:9:15: raja.shape.Sphere has no field 'Radius' (did you mean "
             "'radius'?)"},
         Row{"colon.raj:9:22: expected '=', found ':'"},
         Row{"comma_between_fields.raj:8:53: expected a field of raja.shape.Sphere or '}', found "
             "','"},
         Row{"commas_for_semicolons.raj:8:41: expected ';', found ','"},
         Row{"comment_to_eof_inside.raj:26:52: unexpected end of the file: expected a field of "
             "raja.renderer.Scene or '}'"},
         Row{"digit_in_package.raj:7:20: expected a number, a label, an object, a list or a graph, "
             "found 'raja.sh4pe.Sphere' (did you mean 'raja.shape.Sphere'?)"},
         Row{"empty_file.raj:1:1: unexpected end of the file: expected a number, a label, an "
             "object, a list or a graph"},
         Row{"exponent.raj:9:25: raja.shape.Sphere has no field 'e0'"},
         Row{"field_of_another_camera.raj:24:91: raja.renderer.HorizontalCamera has no field "
             "'step'"},
         Row{"forward_label.raj:8:24: no label '@later' has been defined before this"},
         Row{"four_coordinates.raj:8:51: expected '}', found ';'"},
         Row{"graph_before_solids.raj:4:23: no label '@ball' has been defined before this"},
         Row{"graph_for_lights.raj:21:7: expected a label (@name), found "
             "'raja.light.PointLightSource'"},
         Row{"label_for_a_coordinate.raj:8:43: expected a number, found '@a'"},
         Row{"label_in_itself.raj:8:24: label '@s' is used in its own object"},
         Row{"label_on_a_list.raj:4:16: expected a number, a label, an object, a list or a graph, "
             "found '('"},
         Row{"label_on_a_number.raj:9:24: expected a number, a label, an object, a list or a "
             "graph, found '('"},
         Row{"label_with_dash.raj:5:35: expected ')', found '-'"},
         Row{"label_without_at.raj:7:39: expected a label (@name), found 's'"},
         Row{"list_for_priorities.raj:17:20: raja.shape.Aggregate: 'priorities' must be a graph [[ "
             "]], not a list [ ]"},
         Row{"list_in_list.raj:19:16: expected a label or an object, found '['"},
         Row{"lone_dot.raj:9:24: expected a number, a label, an object, a list or a graph, found "
             "'.'"},
         Row{"lone_minus.raj:9:24: expected a number, a label, an object, a list or a graph, found "
             "'-'"},
         Row{"lone_slash.raj:9:26: expected a field of raja.shape.Sphere or '}', found '/'"},
         Row{"missing_priorities.raj:3:13: raja.shape.Aggregate lacks 'priorities', a graph [[ ]]"},
         Row{"missing_radius.raj:7:20: raja.shape.Sphere lacks 'radius', a number"},
         Row{"named_coordinates.raj:8:39: expected a number, found 'x'"},
         Row{"negative_kd.raj:12:61: raja.shape.LocalTexture: 'kd' must not be negative"},
         Row{"negative_rgb.raj:20:96: raja.RGB: a component is negative"},
         Row{"no_comma_in_list.raj:21:7: expected ',' or ']', found 'raja.light.PointLightSource'"},
         Row{"no_equals.raj:9:22: expected '=', found '1'"},
         Row{"not_a_scene.raj:1:1: the file must hold a raja.renderer.Scene, not a raja.Point3D"},
         Row{"null.raj:9:24: expected a number, a label, an object, a list or a graph, found "
             "'null'"},
         Row{"number_for_color.raj:12:64: raja.shape.LocalTexture: 'color' must be a raja.RGB, not "
             "a number"},
         Row{"number_for_point.raj:8:24: raja.shape.Sphere: 'center' must be a raja.Point3D, not a "
             "number"},
         Row{"number_in_list.raj:19:16: expected a label or an object, found '1'"},
         Row{"object_in_graph.raj:17:32: expected a label (@name), found 'raja.shape.BasicSolid'"},
         Row{"one_greater_sign.raj:17:29: expected '>>', found '>'"},
         Row{"plus_sign.raj:9:24: expected a number, a label, an object, a list or a graph, found "
             "'+'"},
         Row{"point_for_light.raj:20:7: raja.renderer.World: an item of 'lights' must be a light, "
             "not a raja.Point3D"},
         Row{"point_for_number.raj:9:24: raja.shape.Sphere: 'radius' must be a number, not a "
             "raja.Point3D"},
         Row{"positional_sphere.raj:8:15: expected a field of raja.shape.Sphere or '}', found "
             "'raja.Point3D'"},
         Row{"rgb_kd_with_color.raj:12:92: raja.shape.LocalTexture: 'kd' must be a number where "
             "there is 'color'"},
         Row{"semicolon_between_fields.raj:8:53: expected a field of raja.shape.Sphere or '}', "
             "found ';'"},
         Row{"short_class_name.raj:7:20: there is no class 'Sphere' (did you mean "
             "'raja.shape.Sphere'?)"},
         Row{"string.raj:9:24: expected a number, a label, an object, a list or a graph, found "
             "'\"'"},
         Row{"trailing_comma_in_list.raj:21:5: expected a label or an object, found ']'"},
         Row{"trailing_semicolon.raj:8:51: expected '}', found ';'"},
         Row{"two_coordinates.raj:8:47: expected ';', found '}'"},
         Row{"unclosed.raj:26:1: unexpected end of the file: expected a field of "
             "raja.renderer.Scene or '}'"},
         Row{"undefined_label.raj:9:24: no label '@r' has been defined before this"},
         Row{"undefined_label_in_graph.raj:17:32: no label '@cube' has been defined before this"},
         Row{"unknown_class.raj:7:20: there is no class 'raja.shape.Torus'"},
         Row{"unknown_field.raj:9:26: raja.shape.Sphere has no field 'colour'"},
         Row{"unreadable_class.raj:7:20: there is no class 'raja.shape.CompositeForm'"},
         Row{"vector_for_point.raj:8:24: raja.shape.Sphere: 'center' must be a raja.Point3D, not a "
             "raja.Vector3D"}}) {
        CHECK(refusal_of_invalid(std::string(row.want.substr(0, row.want.find(':')))) == row.want);
        ++rows;
    }
    CHECK(rows == raj_files(scenes_folder() / "invalid").size());
}

TEST_CASE("errors stand where Raja sees them") {
    std::istringstream table(bytes_of(scenes_folder() / "invalid" / "invalid.csv"));
    int compared = 0;
    for (std::string row; std::getline(table, row);) {
        const std::string file = row.substr(0, row.find(','));
        const std::size_t line_at = row.find("Line:"), column_at = row.find("Col:");
        if (line_at == std::string::npos)
            continue; // Raja does not say where
        const int line = std::stoi(row.substr(line_at + 5));
        const int column = std::stoi(row.substr(column_at + 4)) + 1; // Raja counts from 0
        const std::string place =
            file + ":" + std::to_string(line) + ":" + std::to_string(column) + ":";
        CHECK(refusal_of_invalid(file).starts_with(place));
        ++compared;
    }
    CHECK(compared == 44);
}

TEST_CASE("a scene that Raja would fail to draw is refused") {
    const std::string texture(a_texture), form(a_form);
    const auto camera = [](std::string_view what, std::string_view direction) {
        return scene_with_camera("raja.renderer." + std::string(what) +
                                 " { focal = 1 origin = raja.Point3D { 0 ; 0 ; 0 } screenWidth = 1 "
                                 "screenHeight = 1\ndirection =\nraja.Vector3D { " +
                                 std::string(direction) + " } }");
    };
    const auto plane = [](std::string_view normal) {
        return scene_with_form(
            "raja.shape.Plane { origin = raja.Point3D { 0 ; 0 ; 0 } normal =\nraja.Vector3D { " +
            std::string(normal) + " } }");
    };
    const auto cone = [](std::string_view angle) {
        return scene_with_form("raja.shape.Cone { origin = raja.Point3D { 0 ; 0 ; 0 } direction = "
                               "raja.Vector3D { 0 ; 0 ; 1 } angle =\n" +
                               std::string(angle) + "}");
    };
    const std::string tiny = "0." + std::string(199, '0') + "1", huge = "1" + std::string(200, '0');
    const std::string no_length = " is zero, or too small or large to be normalised";
    const std::string no_cone =
        "t:3:1: raja.shape.Cone: 'angle' leaves no cone: its cosine is 1 or -1 (the angle is in "
        "radians)";
    struct Row {
        std::string text, want;
    };
    for (const Row& row : std::initializer_list<Row>{
             // textures
             {scene_with_textured_form("raja.shape.BasicTexturedForm { form = " + form +
                                       " textureIn = " + texture + " }"),
              "t:2:1: raja.shape.BasicTexturedForm lacks 'textureOut', a texture (or 'texture', "
              "for both sides)"},
             {scene_with_textured_form("raja.shape.BasicTexturedForm { form = " + form +
                                       " textureOut = " + texture + " }"),
              "t:2:1: raja.shape.BasicTexturedForm lacks 'textureIn', a texture (or 'texture', for "
              "both sides)"},
             {scene_with_textured_form("raja.shape.BasicTexturedForm { form = " + form +
                                       " textureOut = " + texture + " textureIn =\n7 }"),
              "t:3:1: raja.shape.BasicTexturedForm: 'textureIn' must be a texture, not a number"},
             {scene_with_local_texture("krl = 0 krg = 0 ktg = 0 ns = 0 nt = 0"),
              "t:2:1: raja.shape.LocalTexture lacks 'kd', a number or a raja.RGB"},
             {scene_with_local_texture("kd = 0 krl = 0 krg = 0 ktg = 0 ns = 0"),
              "t:2:1: raja.shape.LocalTexture lacks 'nt', a number"},
             {scene_with_local_texture("kd = 0 krl = 0 krg = 0 ktg = 0 ns = 0 nt =\n[ ]"),
              "t:4:1: raja.shape.LocalTexture: 'nt' must be a number, not a list [ ]"},
             {scene_with_local_texture(
                  "kd = 0 krl = 0 krg = 0 ktg = 0 ns = 0 nt = 0 color = raja.RGB { 1 ; 1 ; 1 }"),
              "t:2:1: raja.shape.LocalTexture lacks 'ktl', a number"},
             {scene_with_local_texture("kd = 0 krl = 0 krg = 0 ktg = 0 ns = 0 nt = 0 ktl = -0.1"),
              "t:3:52: raja.shape.LocalTexture: 'ktl' must not be negative"},
             {scene_with_local_texture("color = raja.RGB { " + huge + " ; 0 ; 0 } kd =\n" + huge +
                                       " krl = 0 krg = 0 ktl = 0 ktg = 0 ns = 0 nt = 0"),
              "t:4:1: raja.shape.LocalTexture: 'kd' times 'color' is infinite"},
             // lists
             {scene_with_solid("raja.shape.Aggregate { priorities = [[ ]] }"),
              "t:2:1: raja.shape.Aggregate lacks 'solids', a list [ ]"},
             {scene_with_solid("raja.shape.Aggregate { solids = [\nraja.RGB (@c) { 1 ; 1 ; 1 }, "
                               "@c] priorities = [[ ]] }"),
              "t:3:1: raja.shape.Aggregate: an item of 'solids' must be a solid, not a raja.RGB"},
             {scene_with_solid("raja.shape.Aggregate { solids = [ " + a_solid() +
                               " ] solids = [ ] solids = [ raja.shape.Aggregate (@a) { solids = [ "
                               "] priorities = [[ ]] } ] priorities = raja.RGB (@c) { 1 ; 1 ; 1 } "
                               "priorities = [[\n@a >>\n@c ]] }"),
              "t:4:1: raja.shape.Aggregate: an item of 'priorities' must be a solid, not a "
              "raja.RGB"},
             {scene_with_textured_form("raja.shape.Union { }"),
              "t:2:1: raja.shape.Union lacks 'texturedForms', a list [ ]"},
             {scene_with_textured_form("raja.shape.Intersection { texturedForms = [\n" + form +
                                       "] }"),
              "t:3:1: raja.shape.Intersection: an item of 'texturedForms' must be a textured form, "
              "not a form"},
             {scene_with_textured_form("raja.shape.Complement { texturedForm =\n" + a_solid() +
                                       " }"),
              "t:3:1: raja.shape.Complement: 'texturedForm' must be a textured form, not a solid"},
             // the world
             {scene_with_world("lights = [ ]"),
              "t:2:1: raja.renderer.World lacks 'solid', a solid"},
             {scene_with_world("solid = " + a_solid() + " lights =\n[[ ]]"),
              "t:4:1: raja.renderer.World: 'lights' must be a list [ ], not a graph [[ ]]"},
             {scene_with_world("solid = " + a_solid() + " ambiantVolume =\n1.5"),
              "t:4:1: raja.renderer.World: 'ambiantVolume' must be a volume or a solid, not a "
              "number"},
             {"raja.renderer.Scene { world = raja.renderer.World { solid = " + a_solid() + " } }",
              "t:1:1: raja.renderer.Scene lacks 'camera', a camera"},
             {scene_with_world(
                  "solid = " + a_solid() +
                  " lights = [ raja.light.DirectionalLightSource { direction = "
                  "raja.Vector3D (@v)\n{ 0 ; 0 ; -0 } direction =\n@v light = raja.RGB "
                  "{ 1 ; 1 ; 1 } } ]"),
              "t:5:1: raja.light.DirectionalLightSource: 'direction'" + no_length},
             // cameras
             {camera("HorizontalCamera", "0 ; 0 ; 0"),
              "t:4:1: raja.renderer.HorizontalCamera: 'direction'" + no_length},
             {camera("HorizontalCamera", "0 ; 0 ; -3"),
              "t:4:1: raja.renderer.HorizontalCamera: 'direction' is vertical: the picture has no "
              "upper side"},
             {camera("HorizontalCamera", tiny + " ; 0 ; 1"),
              "t:4:1: raja.renderer.HorizontalCamera: 'direction' is vertical: the picture has no "
              "upper side"},
             {camera("StereoCamera", "0 ; 0 ; 1"),
              "t:2:1: raja.renderer.StereoCamera lacks 'step', a number"},
             {scene_with_camera("raja.renderer.HorizontalCamera { focal = 0 screenWidth = 0 "
                                "screenHeight = -0 origin = raja.Point3D { 0 ; 0 ; 0 } direction = "
                                "raja.Vector3D { 1 ; 0 ; 0 } }"),
              "t:2:1: raja.renderer.HorizontalCamera: the screen is a point at the eye"},
             // forms
             {plane("0 ; -0 ; 0"), "t:3:1: raja.shape.Plane: 'normal'" + no_length},
             {plane("0 ; 0 ; " + tiny), "t:3:1: raja.shape.Plane: 'normal'" + no_length},
             {plane("0 ; 0 ; " + huge), "t:3:1: raja.shape.Plane: 'normal'" + no_length},
             {scene_with_form(
                  "raja.shape.Cylinder { origin = raja.Point3D { 0 ; 0 ; 0 } radius = 1 "
                  "direction =\nraja.Vector3D { 0 ; 0 ; 0 } }"),
              "t:3:1: raja.shape.Cylinder: 'direction'" + no_length},
             {scene_with_form("raja.shape.Cone { origin = raja.Point3D { 0 ; 0 ; 0 } angle = 1 "
                              "direction =\nraja.Vector3D { 0 ; 0 ; 0 } }"),
              "t:3:1: raja.shape.Cone: 'direction'" + no_length},
             {cone("0"), no_cone},
             {cone("0.000000001"), no_cone},
             {cone("3.14159265358979"), no_cone},
             {scene_with_form("raja.shape.Sphere { radius = 1 }"),
              "t:2:1: raja.shape.Sphere lacks 'center', a raja.Point3D"},
             // numbers
             {scene_with_number("\n1" + std::string(400, '0')),
              "t:3:1: '1" + std::string(58, '0') + "...' is too large for a number"},
             {scene_with_number("\n-0002" + std::string(400, '0')),
              "t:3:1: '-0002" + std::string(54, '0') + "...' is too large for a number"}}) {
        CHECK(refusal(row.text, "t") == row.want);
    }
}

TEST_CASE("what Raja draws is not refused for being strange") {
    const auto cone = [](std::string_view angle) {
        return scene_with_form("raja.shape.Cone { origin = raja.Point3D { 0 ; 0 ; 0 } direction = "
                               "raja.Vector3D { 0 ; 0 ; 1 } angle = " +
                               std::string(angle) + "}");
    };
    for (const std::string& text :
         {scene_with_number("0"), scene_with_number("-1"), cone("-0.5"), cone("2"), cone("100"),
          scene_with_form("raja.shape.Plane { origin = raja.Point3D { 0 ; 0 ; 0 } normal = "
                          "raja.Vector3D { 0 ; 0 ; 0.00000000000000000000000000001 } }"),
          scene_with_camera(
              "raja.renderer.HorizontalCamera { focal = -1 screenWidth = -1 screenHeight = 0 "
              "origin "
              "= raja.Point3D { 0 ; 0 ; 0 } direction = raja.Vector3D { 0.0001 ; 0 ; 1 } }"),
          scene_with_local_texture("kd = 9 krl = 0 krg = 1 ktg = 1 ns = -1 nt = 0")}) {
        const auto scene = read_raj(text, "t");
        INFO((scene ? "" : scene.error().message));
        CHECK(scene.has_value());
    }
}

TEST_CASE("a name that is nearly right brings the right one") {
    struct Row {
        std::string text;
        std::string_view want;
    };
    for (const Row& row : std::initializer_list<Row>{
             {scene_with_form(
                  "raja.shape.Sphere { center = raja.Point3D { 5 ; 0 ; 0 } radiu = 1 }"),
              "t:2:57: raja.shape.Sphere has no field 'radiu' (did you mean 'radius'?)"},
             {scene_with_form("raja.shape.Shpere { }"),
              "t:2:1: there is no class 'raja.shape.Shpere' (did you mean 'raja.shape.Sphere'?)"},
             {scene_with_form("raja.Cone { }"),
              "t:2:1: there is no class 'raja.Cone' (did you mean 'raja.shape.Cone'?)"},
             {scene_with_form("sphere { }"),
              "t:2:1: expected a number, a label, an object, a list or a graph, found 'sphere' "
              "(did you mean 'raja.shape.Sphere'?)"},
             {scene_with_form("raja.shape.Plane { origin = raja.Point3D (@origin) { 0 ; 0 ; 0 } "
                              "normal = @Orign }"),
              "t:2:75: no label '@Orign' has been defined before this (did you mean '@origin'?)"},
             {scene_with_world("ambientLight = 1"),
              "t:3:1: raja.renderer.World has no field 'ambientLight' (did you mean "
              "'ambiantLight'?)"}})
        CHECK(refusal(row.text, "t") == row.want);
}

TEST_CASE("missing_texture.raj is refused before anything is drawn") {
    CHECK(refusal(bytes_of(scenes_folder() / "missing_texture.raj"), "missing_texture.raj") ==
          "missing_texture.raj:8:22: raja.shape.BasicTexturedForm lacks 'textureOut', a texture "
          "(or 'texture', for both sides)");
}
