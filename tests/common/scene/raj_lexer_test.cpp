#include "common/scene/raj_lexer.hpp"

#include <doctest/doctest.h>
#include <string>

using namespace fraja;
using namespace fraja::raj;

namespace {

/// The tokens of a text as one letter each: c class, f field, l label, n number, ! bad, and signs
/// as they are.
std::string kinds_of(std::string_view text) {
    const RajLimits limits;
    Diagnostics diagnostics(text, "test.raj");
    Lexer lexer(text, limits, diagnostics);
    std::string kinds;
    for (Token token = lexer.next(); token.kind != TokenKind::end; token = lexer.next()) {
        const bool is_word = token.kind <= TokenKind::number;
        kinds += is_word ? std::string(1, "?!cfln"[static_cast<int>(token.kind)])
                         : std::string(token.text);
        kinds += ' ';
    }
    return kinds.substr(0, kinds.empty() ? 0 : kinds.size() - 1);
}

} // namespace

TEST_CASE("a token is the longest possible one") {
    struct Row {
        std::string_view text, want;
    };
    for (const Row& row : {Row{"", ""},
                           Row{" \t\r\n", ""},
                           Row{"raja.Point3D", "c"},
                           Row{"Sphere", "c"},
                           Row{"raja.shape.Sphere_2b{", "c {"},
                           Row{"raja..shape.Sphere", "c"},
                           Row{"r2.shape.Sphere", "c"},
                           Row{"raja.sh4pe.Sphere", "!"},
                           Row{"raja.shape", "!"},
                           Row{"raja.shape.4", "!"},
                           Row{"kd.5", "!"},
                           Row{"kD.5", "f n"},
                           Row{"ambiantLight", "f"},
                           Row{"a_1B", "f"},
                           Row{"_a", "! f"},
                           Row{"@", "l"},
                           Row{"@light.main_1", "l"},
                           Row{"@1.a@", "l l"},
                           Row{"@caf\xC3\xA9", "l"},
                           Row{"@a-b", "l ! f"},
                           Row{"7 007 -3 1. .5 -.5 -0.0 00.8", "n n n n n n n n"},
                           Row{"1e5", "n f"},
                           Row{"1E5", "n c"},
                           Row{"1.0.5", "n n"},
                           Row{"1..5", "n n"},
                           Row{"1-2", "n n"},
                           Row{"- . -. --1 +1", "! ! ! ! n ! n"},
                           Row{"focal=1screenWidth=2", "f = n f = n"},
                           Row{"@a>>@b", "l >> l"},
                           Row{">>>", ">> !"},
                           Row{"[[ ]]", "[[ ]]"},
                           Row{"[[[ ]]]", "[[ [ ]] ]"},
                           Row{",;=(){}[]", ", ; = ( ) { } [ ]"},
                           Row{"a//b\nc//d\re//f\r\ng//", "f f f f"},
                           Row{"a/b/*", "f ! f ! !"},
                           Row{"\"x\"", "! f !"},
                           Row{"\xEF\xBB\xBF"
                               "a",
                               "! f"},
                           Row{std::string_view("\0", 1), "!"},
                           Row{"\f", "!"}}) {
        CAPTURE(row.text);
        CHECK(kinds_of(row.text) == row.want);
    }
}

TEST_CASE("a place is a line and an offset for every kind of line end") {
    const std::string_view text = "a\nb\r\nc\rd//x\r\n\r\n  e";
    const RajLimits limits;
    Diagnostics diagnostics(text, "test.raj");
    Lexer lexer(text, limits, diagnostics);
    for (const std::uint32_t line : {1u, 2u, 3u, 4u, 6u})
        CHECK(lexer.next().place.line == line);
    CHECK(lexer.next().kind == TokenKind::end);
    CHECK(lexer.next().kind == TokenKind::end);
}

TEST_CASE("columns count characters from 1") {
    const std::string_view text = "ab\n\xC3\xA9\xE2\x82\xAC\tx";
    Diagnostics diagnostics(text, "test.raj");
    CHECK_FALSE(diagnostics.refuse({.offset = 9, .line = 2}, "here"));
    CHECK(diagnostics.error()->message == "test.raj:2:4: here");
}

TEST_CASE("quoted text stays short and shows no control characters") {
    CHECK(quoted("radiu") == "'radiu'");
    CHECK(quoted("caf\xC3\xA9") == "'caf\xC3\xA9'");
    CHECK(quoted(std::string_view("\x1B[0m\0", 5)) == "'\\x1B[0m\\x00'");
    CHECK(quoted("\xC3") == "'\\xC3'");
    CHECK(quoted("\xFF\xFE") == "'\\xFF\\xFE'");
    CHECK(raj::quoted(std::string(1000, 'a')).size() < 80);
}
