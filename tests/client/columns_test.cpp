#include "client/columns.hpp"
#include "client/terminal.hpp"

#include <doctest/doctest.h>

using namespace fraja::client;

TEST_CASE("columns are counted as a terminal shows them") {
    CHECK(columns_of("") == 0);
    CHECK(columns_of("cone") == 4);
    CHECK(columns_of("Käse") == 4);
    CHECK(columns_of("光線") == 4);
    CHECK(columns_of("e\u0301") == 1);   // an accent of its own stands on its letter
    CHECK(columns_of("a\xff\xfe") == 3); // no UTF-8
    CHECK(columns_of("\xe5\x85") == 1);  // cut off
}

TEST_CASE("text is cut between characters, within its columns") {
    CHECK(first_columns("cone", 3) == "con");
    CHECK(first_columns("光線", 3) == "光");
    CHECK(first_columns("光線", 4) == "光線");
    CHECK(first_columns("e\u0301f", 1) == "e\u0301");
    CHECK(first_columns("cone", 0).empty());
    CHECK(shortened("cone", 4) == "cone");
    CHECK(shortened("a long name", 8) == "a lon...");
    CHECK(shortened("光線追跡", 7) == "光線...");
    CHECK(shortened("cone", 2) == "..");
    CHECK(shortened("a\nb", 9) == "a b");
}

TEST_CASE("a terminal that has sixels says so by the number 4") {
    CHECK(names_sixel("\x1b[?62;4;22c"));
    CHECK(names_sixel("\x1b[?63;1;4c"));
    CHECK_FALSE(names_sixel("\x1b[?4;2c"));
    CHECK_FALSE(names_sixel("\x1b[?62;14;40c"));
    CHECK_FALSE(names_sixel("4;4;"));
}
