// A travel: a list of cameras.
#include "common/scene/raj_reader.hpp"

#include <doctest/doctest.h>
#include <string>
#include <variant>

namespace fraja {
namespace {

std::string camera(int x) {
    return "raja.renderer.HorizontalCamera { origin = raja.Point3D { " + std::to_string(x) +
           " ; 0 ; 0 } direction = raja.Vector3D { 1 ; 0 ; 0 } focal = 1 screenWidth = 2 "
           "screenHeight = 1.5 }";
}

TEST_CASE("the cameras of a travel are read in their order") {
    const std::string labelled = "raja.renderer.HorizontalCamera (@a) {" + camera(5).substr(32);
    const auto read =
        read_raj_cameras("// there and back\n[ " + labelled + ", " + camera(7) + ", @a ]", "t.raj");
    REQUIRE_MESSAGE(read.has_value(), (read ? "" : read.error().message));
    REQUIRE(read->size() == 3);
    CHECK(std::get<HorizontalCamera>(read->at(0)).origin.x == 5);
    CHECK(std::get<HorizontalCamera>(read->at(1)).origin.x == 7);
    CHECK((read->at(2) == read->at(0)));
}

TEST_CASE("a broken travel is refused with its place and the cure") {
    constexpr const char* cure = "a travel is a list of cameras: [ camera, camera, ... ]";
    struct Row {
        std::string text, message;
    };
    for (const Row& row : {
             Row{"[]", std::string("t.raj:1:1: ") + cure + "; there is none in it"},
             Row{camera(1), std::string("t.raj:1:1: ") + cure + ", not a camera"},
             Row{"[\n  raja.Point3D { 0 ; 0 ; 0 }\n]",
                 std::string("t.raj:2:3: ") + cure + ", and here is a raja.Point3D"},
             Row{"[ " + camera(1) + "\n  " + camera(2) + " ]",
                 "t.raj:2:3: expected ',' or ']', found "},
             Row{"[ raja.renderer.HorizontalCamera { focl = 1 } ]",
                 "t.raj:1:36: raja.renderer.HorizontalCamera has no field 'focl' (did you mean "
                 "'focal'?)"},
             Row{"[ raja.renderer.HorizontalCamera { focal = 1 } ]",
                 "t.raj:1:3: "}, // what is missing is named
             Row{"[ " + camera(1) + ",", "t.raj:1:"},
             Row{"", "t.raj:1:1: "},
         }) {
        CAPTURE(row.text);
        const auto read = read_raj_cameras(row.text, "t.raj");
        REQUIRE_FALSE(read.has_value());
        CAPTURE(read.error().message);
        CHECK(read.error().code == ErrorCode::invalid_scene);
        CHECK(read.error().message.starts_with(row.message));
    }
}

TEST_CASE("a travel that is not there, or beyond the limits, is refused") {
    CHECK(read_raj_cameras_file("/nowhere/t.raj").error().code == ErrorCode::io);
    RajLimits limits;
    limits.list_items = 2;
    const std::string three = "[ " + camera(1) + ", " + camera(2) + ", " + camera(3) + " ]";
    CHECK(read_raj_cameras(three, "t.raj", limits).error().code == ErrorCode::limit_exceeded);
}

} // namespace
} // namespace fraja
