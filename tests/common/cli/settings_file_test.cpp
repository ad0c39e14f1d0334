#include "common/cli/settings_file.hpp"

#include "tests/support/folder.hpp"

#include <doctest/doctest.h>
#include <filesystem>
#include <string>

using namespace fraja;
using cli::Setting;

namespace {

const std::vector<std::string> options = {"broker", "threads", "tag", "log-level", "nice"};

Result<std::vector<Setting>> read(const std::string& text) {
    const Folder folder;
    return cli::read_settings(folder.write("config.toml", text), "fraja-worker", options);
}

/// Without the folder's name.
std::string mistake_in(const std::string& text) {
    const auto settings = read(text);
    REQUIRE_FALSE(settings.has_value());
    const std::string& message = settings.error().message;
    REQUIRE(message.find("config.toml") != std::string::npos);
    return message.substr(message.find("config.toml"));
}

} // namespace

TEST_CASE("settings are text, numbers, truth values, or lists of them, with their place") {
    const auto settings = read("broker = ['tcp://a:1', 'tcp://b:1']\n"
                               "[fraja-worker]\nthreads = 8\nnice = true\ntag = 0.5\n");
    REQUIRE(settings.has_value());
    REQUIRE(settings->size() == 4);
    const auto& all = *settings;
    CHECK(all[0].option == "nice");
    CHECK(all[0].values == std::vector<std::string>{"true"});
    CHECK(all[1].option == "tag");
    CHECK(all[1].values == std::vector<std::string>{"0.5"});
    CHECK(all[2].option == "threads");
    CHECK(all[2].values == std::vector<std::string>{"8"});
    CHECK(all[2].place.ends_with("config.toml:3:1"));
    CHECK(all[3].option == "broker");
    CHECK(all[3].values == std::vector<std::string>{"tcp://a:1", "tcp://b:1"});
}

TEST_CASE("a program's own table goes before what all share, and others' tables are passed over") {
    const auto settings = read("log-level = 'error'\nprogress = 'none'\n"
                               "[fraja-worker]\nlog-level = 'debug'\n"
                               "[fraja-submit]\nwhatever = 1\n");
    REQUIRE(settings.has_value());
    REQUIRE(settings->size() == 1);
    CHECK(settings->front().values == std::vector<std::string>{"debug"});
}

TEST_CASE("a settings file that is not there says nothing") {
    const Folder folder;
    const auto settings = cli::read_settings(folder.path / "none.toml", "fraja-worker", options);
    REQUIRE(settings.has_value());
    CHECK(settings->empty());
}

TEST_CASE("what cannot be taken from a settings file is named with its place and the cure") {
    struct Row {
        const char* text;
        const char* want;
    };
    for (const Row& row :
         {Row{"brokr = 'x'", "config.toml:1:1: programs share no option 'brokr' (did you mean "
                             "'broker'?)"},
          Row{"\nthreads = 1", "config.toml:2:1: 'threads' is not for every program: it belongs "
                               "below [fraja-worker]"},
          Row{"[fraja-worker]\nthread = 1",
              "config.toml:2:1: fraja-worker has no option 'thread' (did you mean 'threads'?)"},
          Row{"[fraja-wrker]\n",
              "config.toml:1:2: there is no program 'fraja-wrker' (did you mean 'fraja-worker'?)"},
          Row{"[submit]\n",
              "config.toml:1:2: there is no program 'submit' (did you mean 'fraja-submit'?)"},
          Row{"[wokrer]\n",
              "config.toml:1:2: there is no program 'wokrer' (did you mean 'fraja-worker'?)"},
          Row{"[trousers]\n", "config.toml:1:2: there is no program 'trousers'"},
          Row{"[fraja-worker]\ntag = [[1]]",
              "config.toml:2:8: tag: text, a number, true, false, or a list of such"}}) {
        CAPTURE(row.text);
        CHECK(mistake_in(row.text) == row.want);
    }
    CHECK(mistake_in("broker = \n").starts_with("config.toml:1:10: "));
    CHECK(mistake_in("broker = 64x48\n").ends_with(" (words are written in quotes: '64x48')"));
    CHECK(mistake_in("json = true\n\ncolor = never # no\n").ends_with("in quotes: 'never')"));
    CHECK(mistake_in("color = 'never\n").find("in quotes") == std::string::npos);
}

TEST_CASE("a settings file is no directory and no larger than its limit") {
    const Folder folder;
    CHECK(cli::read_settings(folder.path, "fraja-worker", options).error().message ==
          folder.path.string() + ": it is a directory");
    const std::string filling(cli::settings_file_bytes_max, '#');
    CHECK(cli::read_settings(folder.write("fits", filling), "fraja-worker", options).has_value());
    const auto large =
        cli::read_settings(folder.write("large", filling + "#"), "fraja-worker", options);
    REQUIRE_FALSE(large.has_value());
    CHECK(large.error().code == ErrorCode::limit_exceeded);
}
