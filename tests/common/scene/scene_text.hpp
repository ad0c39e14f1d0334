// Whole scenes around the one piece of text that a test is about.
#pragma once

#include <string>
#include <string_view>

namespace fraja {

inline constexpr std::string_view a_texture =
    "raja.shape.PlainTexture { localTexture = raja.shape.LocalTexture "
    "{ kd = 0.5 krl = 0 krg = 0 ktl = 0 ktg = 0 ns = 1 nt = 1 } }";
inline constexpr std::string_view a_form =
    "raja.shape.Sphere { center = raja.Point3D { 5 ; 0 ; 0 } radius = 1 }";
inline constexpr std::string_view a_camera =
    "raja.renderer.HorizontalCamera { origin = raja.Point3D { 0 ; 0 ; 0 } direction = "
    "raja.Vector3D { 1 ; 0 ; 0 } focal = 1 screenWidth = 1 screenHeight = 0.75 }";

inline std::string a_textured_form() {
    return "raja.shape.BasicTexturedForm { form = " + std::string(a_form) +
           " texture = " + std::string(a_texture) + " }";
}
inline std::string a_solid() {
    return "raja.shape.BasicSolid { texturedForm = " + a_textured_form() + " }";
}

// The piece begins line 2, or line 3 where it is the fields of what begins line 2.

inline std::string scene_with_world(std::string_view fields) {
    return "raja.renderer.Scene { camera = " + std::string(a_camera) +
           " world =\nraja.renderer.World {\n" + std::string(fields) + "\n} }\n";
}
inline std::string scene_with_camera(std::string_view camera) {
    return "raja.renderer.Scene { world = raja.renderer.World { solid = " + a_solid() +
           " } camera =\n" + std::string(camera) + "\n}\n";
}
inline std::string scene_with_solid(std::string_view solid) {
    return "raja.renderer.Scene { camera = " + std::string(a_camera) +
           " world = raja.renderer.World { solid =\n" + std::string(solid) + "\n} }\n";
}
inline std::string scene_with_textured_form(std::string_view textured_form) {
    return "raja.renderer.Scene { camera = " + std::string(a_camera) +
           " world = raja.renderer.World { solid = raja.shape.BasicSolid { texturedForm =\n" +
           std::string(textured_form) + "\n} } }\n";
}
inline std::string scene_with_form(std::string_view form) {
    return "raja.renderer.Scene { camera = " + std::string(a_camera) +
           " world = raja.renderer.World { solid = raja.shape.BasicSolid { texturedForm = "
           "raja.shape.BasicTexturedForm { form =\n" +
           std::string(form) + "\ntexture = " + std::string(a_texture) + " } } } }\n";
}
inline std::string scene_with_local_texture(std::string_view fields) {
    return "raja.renderer.Scene { camera = " + std::string(a_camera) +
           " world = raja.renderer.World { solid = raja.shape.BasicSolid { texturedForm = "
           "raja.shape.BasicTexturedForm { texture = raja.shape.PlainTexture { localTexture = "
           "\nraja.shape.LocalTexture {\n" +
           std::string(fields) + "\n} } form = " + std::string(a_form) + " } } } }\n";
}
/// A sphere of that radius.
inline std::string scene_with_number(std::string_view radius) {
    return scene_with_form("raja.shape.Sphere { center = raja.Point3D { 5 ; 0 ; 0 } radius = " +
                           std::string(radius) + "\n}");
}

} // namespace fraja
