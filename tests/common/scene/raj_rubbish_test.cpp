#include "common/scene/canonical_order.hpp"
#include "common/scene/raj_reader.hpp"
#include "tests/common/scene/scene_files.hpp"
#include "tests/support/seeds.hpp"

#include <doctest/doctest.h>
#include <string>
#include <vector>

using namespace fraja;

namespace {

const std::vector<std::string>& collection() {
    static const std::vector<std::string> texts = [] {
        std::vector<std::string> all;
        for (const auto& folder : {scenes_folder(), scenes_folder() / "invalid"})
            for (const auto& path : raj_files(folder))
                all.push_back(bytes_of(path));
        return all;
    }();
    return texts;
}

/// Reads the text, from a buffer of exactly its size so that the sanitizers see every step beyond.
/// A refusal must name a place; whatever is read must be sound, so that it can be walked.
void read_rubbish(std::string_view text) {
    const std::vector<char> exact(text.begin(), text.end());
    const auto scene = read_raj({exact.data(), exact.size()}, "rubbish.raj");
    if (!scene)
        CHECK(scene.error().message.starts_with("rubbish.raj:"));
    else
        CHECK(canonical_order(*scene) == *scene);
}

/// One of the slips of hand, of transfer, or of malice.
void mutate(std::string& text, Rng& rng) {
    static constexpr std::string_view pieces[] = {"[[",
                                                  "]]",
                                                  "[",
                                                  "]",
                                                  "{",
                                                  "}",
                                                  "(",
                                                  ")",
                                                  ">>",
                                                  ";",
                                                  ",",
                                                  "=",
                                                  "@",
                                                  "@a",
                                                  "-",
                                                  ".",
                                                  "1e5",
                                                  "//",
                                                  "\n",
                                                  "9999999999",
                                                  "-1",
                                                  "0",
                                                  "\r",
                                                  "\t",
                                                  "\"",
                                                  "\xFF",
                                                  "raja.shape.Union",
                                                  "raja.RGB",
                                                  "raja.shape.Sphere"};
    const std::size_t at = rng.below(text.size() + 1);
    const std::size_t length = rng.below(40);
    switch (rng.below(5)) {
    case 0: // bytes lost
        text.erase(at, length);
        break;
    case 1: // a byte changed
        if (at < text.size())
            text[at] = static_cast<char>(rng.below(256));
        break;
    case 2: // bytes twice
        text.insert(rng.below(text.size() + 1), text.substr(at, length));
        break;
    case 3: // bytes from another file
        text.insert(at, collection()[rng.below(collection().size())].substr(0, length));
        break;
    default:
        text.insert(at, pieces[rng.below(std::size(pieces))]);
    }
}

} // namespace

TEST_CASE("a scene cut at any byte is refused or read") {
    const std::string text = bytes_of(scenes_folder() / "labels.raj"); // it has everything
    for (std::size_t n = 0; n < text.size(); ++n)
        read_rubbish(std::string_view(text).substr(0, n));
    for (const std::string& other : collection())
        for (std::size_t n = 0; n < other.size(); n += 31)
            read_rubbish(std::string_view(other).substr(0, n));
}

TEST_CASE("every scene with slips in it is refused or read") {
    for_each_seed(4'000, [](Rng& rng) {
        std::string text = collection()[rng.below(collection().size())];
        for (std::size_t n = 1 + rng.below(4); n > 0; --n)
            mutate(text, rng);
        read_rubbish(text);
    });
}

TEST_CASE("random bytes are refused") {
    for_each_seed(2'000, [](Rng& rng) {
        std::string text(rng.below(200), '\0');
        for (char& c : text)
            c = static_cast<char>(rng.below(256));
        read_rubbish(text);
    });
}

TEST_CASE("much of the same is refused as fast as it is long") {
    for (const std::string_view piece : {"[",
                                         "{",
                                         "raja.shape.Union{texturedForms=[",
                                         "raja.renderer.Scene{world=",
                                         "@",
                                         "@a",
                                         "a.",
                                         "a",
                                         "1",
                                         "-",
                                         ".",
                                         "//",
                                         "//\n",
                                         "\n",
                                         "\r",
                                         ">>",
                                         "raja.shape.Sphere",
                                         "raja.RGB (@a) {",
                                         "\xC3",
                                         "\""}) {
        CAPTURE(piece);
        std::string text;
        while (text.size() < 1'000'000)
            text += piece;
        read_rubbish(text);
        read_rubbish("raja.renderer.Scene { camera = raja.renderer.HorizontalCamera { pixelWidth = "
                     "[ raja.RGB (@a) { 1 ; 1 ; 1 } " +
                     text);
    }
}
