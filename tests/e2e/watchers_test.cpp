#include "common/base/rng.hpp"
#include "tests/e2e/farm.hpp"

using namespace fraja;
using namespace fraja::e2e;

TEST_CASE("twenty watchers that join at random moments each report every tile exactly once") {
    Farm farm;
    farm.add_worker("one");
    farm.add_worker("two");
    const Words picture = {scene("overlapping_spheres"),
                           "--kernel", // seconds, so that there are moments to join at
                           "reference",
                           "-r",
                           instrumented ? "40x30" : "320x240",
                           "-a",
                           "2",
                           "--tile",
                           instrumented ? "2" : "10"}; // 300 or 768 tiles
    const std::uint32_t width = instrumented ? 40 : 320, height = instrumented ? 30 : 240;
    const std::string job = farm.detach(picture);
    Process first = farm.watch(job);
    const auto seed =
        static_cast<std::uint64_t>(std::chrono::steady_clock::now().time_since_epoch().count());
    CAPTURE(seed);
    Rng rng(seed);
    std::vector<Process> watchers;
    std::size_t seen = 0;
    for (int i = 0; i < 19; ++i) {
        const std::size_t next = std::min<std::size_t>(290, seen + rng.below(30));
        if (next > seen)
            wait_for_tiles(first, next);
        seen = next;
        watchers.push_back(farm.watch(job));
    }
    watchers.push_back(std::move(first));
    for (Process& watcher : watchers) {
        CHECK(watcher.wait_for_exit(patience) == 0);
        INFO(watcher.err());
        check_each_pixel_once(tile_lines(watcher.out()), width, height);
    }
    // And one that comes when all is over.
    Process late = farm.watch(job);
    CHECK(late.wait_for_exit(patience) == 0);
    check_each_pixel_once(tile_lines(late.out()), width, height);
}

TEST_CASE("a watcher keeps a picture that ends as the picture") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one");
    const Words picture = {scene("cone"), "-r", "64x48"};
    const std::string want = local_picture(scratch, picture);
    const std::string job = farm.detach(picture);
    Process watcher = farm.watch(job, {"-o", scratch.file("now.png")});
    CHECK(watcher.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("now.png")) == want));
}

TEST_CASE("a watcher ends as its job does") {
    Farm farm;
    farm.add_worker("one");
    Process none = farm.watch("no-such-job");
    CHECK(none.wait_for_exit(patience) == 6);
    const std::string job = farm.detach({scene("overlap_without_priority"), "-r", "40x30"});
    Process failing = farm.watch(job);
    CHECK(failing.wait_for_exit(patience) == 1);
}
