#include "common/base/missing_file.hpp"

#include "tests/support/folder.hpp"

#include <doctest/doctest.h>
#include <string>

using namespace fraja;

TEST_CASE("of a file that is not there the one is named that was meant") {
    const Folder folder;
    (void)folder.write("cone.raj", "");
    (void)folder.write("coins.raj", "");
    for (const char* other : {"cone.png", "coen.ra", "notes.txt"})
        (void)folder.write(other, "");
    std::filesystem::create_directory(folder.path / "crate.raj");
    const std::string here = folder.path.string() + "/", none = ": there is no such file";
    struct Row {
        const char* typed;
        const char* meant;
    };
    for (const Row& row : {Row{"coen.raj", "cone.raj"}, Row{"cone", "cone.raj"},
                           Row{"Coin.raj", "coins.raj"}, Row{"note.txt", "notes.txt"}}) {
        CAPTURE(row.typed);
        CHECK(missing_file(here + row.typed, ".raj") ==
              here + row.typed + none + " (did you mean '" + here + row.meant + "'?)");
    }
    for (const char* typed : {"crate.ra", "tumbler.raj", "c", "no/cone.raj"})
        CHECK(missing_file(here + typed, ".raj") == here + typed + none);
    CHECK(missing_file("no-such.raj", ".raj") ==
          "no-such.raj" + none + " in " + std::filesystem::current_path().string());
}
