#include "client/page/job_view.hpp"

#include "tests/client/page/small_job.hpp"

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;
using Json = nlohmann::json;

namespace {

Json told(JobView& view) {
    return Json::parse(*view.shown().text).at("job");
}

} // namespace

TEST_CASE("a job's picture has a new revision when tiles have come, a few times a second") {
    JobView view(small_job().job, 0, admit_all);
    view.viewers = 1;
    CHECK_FALSE(view.layer(Layer::overview, 1));
    view.hear(Instant{}, Accepted{small_job()});
    CHECK(told(view).at("revision") == 0);
    const auto before = view.shown();
    CHECK(view.shown().text == before.text); // described once

    Instant now = Instant{} + 1s;
    view.hear(now, TileArrived{small_tile(0, 0.5f), 4});
    (void)view.tick(now);
    CHECK(told(view).at("revision") == 1);
    CHECK(view.shown().version > before.version);
    view.hear(now, TileArrived{small_tile(1, 0.5f), 4});
    CHECK(view.tick(now) <= now + 250ms);
    CHECK(told(view).at("revision") == 1); // not yet
    (void)view.tick(now + 1s);
    CHECK(told(view).at("revision") == 2);
    (void)view.tick(now + 2s); // nothing is new
    CHECK(told(view).at("revision") == 2);

    for (const Layer layer : {Layer::overview, Layer::costs, Layer::workers, Layer::pixels}) {
        const auto old = view.layer(layer, 1), newest = view.layer(layer, 2);
        REQUIRE(old);
        REQUIRE(newest);
        CHECK_FALSE(old->is_asked_for);
        CHECK(newest->is_asked_for);
        CHECK(old->bytes == newest->bytes); // encoded once
    }
}

TEST_CASE("no picture is made while nobody looks, and the last one in any case") {
    JobView view(small_job().job, 0, admit_all);
    view.hear(Instant{}, Accepted{small_job()});
    view.hear(Instant{}, TileArrived{small_tile(0, 0.5f), 4});
    (void)view.tick(Instant{} + 1s);
    CHECK(told(view).at("revision") == 0);
    CHECK_FALSE(told(view).at("complete"));
    view.end({});
    CHECK(told(view).at("revision") == 1);
    CHECK(told(view).at("complete"));
    CHECK_FALSE(told(view).contains("trouble"));
}

TEST_CASE("a part is given as it is, where it lies in the picture and is not too large") {
    JobView view(small_job().job, 0, admit_all);
    CHECK_FALSE(view.part({0, 0, 1, 1}));
    view.hear(Instant{}, Accepted{small_job()});
    view.hear(Instant{}, TileArrived{small_tile(0, 0.5f), 4});
    view.end({});
    CHECK(view.part({0, 0, 4, 1}));
    for (const PixelRect& bad :
         {PixelRect{0, 0, 0, 1}, PixelRect{1, 0, 4, 1}, PixelRect{0, 1, 1, 1},
          PixelRect{4'294'967'295, 0, 2, 1}, PixelRect{0, 0, overview_side_max + 1, 1}}) {
        const auto part = view.part(bad);
        REQUIRE_FALSE(part);
        CHECK(part.error().code == ErrorCode::invalid_argument);
    }
}

TEST_CASE("a picture that has no place is not kept, and the viewer is told") {
    JobView view(small_job().job, 0, [](std::uint64_t pixels) { return pixels > 4; });
    view.hear(Instant{}, Accepted{small_job()});
    const auto leaves = view.wants_to_leave();
    REQUIRE(leaves);
    view.hear(Instant{}, TileArrived{small_tile(0, 0.5f), 4}); // may still come
    view.end(*leaves);
    CHECK(told(view).at("trouble") == leaves->reason);
    CHECK(view.pixels() == 0);
    view.begin_again();
    CHECK_FALSE(told(view).contains("trouble"));
    CHECK_FALSE(view.wants_to_leave());
}

TEST_CASE("a job that is watched again begins anew") {
    JobView view(small_job().job, 0, admit_all);
    view.hear(Instant{}, Accepted{small_job()});
    view.hear(Instant{}, TileArrived{small_tile(0, 0.5f), 4});
    view.end({ExitCode::cancelled, "cancelled"});
    CHECK_FALSE(told(view).contains("trouble")); // its state says so
    view.begin_again();
    view.hear(Instant{}, Accepted{small_job()});
    CHECK(told(view).at("revision") == 0);
    view.hear(Instant{}, TileArrived{small_tile(0, 0.5f), 4}); // the same once more
    view.end({});
    CHECK(told(view).at("revision") == 2); // never one that browsers keep already
    CHECK(told(view).at("map").at("workers")[0].at("tiles") == 1);
}
