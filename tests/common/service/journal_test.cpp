#include "common/service/journal.hpp"

#include <cstdio>
#include <cstdlib>
#include <doctest/doctest.h>
#include <string>
#include <sys/stat.h>

using namespace fraja;
using namespace fraja::service;

TEST_CASE("the journal is told from a file that is not its own by its number") {
    std::FILE* const file = std::tmpfile();
    REQUIRE(file != nullptr);
    struct stat about {};
    REQUIRE(fstat(fileno(file), &about) == 0);
    const std::string device = std::to_string(about.st_dev);
    struct Row {
        std::string stream;
        bool want;
    };
    for (const Row& row : {Row{device + ":" + std::to_string(about.st_ino), true},
                           Row{device + ":" + std::to_string(about.st_ino + 1), false},
                           Row{"", false}, Row{"nonsense", false}}) {
        CAPTURE(row.stream);
        setenv("JOURNAL_STREAM", row.stream.c_str(), 1);
        CHECK(goes_to_journal(fileno(file)) == row.want);
    }
    CHECK_FALSE(goes_to_journal(-1));
    unsetenv("JOURNAL_STREAM");
    CHECK_FALSE(goes_to_journal(fileno(file)));
    std::fclose(file);
}

TEST_CASE("a line's level is the journal's priority") {
    CHECK(journal_prefix(LogLevel::error) == "<3>");
    CHECK(journal_prefix(LogLevel::warning) == "<4>");
    CHECK(journal_prefix(LogLevel::info) == "<6>");
    CHECK(journal_prefix(LogLevel::debug) == "<7>");
}
