#include "client/page/token.hpp"

#include <cstdlib>
#include <doctest/doctest.h>
#include <filesystem>
#include <fstream>
#include <unistd.h>

using namespace fraja;
using namespace fraja::client;
namespace fs = std::filesystem;

TEST_CASE("a fresh token is long, fit for an address, and never the same again") {
    const std::string a = fresh_token(), b = fresh_token();
    CHECK(a.size() == 43);
    CHECK(a.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_") ==
          std::string::npos);
    CHECK(a != b);
    CHECK(is_same_token(a, a));
    CHECK_FALSE(is_same_token(a, b));
    CHECK_FALSE(is_same_token(a, a.substr(1)));
    CHECK_FALSE(is_same_token(a, ""));
}

TEST_CASE("a token is read from a file that is its owner's alone") {
    const fs::path path = fs::temp_directory_path() / ("fraja_token_" + std::to_string(getpid()));
    const auto read = [&](const std::string& text, fs::perms permissions) {
        std::ofstream(path) << text;
        fs::permissions(path, permissions);
        return read_token(path);
    };
    const fs::perms own = fs::perms::owner_read | fs::perms::owner_write;
    const std::string good(token_chars_min, 'x');
    const auto none = read_token(path);
    REQUIRE_FALSE(none);
    const std::string& cure = none.error().message;
    REQUIRE(std::system(cure.substr(cure.find("type: ") + 6).c_str()) == 0);
    CHECK(read_token(path).value_or("").size() == 32);
    CHECK(read(good + "\nand more\n", own).value_or("") == good);
    CHECK(read(std::string(token_chars_max, 'x'), own));
    const auto open = read(good, own | fs::perms::others_read);
    REQUIRE_FALSE(open);
    CHECK(open.error().message.find("chmod 600") != std::string::npos);
    for (const std::string& bad :
         {std::string(), good.substr(1), good + ";", std::string(token_chars_max + 1, 'x')}) {
        CAPTURE(bad);
        CHECK_FALSE(read(bad, own));
    }
    fs::remove(path);
    CHECK_FALSE(read_token(path));
}
