#include "common/cli/manual.hpp"
#include "tests/common/cli/program.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::cli;

TEST_CASE("the manual has every command and every option, as scdoc wants them") {
    Program program;
    program.app.get_option("--loud")->description("Say *more*, as_loud.as you\\can");
    const std::string sections = manual_sections(program.app);
    CAPTURE(sections);
    for (const char* words :
         {"# COMMANDS\n\n*paint* _WALL_ *--like* _ONE\\.raj_\n\tPaint it. *--twice*: Two "
          "coats.\n\n",
          "*polish*\n\tPolish it.\n\n", "# OPTIONS\n\n*-h*, *--help*\n\t",
          "*--mode* _quick\\|careful_\n\tWay of doing it (or FRAJA\\_TEST\\_MODE).\n\n",
          "*-d*, *--depth* _N_\n\tHow deep (0 to 9; default: 5; not with --count).\n\n",
          "*--loud*\n\tSay \\*more\\*, as\\_loud\\.as you\\\\can.\n\n"})
        CHECK(sections.find(words) != std::string::npos);
}

TEST_CASE("a program without commands has no such section") {
    const CLI::App app{"", "plain"};
    CHECK(manual_sections(app).starts_with("# OPTIONS\n\n"));
}
