#include "common/service/color.hpp"

#include <cstdlib>
#include <doctest/doctest.h>
#include <fcntl.h>
#include <initializer_list>
#include <unistd.h>

using namespace fraja::service;

TEST_CASE("what is coloured is what was asked for, else a terminal that shows it") {
    const int terminal = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
    REQUIRE(isatty(terminal) == 1);
    const int file = open("/dev/null", O_WRONLY | O_CLOEXEC);
    struct Row {
        ColorChoice choice;
        int fd;
        const char *no_color, *term;
        bool want;
    };
    for (const Row& row : {Row{ColorChoice::automatic, terminal, "", "xterm", true},
                           Row{ColorChoice::automatic, terminal, "1", "xterm", false},
                           Row{ColorChoice::automatic, terminal, "", "dumb", false},
                           Row{ColorChoice::automatic, file, "", "xterm", false},
                           Row{ColorChoice::always, terminal, "1", "dumb", true},
                           Row{ColorChoice::always, file, "", "xterm", true},
                           Row{ColorChoice::never, terminal, "", "xterm", false}}) {
        CAPTURE(row.no_color);
        CAPTURE(row.term);
        CAPTURE(row.want);
        setenv("NO_COLOR", row.no_color, 1);
        setenv("TERM", row.term, 1);
        CHECK(wants_color(row.choice, row.fd) == row.want);
    }
    unsetenv("NO_COLOR");
    unsetenv("TERM");
    CHECK(wants_color(ColorChoice::automatic, terminal));
    close(terminal);
    close(file);
}
