#include "common/cli/completion.hpp"
#include "common/cli/parse.hpp"
#include "tests/common/cli/program.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::cli;

namespace {

/// The words alone, each followed by a blank.
std::string offered(std::vector<std::string> words, const NameSource& names = {}) {
    Program program;
    std::istringstream lines(completions(program.app, std::move(words), names));
    std::string all;
    for (std::string line; std::getline(lines, line);)
        all += line.substr(0, line.find('\t')) + " ";
    return all;
}

} // namespace

TEST_CASE("a shell is offered what may stand where one types") {
    struct Row {
        std::vector<std::string> words;
        std::string want;
    };
    for (const Row& row : {
             Row{{""}, "paint polish "},
             Row{{}, "paint polish "},
             Row{{"po"}, "polish "},
             Row{{"--l"}, "--loud --louder-by "},
             Row{{"paint", "--tw"}, "--twice "},
             Row{{"polish", "--tw"}, ""},
             Row{{"paint", "--he"}, "--help "}, // once, though both have it
             Row{{"--mode", ""}, "quick careful "},
             Row{{"--mode", "c"}, "careful "},
             Row{{"--mode=c"}, "--mode=careful "},
             Row{{"--loud=c"}, ""},
             Row{{"--mode", "quick", ""}, "paint polish "},
             Row{{"--mode=quick", ""}, "paint polish "},
             Row{{"-d", ""}, ""},
             Row{{"-d3", ""}, "paint polish "},
             Row{{"-d", "3", "p"}, "paint polish "},
             Row{{"--loud", "po"}, "polish "},
             Row{{"--to", "x"}, ":files "},
             Row{{"--to=x"}, ":files "},
             Row{{"--in", ""}, ":directories "},
             Row{{"paint", "--like", ""}, ":files raj "},
             Row{{"paint", "a", ""}, ""}, // it takes one
             Row{{"--", "--l"}, ""},
             Row{{"--bogus", "po"}, "polish "},
         }) {
        CAPTURE(doctest::toString(row.words.size()));
        CAPTURE(row.want);
        CHECK(offered(row.words) == row.want);
    }
}

TEST_CASE("each candidate is a line with a word on what it is") {
    Program program;
    CHECK(completions(program.app, {"po"}, {}) == "polish\tPolish it\n");
    const NameSource hostile = [](std::string_view, std::string_view) {
        return std::vector<Candidate>{{"a\nb", "c\td\x1b"}};
    };
    CHECK(completions(program.app, {"paint", "a"}, hostile) == "a b\tc d?\n");
}

TEST_CASE("names that the program must find are asked for when all that stands before is read") {
    Program program;
    std::string asked, depth;
    const NameSource names = [&](std::string_view value, std::string_view begun) {
        asked = std::string(value) + " " + std::string(begun);
        depth = std::to_string(program.depth) + program.mode;
        return std::vector<Candidate>{{"north", ""}, {"south", ""}};
    };
    CHECK(completions(program.app, {"--mode", "quick", "paint", "-d", "7", "so"}, names) ==
          "south\t\n");
    CHECK(asked == "WALL so");
    CHECK(depth == "7quick");
    asked.clear();
    CHECK(offered({"--mode", "q"}, names) == "quick ");
    CHECK(asked.empty());
}

TEST_CASE("a program answers shells and the build before it reads anything else") {
    Program program;
    CHECK(parse(program.app, {"--complete", "po"}, program.origins) ==
          EarlyExit{0, "polish\tPolish it\n"});
    CHECK(parse(program.app, {"--complete"}, program.origins)->code == 0);
    CHECK(parse(program.app, {"--completion", "bash"}, program.origins)->text.find("fraja-test") !=
          std::string::npos);
    CHECK(parse(program.app, {"--completion", "tcsh"}, program.origins)->code == 2);
    CHECK(parse(program.app, {"--manual"}, program.origins)->code == 0);
    CHECK(parse(program.app, {"polish", "--manual"}, program.origins)->code == 2);
}

TEST_CASE("a script names every program and leaves no mark") {
    const std::vector<std::string> programs{"one", "two"};
    for (const char* shell : {"bash", "zsh", "fish"}) {
        const auto script = completion_script(shell, programs);
        REQUIRE(script.has_value());
        CHECK(script->find("one two") != std::string::npos);
        CHECK(script->find('@' + std::string("PROGRAMS")) == std::string::npos);
    }
    CHECK_FALSE(completion_script("tcsh", programs).has_value());
}
