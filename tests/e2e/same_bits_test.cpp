#include "tests/e2e/farm.hpp"

using namespace fraja;
using namespace fraja::e2e;

TEST_CASE("one picture whatever the tiles and the workers and the threads") {
    const Scratch scratch;
    const Words picture = {scene("overlapping_spheres"), "-r", instrumented ? "24x18" : "96x72",
                           "-a", "2"};
    const std::string want = local_picture(scratch, picture);
    const auto check = [&](const RunResult& result, const std::string& path) {
        INFO(result.err);
        REQUIRE(result.exit == 0);
        CHECK((bytes_of(path) == want));
    };
    const auto with = [&](Words more) {
        Words words = picture;
        words.insert(words.end(), more.begin(), more.end());
        return words;
    };
    const std::string path = scratch.file("picture.png");
    for (const char* threads : {"1", "2"})
        for (const char* tile : {"1", "7", "64", "96"}) { // 96: the whole picture
            CAPTURE(threads);
            CAPTURE(tile);
            check(submit(with({"--local", "-j", threads, "--tile", tile, "-o", path})), path);
        }
    Farm farm;
    int started = 0;
    for (const int workers : {1, 2, 5}) {
        for (; started < workers; ++started)
            farm.add_worker("w" + std::to_string(started), {"-j", started % 2 ? "2" : "1"});
        for (const char* tile : {"1", "7", "64", "96", "auto"}) {
            CAPTURE(workers);
            CAPTURE(tile);
            check(farm.submit(with({"--tile", tile, "-o", path})), path);
        }
    }
    for (const char* order : {"auto", "scan", "spiral", "diadic"})
        check(farm.submit(with({"--order", order, "-o", path})), path);
}

TEST_CASE("a float picture and its metadata are the same bytes from a farm and locally") {
    const Scratch scratch;
    const Words picture = {scene("csg_basic"), "-r", "80x60", "--crop", "10,5,33,40"};
    const std::string want = local_picture(scratch, picture, "local.exr");
    Farm farm;
    farm.add_worker("one");
    Words words = picture;
    words.insert(words.end(), {"-o", scratch.file("farm.exr")});
    REQUIRE(farm.submit(words).exit == 0);
    CHECK((bytes_of(scratch.file("farm.exr")) == want));
}

TEST_CASE("an adaptive picture is the same bytes from a farm and locally, whatever the tiles") {
    const Scratch scratch;
    const auto picture = [](Words more) {
        Words words = {scene("overlapping_spheres"), "-r", instrumented ? "24x18" : "96x72"};
        words.insert(words.end(), more.begin(), more.end());
        return words;
    };
    const std::string want = local_picture(scratch, picture({"--error", "2"}), "want.exr");
    CHECK((local_picture(scratch, picture({"--spp", "4"}), "other.exr") != want));
    const std::string path = scratch.file("picture.exr");
    Farm farm;
    farm.add_worker("one", {"-j", "1"});
    farm.add_worker("two", {"-j", "2"});
    for (const char* tile : {"7", "64", "96"}) {
        CAPTURE(tile);
        const Words words = picture({"--error", "2", "--tile", tile, "-o", path});
        Words local = words;
        local.emplace_back("--local");
        for (const bool on_farm : {false, true}) {
            const RunResult result = on_farm ? farm.submit(words) : submit(local);
            INFO(result.err);
            REQUIRE(result.exit == 0);
            CHECK((bytes_of(path) == want));
            fs::remove(path);
        }
    }
}

TEST_CASE("the same passes are the same bytes, and a time limit ends a job that never would") {
    const Scratch scratch;
    const auto picture = [](Words more) {
        Words words = {scene("overlapping_spheres"), "-r", instrumented ? "24x18" : "96x72"};
        words.insert(words.end(), more.begin(), more.end());
        return words;
    };
    // Time enough for all samples that there may be.
    const Words all = {"--time-limit", "10m", "--max-samples", "12"};
    const std::string want = local_picture(scratch, picture(all), "want.exr");
    Farm farm;
    farm.add_worker("one", {"-j", "1"});
    farm.add_worker("two", {"-j", "2"});
    const std::string path = scratch.file("picture.exr");
    for (const char* tile : {"7", "96"}) {
        CAPTURE(tile);
        Words words = picture(all);
        for (const char* word : {"--tile", tile, "-o", path.c_str()})
            words.emplace_back(word);
        const RunResult result = farm.submit(words);
        INFO(result.err);
        REQUIRE(result.exit == 0);
        CHECK((bytes_of(path) == want));
    }
    // 65,536 samples of deep glass would take hours.
    const RunResult result = farm.submit(picture(
        {"-d", "500", "--time-limit", "300ms", "--max-samples", "65536", "--json", "-o", path}));
    INFO(result.err);
    REQUIRE(result.exit == 0);
    CHECK(result.out.find("\"state\":\"done\"") != std::string::npos);
    CHECK(result.out.find("\"samples_per_pixel\":") != std::string::npos);
    CHECK((bytes_of(path) != want));
}
