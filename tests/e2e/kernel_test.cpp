// The fast kernel through the programs: one picture, whoever draws it and with what instructions.
#include "tests/e2e/farm.hpp"

using namespace fraja;
using namespace fraja::e2e;

namespace {

/// The instruction sets of this machine, as FRAJA_ISA names them; empty where there is no choice.
Words usable_isas() {
    Words isas;
#if defined(__x86_64__)
    if (__builtin_cpu_supports("x86-64-v2"))
        isas.emplace_back("x86-64-v2");
    if (__builtin_cpu_supports("x86-64-v3"))
        isas.emplace_back("x86-64-v3");
    if (__builtin_cpu_supports("x86-64-v4"))
        isas.emplace_back("x86-64-v4");
#endif
    return isas;
}

/// Glass, solids of solids and textures, in floats: equal to the last bit.
std::vector<Words> pictures() {
    const Words settings = {"--kernel", "fast", "-r", instrumented ? "24x18" : "67x50",
                            "-a",       "2",    "-d", "7"};
    std::vector<Words> pictures;
    for (const char* name : {"overlapping_spheres", "glass_shadow", "csg_drilled_cube",
                             "nested_aggregate", "texture_forms"})
        pictures.push_back(with({scene(name)}, settings));
    return pictures;
}

} // namespace

TEST_CASE("the fast kernel draws one picture with every instruction set") {
    const Scratch scratch;
    for (const Words& picture : pictures()) {
        CAPTURE(picture[0]);
        const std::string want = local_picture(scratch, picture, "want.exr");
        for (const std::string& isa : usable_isas()) {
            CAPTURE(isa);
            CHECK((local_picture(scratch, picture, "isa.exr", {"FRAJA_ISA=" + isa}) == want));
        }
    }
}

TEST_CASE("two workers draw the fast kernel's local picture, whatever the tiles") {
    const Scratch scratch;
    Farm farm;
    const Words isas = usable_isas(); // the workers differ in theirs, where they can
    farm.add_worker("one", {"-j", "1"}, isas.empty() ? Words{} : Words{"FRAJA_ISA=" + isas[0]});
    farm.add_worker("two");
    const std::string path = scratch.file("farm.exr");
    for (const Words& picture : pictures()) {
        const std::string want = local_picture(scratch, picture, "local.exr");
        for (const char* tile : {"5", "64"}) {
            CAPTURE(picture[0]);
            CAPTURE(tile);
            const auto result = farm.submit(with(picture, {"--tile", tile, "-o", path}));
            INFO(result.err);
            REQUIRE(result.exit == 0);
            CHECK((bytes_of(path) == want));
        }
    }
}

TEST_CASE("a worker draws a scene with both kernels at once, each for whom it is meant") {
    const Scratch scratch;
    const Words picture = {scene("csg_basic"), "-r", "60x45", "--tile", "5"};
    const Words fast = with(picture, {"--kernel", "fast"});
    const Words reference = with(picture, {"--kernel", "reference"});
    const std::string want_fast = local_picture(scratch, fast, "local.exr");
    const std::string want_reference = local_picture(scratch, reference, "local.exr");
    Farm farm;
    Process client_a = farm.start_submit(with(fast, {"-o", scratch.file("a.exr")}));
    Process client_b = farm.start_submit(with(reference, {"-o", scratch.file("b.exr")}));
    for (Process* client : {&client_a, &client_b})
        REQUIRE(client->wait_for_words(Process::Stream::err, ": job ", patience).has_value());
    farm.add_worker("one", {"-j", "2"});
    CHECK(client_a.wait_for_exit(patience) == 0);
    CHECK(client_b.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("a.exr")) == want_fast));
    CHECK((bytes_of(scratch.file("b.exr")) == want_reference));
}

TEST_CASE("the fast kernel is what users get, and what it counts comes from a farm as it is") {
    const Scratch scratch;
    const Words picture = {
        scene("overlapping_spheres"), "-r", "64x48", "--tile", "16", "--stats", "--json", "-o",
        scratch.file("x.png")}; // tests depend on the tiles
    const auto local = submit(with(picture, {"--local"}));
    REQUIRE(local.exit == 0);
    const auto want = nlohmann::json::parse(local.out);
    CHECK(want.at("settings").at("kernel") == "fast");
    CHECK(want.at("rays").at("primary") > 0);
    CHECK(want.at("rays").at("shadow") > 0);
    CHECK(want.at("tests").at("form") > 0);
    CHECK(want.at("shaded") > 0);
    CHECK(want.at("pixels").at("truncated") == 0);
    CHECK(want.at("processor_s") > 0); // and it says what it cost
    Farm farm;
    farm.add_worker("one");
    farm.add_worker("two");
    const auto remote = farm.submit(picture);
    REQUIRE(remote.exit == 0);
    const auto got = nlohmann::json::parse(remote.out);
    for (const char* counts : {"rays", "tests", "shaded", "pixels"})
        CHECK(got.at(counts) == want.at(counts));
}

TEST_CASE("a sample that runs out of its budget of rays is said in a sentence") {
    const Scratch scratch;
    const auto result = submit({scene("overlapping_spheres"), "-r", "1x1", "-e", "-d", "10000",
                                "--local", "--stats", "-o", scratch.file("x.png")});
    CHECK(result.exit == 0);
    CHECK(result.out.find("In 1 pixel a sample ran out of its budget of rays") !=
          std::string::npos);
}

TEST_CASE("version names the instruction set in use") {
    for (const std::string& isa : usable_isas())
        for (const char* name : {"fraja-worker", "fraja-submit"}) {
            CAPTURE(name);
            CAPTURE(isa);
            const auto result = run({{program(name), "--version"}, {"FRAJA_ISA=" + isa}}, patience);
            REQUIRE(result.has_value());
            CHECK(result->exit == 0);
            CHECK(result->out.ends_with(", " + isa + "\n"));
        }
}
