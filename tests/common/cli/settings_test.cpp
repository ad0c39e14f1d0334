#include "common/cli/settings.hpp"

#include "common/cli/parse.hpp"
#include "tests/support/folder.hpp"

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <doctest/doctest.h>
#include <string>
#include <vector>

using namespace fraja;

namespace {

/// A program of a few options.
struct Tool {
    CLI::App app{"What it does", "fraja-submit"};
    std::vector<std::string> brokers;
    std::string color = "auto";
    unsigned aa = 0, spp = 0;
    bool json = false;
    cli::Origins origins;

    Tool() {
        app.add_option("-b,--broker", brokers)->delimiter(',')->envname("FRAJA_TEST_BROKER");
        app.add_option("--color", color)->check(CLI::IsMember({"auto", "always", "never"}));
        CLI::Option* const regular = app.add_option("-a,--aa", aa);
        app.add_option("--spp", spp)->excludes(regular);
        app.add_flag("--json", json);
    }
};

} // namespace

TEST_CASE("an option on the command line goes before the environment, and that before the files") {
    const Folder folder;
    const std::vector files = {
        folder.write("own.toml", "broker = 'own'\njson = true\n"),
        folder.write("all.toml", "broker = 'all'\njson = false\ncolor = 'never'\n")};
    {
        Tool p;
        REQUIRE_FALSE(cli::parse(p.app, {}, p.origins, {}, files).has_value());
        CHECK(p.brokers == std::vector<std::string>{"own"});
        CHECK(p.json);
        CHECK(p.color == "never");
    }
    setenv("FRAJA_TEST_BROKER", "c,d", 1);
    {
        Tool p;
        REQUIRE_FALSE(cli::parse(p.app, {}, p.origins, {}, files).has_value());
        CHECK(p.brokers == std::vector<std::string>{"c", "d"});
    }
    {
        Tool p;
        REQUIRE_FALSE(
            cli::parse(p.app, {"-b", "e", "--color", "always"}, p.origins, {}, files).has_value());
        CHECK(p.brokers == std::vector<std::string>{"e"});
        CHECK(p.color == "always");
    }
    unsetenv("FRAJA_TEST_BROKER");
}

TEST_CASE("what is typed outdoes a setting that it excludes") {
    const Folder folder;
    const std::vector files = {folder.write("a.toml", "[fraja-submit]\naa = 4\n")};
    {
        Tool p;
        REQUIRE_FALSE(cli::parse(p.app, {}, p.origins, {}, files).has_value());
        CHECK(p.aa == 4);
    }
    {
        Tool p;
        REQUIRE_FALSE(cli::parse(p.app, {"--spp", "16"}, p.origins, {}, files).has_value());
        CHECK(p.aa == 0);
        CHECK(p.spp == 16);
    }
    {
        Tool p;
        p.app.get_option("--aa")->configurable(false);
        REQUIRE_FALSE(cli::parse(p.app, {}, p.origins, {}, files).has_value());
        CHECK(p.aa == 0);
    }
}

TEST_CASE("a setting is checked as what is typed is, and named with its place") {
    const Folder folder;
    Tool p;
    const auto exit = cli::parse(p.app, {}, p.origins, {},
                                 {folder.write("config.toml", "\ncolor = 'sometimes'\n")});
    REQUIRE(exit.has_value());
    CHECK(exit->code == 2);
    CHECK(exit->text.starts_with("fraja-submit: error: " + folder.path.string() +
                                 "/config.toml:2:1: --color sometimes: "));
}

TEST_CASE("a setting that is empty is refused, as it is where it is typed") {
    const Folder folder;
    for (const char* text : {"broker = ''", "broker = ['a', '']"}) {
        CAPTURE(text);
        Tool p;
        const auto exit = cli::parse(p.app, {}, p.origins, {}, {folder.write("config.toml", text)});
        REQUIRE(exit.has_value());
        CHECK(exit->code == 2);
        CHECK(exit->text.starts_with("fraja-submit: error: " + folder.path.string() +
                                     "/config.toml:1:1: broker = '': empty, and "));
    }
}

TEST_CASE("settings are looked for in the user's folder and then in the system's") {
    setenv("XDG_CONFIG_HOME", "/somewhere", 1);
    setenv("HOME", "/home/ada", 1);
    using Paths = std::vector<std::filesystem::path>;
    CHECK(cli::settings_files() == Paths{"/somewhere/fraja/config.toml", "/etc/fraja/config.toml"});
    setenv("XDG_CONFIG_HOME", "relative", 1);
    CHECK(cli::settings_files() ==
          Paths{"/home/ada/.config/fraja/config.toml", "/etc/fraja/config.toml"});
    unsetenv("HOME");
    CHECK(cli::settings_files() == Paths{"/etc/fraja/config.toml"});
}
