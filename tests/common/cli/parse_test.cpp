#include "common/cli/option_card.hpp"
#include "common/cli/parse.hpp"
#include "tests/common/cli/program.hpp"

#include <cstdlib>
#include <doctest/doctest.h>
#include <sstream>
#include <string>
#include <vector>

using namespace fraja;
using namespace fraja::cli;

namespace {

std::optional<EarlyExit> reads(const std::string& line) {
    Program program;
    return parse(program.app, words_of(line), program.origins);
}

} // namespace

TEST_CASE("a mistake is told as it was typed, with the cure") {
    struct Row {
        std::string line, says;
    };
    for (const Row& row : {
             Row{"", "a command is needed: paint or polish"},
             Row{"piant", "there is no command 'piant' (did you mean 'paint'?)"},
             Row{"sing", "there is no command 'sing'"},
             Row{"paint --like b", "WALL is missing: fraja-test paint WALL --like ONE.raj"},
             Row{"paint a", "--like is missing: fraja-test paint WALL --like ONE.raj"},
             Row{"paint a b", "'b' is one argument too many"},
             Row{"paint a --twcie", "there is no option '--twcie' (did you mean '--twice'?)"},
             Row{"paint a --dpeth=3", "there is no option '--dpeth' (did you mean '--depth'?)"},
             Row{"paint a --lou", "there is no option '--lou' (did you mean '--loud'?)"},
             Row{"paint a --elephant", "there is no option '--elephant'"},
             Row{"paint a -x", "there is no option '-x'"},
             Row{"paint a --mode", "--mode needs a value: MODE"},
             Row{"paint a --mode carefull",
                 "--mode carefull: quick or careful (did you mean 'careful'?)"},
             Row{"paint a --mode blue", "--mode blue: quick or careful"},
             Row{"paint a -d 10", "-d 10: a number is needed, 0 to 9"},
             Row{"paint a --depth=ten", "--depth ten: a number is needed, 0 to 9"},
             Row{"paint a --count many", "--count many: cannot be read as N"},
             Row{"paint a --count 1 --count 2", "--count is given twice"},
             Row{"paint a --count 1 -d 2", "--depth and --count exclude each other: give one of "
                                           "them"},
             Row{"paint a --louder-by 2", "--louder-by is of no use without --loud"},
             Row{"paint a --loud=blue", "--loud takes no value"},
         }) {
        CAPTURE(row.line);
        const auto early = reads(row.line);
        REQUIRE(early.has_value());
        CHECK(early->code == 2);
        CHECK(early->text == "fraja-test: error: " + row.says + " (fraja-test --help)\n");
    }
}

TEST_CASE("a value that is empty is refused, whichever option it is of") {
    struct Row {
        std::vector<std::string> typed;
        std::string says;
    };
    for (const Row& row : {
             Row{{"polish", "--to", ""}, "--to '': empty, and FILE"},
             Row{{"polish", "--to="}, "--to '': empty, and FILE"},
             Row{{"--to=", "polish"}, "--to '': empty, and FILE"},
             Row{{"polish", "-d", ""}, "-d '': empty, and N"},
             Row{{"polish", "--mode", ""}, "--mode '': empty, and quick|careful"},
             Row{{"paint", "a", "--like="}, "--like '': empty, and ONE.raj"},
         }) {
        CAPTURE(row.says);
        Program program;
        const auto early = parse(program.app, row.typed, program.origins);
        REQUIRE(early.has_value());
        CHECK(early->code == 2);
        CHECK(early->text == "fraja-test: error: " + row.says +
                                 " is needed; is a variable not set? (fraja-test --help)\n");
    }
    setenv("FRAJA_TEST_MODE", "", 1); // by custom that is none
    const auto early = reads("polish");
    unsetenv("FRAJA_TEST_MODE");
    CHECK_FALSE(early.has_value());
}

TEST_CASE("a mistake in the environment is told as one") {
    setenv("FRAJA_TEST_MODE", "blue", 1);
    const auto early = reads("polish");
    const auto typed = reads("polish --mode green");
    unsetenv("FRAJA_TEST_MODE");
    REQUIRE(early.has_value());
    CHECK(early->text == "fraja-test: error: FRAJA_TEST_MODE=blue in the environment: quick or "
                         "careful (fraja-test --help)\n");
    REQUIRE(typed.has_value());
    CHECK(typed->text.find("--mode green: ") != std::string::npos);
}

TEST_CASE("what is right is read, and help and version end with 0") {
    Program program;
    CHECK_FALSE(
        parse(program.app, words_of("paint a --like b.raj --mode quick -d 3"), program.origins)
            .has_value());
    CHECK(program.depth == 3);
    CHECK(program.mode == "quick");
    CHECK(reads("--version") == EarlyExit{0, "fraja-test 1.0\n"});
    const auto help = reads("--help");
    REQUIRE(help.has_value());
    CHECK(help->code == 0);
    CHECK(help->text.starts_with("Examples:"));
}

TEST_CASE("help says what an option takes, its bounds and its default, in lines that fit") {
    Program program;
    program.app.get_option("--loud")->description("Say " + std::string(40, 'm') + " " +
                                                  std::string(40, 'm'));
    const std::string help = parse(program.app, {"--help"}, program.origins)->text;
    CAPTURE(help);
    for (const char* words :
         {"--mode quick|careful  ", "Way of doing it (or FRAJA_TEST_MODE)", "-d,--depth N  ",
          "How deep (0 to 9; default: 5; not with --count)", "Commands:", "paint  "})
        CHECK(help.find(words) != std::string::npos);
    std::istringstream lines(help);
    for (std::string line; std::getline(lines, line);)
        CHECK(line.size() <= 100);
    const std::string paint = reads("paint --help")->text;
    CHECK(paint.find("fraja-test paint") != std::string::npos);
}

TEST_CASE("what is refused ends with 2, or with 75 where somebody else has it") {
    CHECK(failure("fraja-test", Error{ErrorCode::io, "no"}) ==
          EarlyExit{2, "fraja-test: error: no\n"});
    CHECK(failure("fraja-test", Error{ErrorCode::in_use, "no"}) ==
          EarlyExit{75, "fraja-test: error: no\n"});
}

TEST_CASE("words are listed as one says them") {
    CHECK(list_of({}).empty());
    CHECK(list_of({"a"}) == "a");
    CHECK(list_of({"a", "b"}) == "a or b");
    CHECK(list_of({"a", "b", "c"}) == "a, b or c");
}
