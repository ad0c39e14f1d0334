// A program with an option of every kind.
#pragma once

#include "common/cli/origins.hpp"

#include <CLI/CLI.hpp>
#include <sstream>
#include <string>
#include <vector>

namespace fraja::cli {

inline std::vector<std::string> words_of(const std::string& line) {
    std::istringstream stream(line);
    std::vector<std::string> words;
    for (std::string word; stream >> word;)
        words.push_back(word);
    return words;
}

struct Program {
    Program() {
        app.set_version_flag("--version", "fraja-test 1.0");
        app.add_option("--mode", mode, "Way of doing it")
            ->envname("FRAJA_TEST_MODE")
            ->check(CLI::IsMember({"quick", "careful"}))
            ->type_name("MODE");
        app.add_option("-d,--depth", depth, "How deep")
            ->capture_default_str()
            ->check(CLI::Range(0, 9))
            ->type_name("N");
        app.add_option("--count", count, "How many")->type_name("N")->excludes("--depth");
        app.add_option("--to", to, "Where to")->type_name("FILE");
        app.add_option("--in", in, "Where in")->type_name("DIR");
        app.add_flag("--loud", loud, "Say more");
        app.add_option("--louder-by", louder_by, "How much")->needs("--loud")->type_name("N");
        app.require_subcommand(1);
        app.fallthrough();
        CLI::App* const paint = app.add_subcommand("paint", "Paint it");
        paint->add_option("wall", wall, "What")->required()->type_name("WALL");
        paint->add_flag("--twice", twice, "Two coats");
        paint->add_option("--like", like, "An example")->required()->type_name("ONE.raj");
        app.add_subcommand("polish", "Polish it");
    }

    CLI::App app{"Examples:", "fraja-test"};
    std::string mode, wall, to, in, like;
    int depth = 5, count = 0, louder_by = 0;
    bool loud = false, twice = false;
    Origins origins;
};

} // namespace fraja::cli
