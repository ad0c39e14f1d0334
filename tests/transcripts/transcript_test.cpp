// The stories of the broker's core, each in a .txt file beside this one: what it does about what
// happens. FRAJA_UPDATE=1 writes down what it does now; the difference is there to be read.
#include "tests/support/file_bytes.hpp"
#include "tests/transcripts/transcript.hpp"

#include <algorithm>
#include <cstdlib>
#include <doctest/doctest.h>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::broker {
namespace {

namespace fs = std::filesystem;

const fs::path folder = fs::path(FRAJA_SOURCE_DIR) / "tests" / "transcripts";

std::vector<fs::path> transcripts() {
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(folder))
        if (entry.path().extension() == ".txt" && entry.path().filename() != "CMakeLists.txt")
            files.push_back(entry.path());
    std::ranges::sort(files);
    return files;
}

void check(const fs::path& file) {
    const std::string name = file.filename().string(), before = bytes_of(file);
    const Replay now = replay(before, name);
    if (now.error)
        FAIL_CHECK(now.error->message);
    if (now.text != before && std::getenv("FRAJA_UPDATE"))
        std::ofstream(file, std::ios::binary) << now.text;
    else if (const auto difference = first_difference(before, now.text))
        FAIL_CHECK(name << ":" << difference->line << ": the core does something else\n  before "
                        << difference->before << "\n  now    " << difference->now
                        << "\nFRAJA_UPDATE=1 writes that down");
}

TEST_CASE("the core does what its transcripts say") {
    const auto files = transcripts();
    REQUIRE_FALSE(files.empty());
    for (const fs::path& file : files) {
        CAPTURE(file.filename().string());
        check(file);
    }
}

const std::string story = "# A worker comes and goes.\n"
                          "worker a threads=2 credit=3\n"
                          "\n"
                          "leave a\n";

TEST_CASE("a transcript that says what the core does is as it was, whenever it is replayed") {
    const Replay once = replay(story, "story");
    CHECK_FALSE(once.error);
    CHECK(once.text.find("    send a Welcome broker=99 epoch=7") != std::string::npos);
    const Replay twice = replay(once.text, "story");
    CHECK(twice.text == once.text);
    CHECK_FALSE(first_difference(once.text, twice.text));
}

TEST_CASE("what a transcript says of an action and is not so is found, with its line") {
    const std::string told = replay(story, "story").text;
    const auto altered = [&](std::string_view from, std::string_view to) {
        std::string text = told;
        text.replace(text.find(from), from.size(), to);
        const Replay now = replay(text, "story");
        CHECK(now.text == told);
        return first_difference(text, now.text);
    };
    const auto field = altered("epoch=7", "epoch=8");
    REQUIRE(field);
    CHECK(field->line == 4);
    CHECK(field->before.find("epoch=8") != std::string::npos);
    CHECK(field->now.find("epoch=7") != std::string::npos);
    const auto level = altered("log info worker a is gone", "log warning worker a is gone");
    REQUIRE(level);
    CHECK(level->line == 7);
    CHECK_FALSE(altered("worker a is gone", "a has left"));
    const auto missing =
        altered(told.substr(told.find("    send a Welcome"),
                            told.find("\n\n") + 1 - told.find("    send a Welcome")),
                "");
    REQUIRE(missing);
    CHECK(missing->line == 4);
    const auto one_more = altered("leave a\n", "leave a\n    send a Beat\n");
    REQUIRE(one_more);
    CHECK(one_more->line == 7);
}

TEST_CASE("what cannot be carried out is refused, with its line") {
    struct Row {
        std::string_view text, error;
    };
    for (const Row& row :
         {Row{"# Says.\n\ndance a\n", "t:3: there is no command 'dance'"},
          Row{"# Says.\nworker a\n    send a Beat\nrender a\n", "t:4: worker 'a' has no such tile"},
          Row{"# Says.\nrender b\n", "t:2: there is no worker 'b'"},
          Row{"# Says.\nworker a speed=2\n", "t:2: 'speed=2' means nothing here"},
          Row{"# Says.\nworker a threads=two\n", "t:2: 'two' is no number for threads"},
          Row{"# Says.\npass later\n", "t:2: pass takes a duration"},
          Row{"# Says.\n  worker a\n", "t:2: a command begins its line"},
          Row{"# Says nothing.\n", "t:1: "}, Row{"worker a\n", "t:1: "}, Row{"", "t:1: "}}) {
        CAPTURE(row.text);
        const Replay told = replay(row.text, "t");
        REQUIRE(told.error);
        CAPTURE(told.error->message);
        CHECK(told.error->message.starts_with(row.error));
    }
}

TEST_CASE("behind a command that cannot be carried out a transcript is as it was") {
    const Replay told = replay("# Says.\nclient c\nrender c\n    send c Beat\n# And so on.\n", "t");
    CHECK(told.error);
    CHECK(told.text.starts_with("# Says.\nclient c\n    send c Welcome"));
    CHECK(told.text.ends_with("\nrender c\n    send c Beat\n# And so on.\n"));
}

} // namespace
} // namespace fraja::broker
