#include "common/scene/raj_limits.hpp"

#include "common/scene/raj_reader.hpp"
#include "tests/common/scene/scene_files.hpp"
#include "tests/common/scene/scene_text.hpp"

#include <doctest/doctest.h>

using namespace fraja;

namespace {

/// The text is read with the limit at `enough`, and refused in its name with one less.
template <class Member>
void check_limit(std::string_view text, Member limit, std::uint64_t enough, std::string_view name) {
    RajLimits limits;
    limits.*limit = enough;
    const auto read = read_raj(text, "test.raj", limits);
    INFO((read ? "" : read.error().message));
    CHECK(read.has_value());
    limits.*limit = enough - 1;
    const auto refused = read_raj(text, "test.raj", limits);
    REQUIRE_FALSE(refused.has_value());
    CAPTURE(refused.error().message);
    CHECK(refused.error().code == ErrorCode::limit_exceeded);
    CHECK(refused.error().message.find("limit '" + std::string(name) + "'") != std::string::npos);
}

std::string repeated(std::string_view piece, std::size_t count) {
    std::string text;
    text.reserve(piece.size() * count);
    for (std::size_t i = 0; i < count; ++i)
        text += piece;
    return text;
}

/// Complements of one form in one another, written out.
std::string nested(std::size_t count) {
    return scene_with_textured_form(repeated("raja.shape.Complement { texturedForm =\n", count) +
                                    a_textured_form() + repeated("}", count));
}

/// The same through labels: each object stands in an ignored field of the camera.
std::string chain(std::size_t count, std::string_view class_and_fields) {
    std::string text = "raja.renderer.Scene { camera = raja.renderer.HorizontalCamera { "
                       "pixelWidth = [ raja.shape.BasicTexturedForm (@0) { form = " +
                       std::string(a_form) + " texture = " + std::string(a_texture) + " }";
    for (std::size_t i = 0; i < count; ++i) {
        std::string object(class_and_fields);
        for (std::size_t at; (at = object.find('#')) != std::string::npos;)
            object.replace(at, 1, "@" + std::to_string(i));
        object.replace(object.find('$'), 1, "(@" + std::to_string(i + 1) + ")");
        text += ",\n" + object;
    }
    return text +
           "] origin = raja.Point3D { 0 ; 0 ; 0 } direction = raja.Vector3D { 1 ; 0 ; 0 } "
           "focal = 1 screenWidth = 1 screenHeight = 1 } world = raja.renderer.World { "
           "solid = raja.shape.BasicSolid { texturedForm = @" +
           std::to_string(count) + " } } }";
}

constexpr std::string_view complement = "raja.shape.Complement $ { texturedForm = # }";
constexpr std::string_view doubling = "raja.shape.Union $ { texturedForms = [ #, # ] }";

} // namespace

TEST_CASE("the bytes of a text are limited") {
    const std::string text = scene_with_solid(a_solid());
    check_limit(text, &RajLimits::bytes, text.size(), "bytes");
}

TEST_CASE("the bytes of a file are limited before it is read") {
    RajLimits limits;
    limits.bytes = 100;
    const auto refused = read_raj_file(scenes_folder() / "cone.raj", limits);
    REQUIRE_FALSE(refused.has_value());
    CHECK(refused.error().code == ErrorCode::limit_exceeded);
    CHECK(refused.error().message.ends_with("cone.raj: more than 100 bytes (limit 'bytes')"));
}

TEST_CASE("the bytes of a token are limited") {
    check_limit(scene_with_number("1." + std::string(998, '5')), &RajLimits::token_bytes, 1000,
                "token_bytes");
    const auto refused = read_raj(scene_with_number(std::string(100'000, '1')), "test.raj");
    REQUIRE_FALSE(refused.has_value());
    CHECK(refused.error().message == "test.raj:2:66: more than 65536 bytes in one name or number "
                                     "(limit 'token_bytes')");
}

TEST_CASE("the items of a list and the edges of a graph are limited") {
    const std::string member = "raja.shape.Aggregate (@a) { solids = [ ] priorities = [[ ]] }";
    check_limit(scene_with_solid("raja.shape.Aggregate { solids = [ " + member +
                                 ", @a, @a ] priorities = [[ @a >> @a ]] }"),
                &RajLimits::list_items, 3, "list_items");
    check_limit(scene_with_solid("raja.shape.Aggregate { solids = [ " + member +
                                 " ] priorities = [[ @a >> @a, @a >> @a, @a >> @a ]] }"),
                &RajLimits::list_items, 3, "list_items");
}

TEST_CASE("different labels are limited") {
    check_limit(scene_with_form("raja.shape.Plane (@a) { origin = raja.Point3D (@b) { 0 ; 0 ; 0 } "
                                "normal = raja.Vector3D (@c) { 0 ; 0 ; 1 } "
                                "normal = raja.Vector3D (@c) { 0 ; 0 ; 1 } }"),
                &RajLimits::labels, 3, "labels");
}

TEST_CASE("solids are limited") {
    check_limit(scene_with_solid("raja.shape.Aggregate { solids = [ " + a_solid() + ", " +
                                 a_solid() + " ] priorities = [[ ]] }"),
                &RajLimits::solids, 3, "solids");
}

TEST_CASE("objects within objects are limited as written") {
    // Scene, World, BasicSolid, complements, BasicTexturedForm, PlainTexture, LocalTexture
    check_limit(nested(4), &RajLimits::nesting, 10, "nesting");
    CHECK(read_raj(nested(194), "test.raj").has_value());
    const auto refused = read_raj(nested(1'000'000), "test.raj");
    REQUIRE_FALSE(refused.has_value());
    CHECK(refused.error().message == "test.raj:199:1: more than 200 objects within one another "
                                     "(limit 'nesting')");
}

TEST_CASE("objects within objects are limited through labels") {
    // BasicSolid, complements, BasicTexturedForm
    check_limit(chain(18, complement), &RajLimits::nesting, 20, "nesting");
    CHECK(read_raj(chain(198, complement), "test.raj").has_value());
    const auto refused = read_raj(chain(10'000, complement), "test.raj");
    REQUIRE_FALSE(refused.has_value());
    CHECK(refused.error().code == ErrorCode::limit_exceeded);
}

TEST_CASE("what labels repeat is counted as often as it is walked") {
    // 2^4 + 2^3 + ... + 1 textured forms and the solid
    check_limit(chain(4, doubling), &RajLimits::expanded_parts, 32, "expanded_parts");
    const auto refused = read_raj(chain(60, doubling), "test.raj");
    REQUIRE_FALSE(refused.has_value());
    CHECK(refused.error().message ==
          "test.raj:26:1: more than 64000000 solids and textured forms, each counted as often as "
          "labels repeat it (limit 'expanded_parts')");
}

#ifdef FRAJA_INSTRUMENTED // a build in which a byte is ten times as dear
constexpr bool instrumented = true;
#else
constexpr bool instrumented = false;
#endif

// How long that takes is tools/bench's business.
TEST_CASE("a million solids are read" * doctest::skip(instrumented)) {
    constexpr std::size_t count = 1'000'000;
    std::string solids = "raja.shape.BasicSolid { texturedForm = raja.shape.BasicTexturedForm (@f) "
                         "{ form = " +
                         std::string(a_form) + " texture = " + std::string(a_texture) + " } }";
    for (std::size_t i = 1; i < count; ++i)
        solids += ",\nraja.shape.BasicSolid { texturedForm = @f }";
    const auto scene = read_raj(
        scene_with_solid("raja.shape.Aggregate { solids = [ " + solids + " ] priorities = [[ ]] }"),
        "test.raj");
    REQUIRE(scene.has_value());
    CHECK(scene->solids.size() == count + 1);
}

TEST_CASE("many solids with labels and priorities are read") {
    constexpr std::size_t count = 50'000;
    std::string solids, priorities;
    for (std::size_t i = 0; i < count; ++i) {
        const std::string label = "@s" + std::to_string(i);
        solids += (i > 0 ? ",\n" : "") + std::string("raja.shape.BasicSolid (") + label +
                  ") { texturedForm = " + a_textured_form() + " }";
        priorities += (i > 0 ? ", @s0 >> " : "@s0 >> ") + label;
    }
    const auto scene = read_raj(scene_with_solid("raja.shape.Aggregate { solids = [\n" + solids +
                                                 "\n] priorities = [[ " + priorities + " ]] }"),
                                "test.raj");
    REQUIRE(scene.has_value());
    CHECK(scene->solids.size() == count + 1);
    CHECK(scene->forms.size() == count);
    CHECK(scene->solid_names[count - 1].label == "@s49999");
}
