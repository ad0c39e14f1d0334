#include "tests/e2e/farm.hpp"

using namespace fraja;
using namespace fraja::e2e;

TEST_CASE("emulated workers draw the local picture, whatever the samples and tiles") {
    const Scratch scratch;
    const std::string size = instrumented ? "24x18" : "96x72";
    Farm farm;
    farm.add_emulated("many", 8, {"--emulate", "6@20M", "--emulate", "2@40M"});
    for (const Words& options : {Words{},
                                 {"-a", "2", "--tile", "7"},
                                 {"--crop", "5,3,17,13", "--tile", "1"},
                                 {"--error", "4"},
                                 {"--time-limit", "10m", "--max-samples", "12"}}) {
        Words words = {scene("overlapping_spheres"), "-r", size};
        words.insert(words.end(), options.begin(), options.end());
        const std::string want = local_picture(scratch, words, "want.exr");
        const std::string path = scratch.file("farm.exr");
        words.insert(words.end(), {"--overwrite", "--stats", "-o", path});
        const RunResult result = farm.submit(words);
        INFO(result.err);
        REQUIRE(result.exit == 0);
        CHECK((bytes_of(path) == want));
    }
}

TEST_CASE("an emulated worker takes the time that its rays take at its speed") {
    const Scratch scratch;
    Farm farm;
    farm.add_emulated("one", 1, {"--emulate", "1@10k"});
    const Words words = {scene("cone"),           "-r", "96x72", "--json", "--stats", "-o",
                         scratch.file("cone.png")};
    REQUIRE(farm.submit(words).exit == 0); // draws the picture
    const RunResult result = farm.submit(words);
    REQUIRE(result.exit == 0);
    const auto told = nlohmann::json::parse(result.out);
    const double elapsed_s = told.at("elapsed_s"), rays = told.at("rays").at("total");
    CHECK(elapsed_s >= rays / 10e3);
    CHECK(elapsed_s <= rays / 10e3 * 1.005 + (instrumented ? 1.0 : 0.1));
}

TEST_CASE("emulation that makes no sense is a usage error that names the option") {
    for (const Words& options :
         {Words{"--emulate", "8"}, {"--emulate", "0@3k"}, {"--emulate", "8@fast"}}) {
        Words words = {program("fraja-worker")};
        words.insert(words.end(), options.begin(), options.end());
        const auto result = run({words, {}}, patience);
        REQUIRE(result.has_value());
        CHECK(result->exit == 2);
        CHECK(result->err.find("--emulate") != std::string::npos);
    }
}
