#include "client/local/local_farm.hpp"

#include "client/scene_file.hpp"
#include "client/shell.hpp"

#include <doctest/doctest.h>
#include <map>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

class TileCounter final : public Listener {
public:
    void hear(Instant, const News& news) override {
        if (const auto* tile = std::get_if<TileArrived>(&news))
            ++tiles[static_cast<std::uint32_t>(tile->tile.tile)];
    }
    std::optional<Outcome> wants_to_leave() override {
        return leave_after != 0 && tiles.size() >= leave_after ? std::optional(Outcome{})
                                                               : std::nullopt;
    }
    std::map<std::uint32_t, int> tiles;
    std::size_t leave_after = 0;
};

SubmissionRequest request_to(const LocalFarm& farm, const SceneFile& scene) {
    SubmissionRequest request;
    request.job.job = random_id<JobId>();
    request.job.job_name = "cone";
    request.job.scene = scene.hash;
    request.job.scene_bytes = scene.text.size();
    request.job.settings.size = {64, 48};
    request.job.settings.crop = {0, 0, 64, 48};
    request.job.tile_side = 16;
    request.scene_text = scene.text;
    request.session = {{farm.endpoint()}, 30s, "test"};
    request.timeout = 120s;
    return request;
}

} // namespace

TEST_CASE("a farm in this process renders, and is gone without a trace, idle or in mid-job") {
    const auto scene = read_scene_file(FRAJA_SOURCE_DIR "/scenes/cone.raj");
    REQUIRE(scene);
    for (const std::size_t leave_after : {0u, 2u}) {
        CAPTURE(leave_after);
        const net::Context context;
        auto farm = LocalFarm::start(context, 2);
        REQUIRE(farm);
        TileCounter counter;
        counter.leave_after = leave_after;
        CHECK(run_submission(context, request_to(**farm, *scene), counter, nullptr) == Outcome{});
        if (leave_after != 0)
            continue;
        CHECK(counter.tiles.size() == 12);
        for (const auto& [tile, times] : counter.tiles)
            CHECK(times == 1);
    }
}

TEST_CASE("two local farms do not meet") {
    const net::Context a, b;
    const auto first = LocalFarm::start(a, 1);
    const auto second = LocalFarm::start(b, 1);
    REQUIRE(first);
    REQUIRE(second);
    CHECK_FALSE(LocalFarm::start(a, 1)); // the name is taken
}

TEST_CASE("a scene file is read whole, or its fault is named") {
    const auto scene = read_scene_file(FRAJA_SOURCE_DIR "/scenes/cone.raj");
    REQUIRE(scene);
    CHECK(scene->hash != ContentHash{});
    CHECK_FALSE(read_scene_file("/nowhere/cone.raj"));
    CHECK_FALSE(read_scene_file("/"));
    const auto empty = read_scene_file("/dev/null");
    REQUIRE_FALSE(empty);
    CHECK(empty.error().message.starts_with("/dev/null:1:1: "));
}
