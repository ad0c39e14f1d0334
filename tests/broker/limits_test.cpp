// Every limit of the broker, met.
#include "common/protocol/limits.hpp"
#include <cmath>

#include "tests/broker/farm.hpp"

using namespace fraja;
using namespace fraja::broker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

TEST_CASE("workers beyond workers_max are refused") {
    Limits limits;
    limits.workers_max = 2;
    Farm farm(limits);
    farm.worker_arrives("a", 1, 1, 1);
    farm.worker_arrives("b", 2, 1, 1);
    farm.worker_arrives("c", 3, 1, 1);
    CHECK(farm.last<Refused>("c").code == RefusalCode::limit_exceeded);
    CHECK(farm.dispatcher.worker_count() == 2);
    farm.say("a", Goodbye{});
    farm.worker_arrives("c", 3, 1, 1);
    CHECK(farm.heard<Welcome>("c"));
}

TEST_CASE("clients beyond clients_max are refused and silent ones are forgotten") {
    Limits limits;
    limits.clients_max = 2;
    Farm farm(limits);
    farm.client_arrives("a");
    farm.client_arrives("b");
    farm.client_arrives("c");
    CHECK(farm.last<Refused>("c").code == RefusalCode::limit_exceeded);
    farm.client_arrives("a"); // who is known may say hello again
    CHECK(farm.all<Welcome>("a").size() == 2);
    farm.pass(10s);
    CHECK(farm.dispatcher.client_count() == 0);
}

TEST_CASE("jobs beyond jobs_max are refused until one is over") {
    Limits limits;
    limits.jobs_max = 2;
    Farm farm(limits);
    farm.submit(1, 1);
    farm.submit(2, 1);
    farm.say("client", Farm::picture(3, 1));
    CHECK(farm.last<Refused>("client").code == RefusalCode::limit_exceeded);
    farm.say("client", ControlJob{id_of<JobId>(1), JobDeed::cancel, 0});
    farm.say("client", Farm::picture(3, 1));
    CHECK(farm.dispatcher.job_count() == 3);
}

TEST_CASE("the oldest finished jobs beyond finished_jobs_max are forgotten") {
    Limits limits;
    limits.finished_jobs_max = 2;
    Farm farm(limits);
    for (std::uint8_t i = 1; i <= 4; ++i) {
        farm.submit(i, 1);
        farm.say("client", ControlJob{id_of<JobId>(i), JobDeed::cancel, 0});
    }
    CHECK(farm.dispatcher.job_count() == 2);
    farm.forget("client");
    farm.say("client", FindJob{"#2"});
    CHECK(farm.heard<Refused>("client"));
    farm.say("client", FindJob{"#3"});
    CHECK(farm.heard<JobState>("client"));
}

TEST_CASE("a job that comes again, forgotten, sends no worker a tile by the name of one it has") {
    Limits limits;
    limits.finished_jobs_max = 1;
    limits.tombstones_max = 0; // else it would be refused
    Farm farm(limits);
    farm.worker_arrives("w", 1, 1, 4);
    for (std::uint8_t id = 1; id <= 2; ++id) {
        farm.submit(id, 1);
        farm.say("client", ControlJob{id_of<JobId>(id), JobDeed::cancel, 0});
    }
    farm.submit(1, 3);
    const std::vector<RenderTile> tiles = farm.tiles("w");
    REQUIRE(tiles.size() == 4); // its credit, with those that it was told to cancel
    for (std::size_t i = 0; i < tiles.size(); ++i)
        for (std::size_t j = 0; j < i; ++j)
            CHECK(std::tuple(tiles[i].job, tiles[i].tile, tiles[i].attempt) !=
                  std::tuple(tiles[j].job, tiles[j].tile, tiles[j].attempt));
}

TEST_CASE("pictures beyond stored_bytes_max push out finished jobs and are else refused") {
    Limits limits;
    limits.stored_bytes_max = 4'000; // one picture of 2 tiles takes 2 x 1200 and a bit
    Farm farm(limits);
    farm.submit(1, 2);
    farm.say("client", Farm::picture(2, 2));
    CHECK(farm.last<Refused>("client").code == RefusalCode::limit_exceeded);
    farm.worker_arrives("w", 1, 1, 2);
    for (const RenderTile& tile : farm.tiles("w"))
        farm.render("w", tile);
    CHECK(farm.state(id_of<JobId>(1)).phase == JobPhase::done);
    farm.say("client", Farm::picture(2, 2));
    CHECK(farm.last<JobState>("client").number == 2);
    CHECK(farm.dispatcher.job_count() == 1);
    farm.say("client",
             ControlJob{id_of<JobId>(2), JobDeed::cancel, 0}); // of which there is nothing to keep
    farm.say("client", Farm::picture(3, 2));
    CHECK(farm.last<JobState>("client").number == 3);
    CHECK(farm.dispatcher.job_count() == 2);
}

TEST_CASE("for what is refused nothing is forgotten") {
    Limits limits;
    limits.stored_bytes_max = 5'000; // a picture of 2 tiles takes 2 x (1200 + 300)
    limits.blob_bytes_max = 2 * scene_bytes.size();
    Farm farm(limits);
    farm.worker_arrives("w", 1, 1, 2);
    farm.submit(1, 1);
    farm.render("w", farm.tiles("w").at(0));
    farm.submit(2, 2);
    SubmitJob large = Farm::picture(3, 3), strange = Farm::picture(4, 1), dear = strange;
    strange.scene_bytes += 1; // its scene is known, and shorter
    dear.scene.bytes[0] ^= 1;
    dear.scene_bytes = scene_bytes.size() + 1; // there are others', beside
    for (const auto& [wanted, code] :
         {std::pair(large, RefusalCode::limit_exceeded), std::pair(strange, RefusalCode::invalid),
          std::pair(dear, RefusalCode::limit_exceeded)}) {
        CAPTURE(to_string(wanted.job));
        farm.forget("client");
        farm.say("client", wanted);
        CHECK(farm.last<Refused>("client").code == code);
        CHECK(farm.dispatcher.job_count() == 2);
    }
}

TEST_CASE("scenes that only what is over has make room for others") {
    Limits limits;
    limits.blob_bytes_max = 2 * scene_bytes.size() - 1;
    Farm farm(limits);
    farm.worker_arrives("w", 1, 1, 2);
    for (const auto id : {std::uint8_t{1}, std::uint8_t{2}}) {
        farm.submit(id, 1);
        farm.render("w", farm.tiles("w").at(0));
    }
    SubmitJob other = Farm::picture(3, 1);
    other.scene.bytes[0] ^= 1;
    farm.say("client", other); // both of the others' jobs have the scene that goes
    CHECK(farm.last<NeedChunk>("client").blob == other.scene);
    CHECK(farm.dispatcher.job_count() == 1);
}

TEST_CASE("one client's pictures take client_bytes_max until they are over; others have room") {
    Limits limits;
    limits.client_bytes_max = 7'000; // a picture of 2 tiles takes 2 x (1200 + 300)
    Farm farm(limits);
    const auto answer_to = [&farm](const Message& message) {
        farm.forget("client");
        farm.say("client", message);
        return farm.heard<Refused>("client") ? std::optional(farm.last<Refused>("client").code)
                                             : std::nullopt;
    };
    farm.submit(1, 2);
    farm.submit(2, 2);
    CHECK(answer_to(Farm::picture(3, 2)) == RefusalCode::limit_exceeded);
    farm.submit("other", Farm::picture(4, 2));
    CHECK(farm.state(id_of<JobId>(4)).phase == JobPhase::queued);
    farm.say("client", ControlJob{id_of<JobId>(1), JobDeed::cancel, 0});
    CHECK(answer_to(Farm::picture(3, 2)) == std::nullopt);
    CHECK(farm.dispatcher.job_count() == 4); // and none was forgotten for it
    CHECK(answer_to(ControlJob{id_of<JobId>(1), JobDeed::retry, 0}) == RefusalCode::limit_exceeded);
    farm.say("client", Goodbye{});
    farm.submit("another connection", Farm::picture(5, 2));
    CHECK(farm.state(id_of<JobId>(5)).phase == JobPhase::queued);
}

TEST_CASE("a job that is tried again needs room as a new one") {
    const auto answer = [](Farm& farm) {
        farm.forget("client");
        farm.say("client", ControlJob{id_of<JobId>(1), JobDeed::retry, 0});
        return farm.heard<Refused>("client") ? std::optional(farm.last<Refused>("client").code)
                                             : std::nullopt;
    };
    for (const Limits& limits : {Limits{.jobs_max = 1}, Limits{.stored_bytes_max = 4'000}}) {
        CAPTURE(limits.jobs_max);
        Farm farm(limits);
        farm.submit(1, 2);
        farm.say("client", ControlJob{id_of<JobId>(1), JobDeed::cancel, 0});
        farm.submit(2, 2);
        CHECK(answer(farm) == RefusalCode::limit_exceeded);
        CHECK(farm.state(id_of<JobId>(1)).phase == JobPhase::cancelled);
        farm.worker_arrives("w", 1, 1, 2);
        for (const RenderTile& tile : farm.tiles("w"))
            farm.render("w", tile);
        REQUIRE(farm.state(id_of<JobId>(2)).phase == JobPhase::done); // 3000 bytes of it are here
        CHECK(answer(farm) == std::nullopt);
        CHECK(farm.state(id_of<JobId>(1)).phase == JobPhase::running);
    }
}

TEST_CASE("of forgotten jobs the newest tombstones_max do not come again") {
    Limits limits;
    limits.finished_jobs_max = 1;
    limits.tombstones_max = 2;
    Farm farm(limits);
    for (std::uint8_t id = 1; id <= 5; ++id) {
        farm.submit(id, 1);
        farm.say("client", ControlJob{id_of<JobId>(id), JobDeed::cancel, 0});
    }
    for (std::uint8_t id = 1; id <= 4; ++id) {
        CAPTURE(static_cast<int>(id));
        farm.forget("client");
        farm.say("client", Farm::picture(id, 1));
        if (id <= 2)
            CHECK(farm.last<JobState>("client").job == id_of<JobId>(id));
        else
            CHECK(farm.last<Refused>("client").code == RefusalCode::conflict);
    }
}

TEST_CASE("more than dealt_cells_max tiles of a fixed size are not dealt out at once") {
    Limits limits;
    limits.dealt_cells_max = 4;
    for (const Schedule schedule : {Schedule::demand, Schedule::equal, Schedule::weighted})
        for (const std::uint32_t tiles : {4u, 5u}) {
            CAPTURE(static_cast<int>(schedule));
            CAPTURE(tiles);
            Farm farm(limits);
            farm.client_arrives("client");
            SubmitJob picture = Farm::picture(1, tiles);
            picture.wishes.schedule = schedule;
            farm.say("client", picture);
            if (tiles == 4 || schedule == Schedule::demand)
                CHECK(farm.heard<JobState>("client"));
            else
                CHECK(farm.last<Refused>("client").code == RefusalCode::invalid);
        }
}

TEST_CASE("scenes beyond blob_bytes_max are refused") {
    Limits limits;
    limits.blob_bytes_max = 50;
    Farm farm(limits);
    farm.submit(1, 1);
    SubmitJob other = Farm::picture(2, 1);
    other.scene.bytes[0] ^= 1;
    farm.say("client", other);
    CHECK(farm.last<Refused>("client").code == RefusalCode::limit_exceeded);
    CHECK(farm.state(id_of<JobId>(1)).phase == JobPhase::queued);
}

TEST_CASE("submissions that make no sense are refused") {
    struct Row {
        const char* what;
        void (*change)(SubmitJob&);
    };
    for (const Row& row : {
             Row{"no id", [](SubmitJob& s) { s.job = {}; }},
             Row{"no pixels",
                 [](SubmitJob& s) {
                     s.settings.size = {0, 0};
                 }},
             Row{"crop outside", [](SubmitJob& s) { s.settings.crop.x = 5; }},
             Row{"no scene", [](SubmitJob& s) { s.scene_bytes = 0; }},
             Row{"scene too large", [](SubmitJob& s) { s.scene_bytes = scene_bytes_max + 1; }},
             Row{"tile too large", [](SubmitJob& s) { s.tile_side = tile_side_max + 1; }},
             Row{"too many tiles",
                 [](SubmitJob& s) {
                     s.settings.size = {1024, cells_per_job_max / 1024 + 1};
                     s.settings.crop = {0, 0, 1024, cells_per_job_max / 1024 + 1};
                     s.tile_side = 1;
                 }},
             Row{"too many tags", [](SubmitJob& s) { s.wishes.tags.assign(tags_max + 1, "t"); }},
             Row{"a tag too long",
                 [](SubmitJob& s) { s.wishes.tags = {std::string(name_bytes_max + 1, 't')}; }},
             Row{"an empty tag", [](SubmitJob& s) { s.wishes.tags = {""}; }},
             Row{"name too long",
                 [](SubmitJob& s) { s.job_name = std::string(name_bytes_max + 1, 'x'); }},
         }) {
        CAPTURE(row.what);
        Farm farm;
        farm.client_arrives("c");
        SubmitJob picture = Farm::picture(1, 2);
        row.change(picture);
        farm.say("c", picture);
        CHECK(farm.last<Refused>("c").code == RefusalCode::invalid);
        CHECK(farm.dispatcher.job_count() == 0);
    }
}

TEST_CASE("a job of cells_per_job_max tiles is taken") {
    Farm farm;
    SubmitJob picture = Farm::picture(1, 1);
    picture.settings.size = {1024, cells_per_job_max / 1024};
    picture.settings.crop = {0, 0, 1024, cells_per_job_max / 1024};
    picture.tile_side = 1;
    CHECK(farm.state(farm.submit("client", picture)).cell_count == cells_per_job_max);
}

TEST_CASE("a scene that does not come for scene_patience fails its job and makes room") {
    Limits limits;
    limits.blob_bytes_max = 50; // for one scene
    Farm farm(limits);
    const auto beat_for = [&](Duration d) { // the client lives, but sends nothing
        for (Duration waited{}; waited < d; waited += 1s) {
            farm.say("client", Beat{});
            farm.pass(1s);
        }
    };
    farm.client_arrives("client");
    farm.say("client", Farm::picture(1, 1));
    REQUIRE(farm.heard<NeedChunk>("client"));
    beat_for(limits.scene_patience - 1s);
    CHECK(farm.state(id_of<JobId>(1)).phase == JobPhase::waiting_for_scene);
    beat_for(2s);
    CHECK(farm.last<JobState>("client").phase == JobPhase::failed);
    SubmitJob other = Farm::picture(2, 1);
    other.scene.bytes[0] ^= 1;
    farm.say("client", other);
    CHECK(farm.state(id_of<JobId>(2)).phase == JobPhase::waiting_for_scene);
}

TEST_CASE("a hello beyond the limits is refused") {
    Farm farm;
    farm.worker_arrives("no threads", 1, 0, 1);
    CHECK(farm.last<Refused>("no threads").code == RefusalCode::limit_exceeded);
    farm.worker_arrives("greedy", 1, 1, credit_max + 1);
    CHECK(farm.last<Refused>("greedy").code == RefusalCode::limit_exceeded);
    const std::string long_name(name_bytes_max + 1, 'x');
    farm.worker_arrives(long_name, 1, 1, 1);
    CHECK(farm.last<Refused>(long_name).code == RefusalCode::limit_exceeded);
    WorkerHello hello;
    hello.threads = hello.credit = 1;
    hello.tags = {"good", long_name};
    farm.say("tagged", hello);
    CHECK(farm.last<Refused>("tagged").code == RefusalCode::limit_exceeded);
    hello.tags.assign(tags_max + 1, "tag");
    farm.say("tags", hello);
    CHECK(farm.last<Refused>("tags").code == RefusalCode::limit_exceeded);
    hello.tags.clear();
    for (const double speed : {2 * speed_rays_per_s_max, HUGE_VAL, std::nan("")}) {
        hello.speed_rays_per_s = speed;
        farm.say("fast", hello);
        CHECK(farm.last<Refused>("fast").code == RefusalCode::limit_exceeded);
        farm.forget("fast");
    }
    CHECK(farm.dispatcher.worker_count() == 0);
}

TEST_CASE("a beat cannot raise the credit beyond credit_max") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 1);
    farm.beat("w", 4'000'000'000u, {});
    farm.submit(1, 5'000);
    CHECK(farm.tiles("w").size() == credit_max);
}

TEST_CASE("one answer to repair is bounded in tiles and bytes") {
    struct Row {
        Limits limits;
        std::size_t sent;
    };
    for (const Row& row :
         {Row{{.repair_tiles_max = 4}, 4}, Row{{.repair_bytes_max = 3'000}, 2}, // 1200 bytes each
          Row{{.repair_bytes_max = 1}, 1}}) { // but for the first one
        CAPTURE(row.sent);
        Farm farm(row.limits);
        const JobId job = farm.submit(1, 6);
        farm.worker_arrives("w", 1, 6, 6);
        for (const auto& tile : farm.tiles("w"))
            farm.render("w", tile);
        farm.say("client", Repair{job, 1'000'000, {}});
        CHECK(farm.all<TileDone>("client").size() == row.sent);
        CHECK(farm.last<RepairDone>("client").remaining_count == 6 - row.sent);
    }
}

TEST_CASE("the farm's state names at most farm_jobs_max jobs and farm_workers_max workers") {
    Limits limits;
    limits.farm_jobs_max = 2;
    limits.farm_workers_max = 3;
    Farm farm(limits);
    for (std::uint8_t i = 1; i <= 5; ++i) {
        farm.submit(i, 1);
        farm.worker_arrives("w" + std::to_string(i), i, 1, 1);
    }
    farm.event(TopicSubscribed{std::string(farm_topic)});
    const auto states = farm.published<FarmState>(std::string(farm_topic));
    REQUIRE_FALSE(states.empty());
    CHECK(states[0].jobs.size() == 2);
    CHECK(states[0].jobs[0].number == 5); // the newest first
    CHECK(states[0].workers.size() == 3);
}

// What peers say in up to string_bytes_max bytes is quoted with words of our own around it.
TEST_CASE("a reason that quotes a peer at length still fits in a message") {
    const std::string longest(string_bytes_max, 'x');
    Farm farm;
    farm.client_arrives("client");
    farm.say("client", FindJob{longest});
    CHECK(farm.last<Refused>("client").reason.size() == string_bytes_max);

    const JobId job = farm.submit(1, 1);
    farm.worker_arrives("w", 1, 1, 1);
    for (std::uint32_t i = 0; i < farm.limits.attempts_max; ++i) {
        const RenderTile tile = farm.tiles("w").at(0);
        farm.say("w", TileFailed{tile.job, tile.tile, tile.attempt, FailureCode::machine, longest});
    }
    CHECK(farm.state(job).phase == JobPhase::failed);
    CHECK(farm.state(job).reason.size() == string_bytes_max);
}

TEST_CASE("the farm's state fits in a frame however long its names and reasons are") {
    Farm farm;
    const auto name = [](std::size_t i) {
        std::string text = std::to_string(i);
        text.resize(name_bytes_max, 'x');
        return text;
    };
    for (std::size_t i = 0; i < farm.limits.farm_workers_max; ++i) {
        WorkerHello hello;
        hello.worker = random_id<WorkerId>();
        hello.worker_name = name(i);
        hello.threads = hello.credit = 1;
        hello.program_version.assign(string_bytes_max, 'x');
        hello.tags = {std::string(100, 'x'), std::string(100, 'x'), "beyond", "beyond"};
        farm.say(name(i), hello);
    }
    for (std::size_t i = 0; i < farm.limits.farm_jobs_max; ++i) {
        SubmitJob picture = Farm::picture(1, 1);
        picture.job = random_id<JobId>();
        picture.job_name = name(i);
        const JobId job = farm.submit("client", picture);
        for (int opinions = 0; opinions < 2; ++opinions)
            for (std::size_t w = 0; w < farm.limits.farm_workers_max; ++w)
                for (const RenderTile& tile : farm.tiles(name(w)))
                    farm.say(name(w),
                             TileFailed{tile.job, tile.tile, tile.attempt, FailureCode::scene,
                                        std::string(string_bytes_max, 'x')});
        CHECK(farm.state(job).phase == JobPhase::failed);
    }
    farm.event(TopicSubscribed{std::string(farm_topic)});
    const auto states = farm.published<FarmState>(std::string(farm_topic));
    REQUIRE_FALSE(states.empty());
    CHECK(states.back().jobs.size() == farm.limits.farm_jobs_max);
    CHECK(states.back().workers.size() == farm.limits.farm_workers_max);
    CHECK(states.back().jobs[0].reason.size() == farm.limits.farm_reason_bytes_max);
    CHECK(states.back().workers[0].program_version.size() == farm.limits.farm_version_bytes_max);
    CHECK(states.back().workers[0].tags.size() == 2);
    CHECK(encode(states.back()).body.size() <= frame_bytes_max);
}
