#include "common/cli/origins.hpp"

#include "common/cli/parse.hpp"
#include "tests/common/cli/program.hpp"
#include "tests/support/folder.hpp"

#include <cstdlib>
#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::cli;

namespace {

/// As the program reads this line, and a settings file for fraja-submit.
struct Read {
    explicit Read(const std::vector<std::string>& typed, const std::string& settings = {},
                  std::vector<Exclusion> exclusions = {})
        : origins(std::move(exclusions)) {
        app.add_option("-r,--size", size)->envname("FRAJA_TEST_SIZE");
        app.add_option("--sizes", size);
        app.add_flag("--local", local);
        app.add_flag("--detach", detach);
        file = folder.write("config.toml", "[fraja-submit]\n" + settings).string();
        if (const auto early = parse(app, typed, origins, {}, {file}))
            mistake = early->text;
    }

    Folder folder;
    CLI::App app{"What it does", "fraja-submit"};
    Origins origins;
    std::string size, mistake, file;
    bool local = false, detach = false;
};

const std::vector<Exclusion> one_place = {{"--detach", "--local"}};

} // namespace

TEST_CASE("a mistake is told in the name that was typed") {
    for (const auto& typed : {std::vector<std::string>{"-r", "640"}, {"-r640"}})
        CHECK(Read(typed).origins.blame("--size 640: written as WxH") == "-r 640: written as WxH");
    CHECK(Read({"--size", "640"}).origins.blame("--size 640: no") == "--size 640: no");
    CHECK(Read({"-r", "640"}).origins.blame("--sizes 640: no") == "--sizes 640: no");
    CHECK(Read({}).origins.blame("--size: no") == "--size: no");
}

TEST_CASE("a mistake in a settings file is told with its place, wherever its option is named") {
    const Read read({}, "size = '640'\nlocal = true\n");
    CHECK(read.origins.is_setting("--size"));
    CHECK_FALSE(read.origins.is_setting("--detach"));
    CHECK(read.origins.blame("--size 640: no") == read.file + ":2:1: --size 640: no");
    CHECK(read.origins.blame("--detach: not with --local") ==
          "--detach: not with --local (--local: " + read.file + ":3:1)");
}

TEST_CASE("a mistake in the environment is told with its variable, unless it was typed over") {
    ::setenv("FRAJA_TEST_SIZE", "640", 1);
    const Read read({}), typed({"-r", "9"});
    ::unsetenv("FRAJA_TEST_SIZE");
    CHECK_FALSE(read.origins.is_typed("--size"));
    CHECK(read.origins.blame("--size 640: no") ==
          "FRAJA_TEST_SIZE in the environment: --size 640: no");
    CHECK(read.origins.blame("--local: not with --size") ==
          "--local: not with --size (--size: FRAJA_TEST_SIZE in the environment)");
    CHECK(typed.origins.is_typed("--size"));
    CHECK(typed.origins.blame("--size 9: no") == "-r 9: no");
}

TEST_CASE("of two options that exclude each other the one that is typed holds") {
    const Read other({"--local"}, "detach = true\n", one_place);
    CHECK(other.mistake.empty());
    CHECK(other.local);
    CHECK_FALSE(other.detach);
    const Read one({"--detach"}, "local = true\n", one_place);
    CHECK(one.mistake.empty());
    CHECK(one.detach);
    CHECK_FALSE(one.local);
    CHECK(Read({}, "detach = true\n", one_place).detach);
    CHECK(Read({}, "detach = false\nlocal = true\n", one_place).local); // false excludes nothing
}

TEST_CASE("a file that wants both of two such options is told of both") {
    const Read read({}, "local = true\ndetach = true\n", one_place);
    CHECK(read.mistake.find(read.file + ":2:1: local and detach (" + read.file +
                            ":3:1) exclude each other") != std::string::npos);
}

TEST_CASE("a program checks its settings files on request, whatever else its line must have") {
    const Read sound({"--check-settings"}, "size = '640x480'\n");
    CHECK(sound.mistake.empty());
    const Read read({"--check-settings"}, "sise = '640x480'\n");
    CHECK(read.mistake ==
          read.file + ":2:1: fraja-submit has no option 'sise' (did you mean 'size'?)\n");
}
