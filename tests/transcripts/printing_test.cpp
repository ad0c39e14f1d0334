#include "tests/transcripts/printing.hpp"

#include "common/protocol/topics.hpp"
#include "tests/broker/farm.hpp"
#include "tests/support/messages.hpp"
#include "tests/support/seeds.hpp"
#include "tests/transcripts/enum_names.hpp"

#include <doctest/doctest.h>

namespace fraja::broker {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

static_assert(enumerators<JobPhase>.front() == "waiting_for_scene");
static_assert(enumerators<LogLevel>.back() == "error");

TEST_CASE("an action is a line with what it says and where it goes") {
    const JobId job = id_of<JobId>(3);
    CHECK(printed(Send{"c", Beat{}}) == "send c Beat");
    CHECK(printed(Send{"c", Refused{RefusalCode::no_such_job, job, "there is no \"x\"\nat all"}}) ==
          "send c Refused code=no_such_job job=3 reason=\"there is no \"x\" at all\"");
    CHECK(printed(Publish{job_topic(job), CancelTile{job, TileIndex{0}, AttemptNumber{7}}}) ==
          "publish J3 CancelTile job=3 tile=0 attempt=7");
    CHECK(printed(Send{"c", Repair{job, 5, Bytes(12)}}) ==
          "send c Repair job=3 tiles_max=5 have=12 bytes");
    CHECK(printed(Persist{4, PutPhase{job, JobPhase::paused, "", 3031ms}}) ==
          "persist 4 PutPhase job=3 phase=paused elapsed=3.031s");
    CHECK(printed(SendStored{"c", job, {TileIndex{1}, TileIndex{2}}, 9}) ==
          "send_stored c job=3 tiles=[1 2] epoch=9");
    CHECK(printed(SendStored{"c", job, {TileIndex{1}}, 9, 11}) ==
          "send_stored c job=3 tiles=[1] epoch=9 version=11");
    CHECK(printed(Log{LogLevel::warning, "kind", "subject", "two\nlines"}) ==
          "log warning two lines");
}

TEST_CASE("durations are printed exactly") {
    struct Row {
        Duration duration;
        std::string_view text;
    };
    for (const Row& row : {Row{0s, "0s"}, Row{5ms, "5ms"}, Row{1ns, "0.000001ms"}, Row{1s, "1s"},
                           Row{3'000'000'001ns, "3.000000001s"}, Row{10min, "600s"},
                           Row{-20ms, "-20ms"}, Row{Duration::min(), "-9223372036.854775808s"}}) {
        CAPTURE(row.text);
        CHECK(printed(row.duration) == row.text);
    }
}

TEST_CASE("every field of every message is told where it is not as usual, on one line") {
    for_each_message_type([]<class M>(std::type_identity<M>) {
        for_each_seed(20, [](Rng& rng) {
            const M message = random_message_of<M>(rng);
            const std::string line = printed(Send{"peer", message});
            CAPTURE(line);
            CHECK(line.starts_with("send peer " + std::string(M::name)));
            CHECK(line.find('\n') == std::string::npos);
            const M usual{};
            const auto check = [&](const auto& field) {
                CHECK((message.*(field.member) == usual.*(field.member) ||
                       line.find(" " + std::string(field.name) + "=") != std::string::npos));
            };
            std::apply([&](const auto&... field) { (check(field), ...); }, FieldsOf<M>::fields());
        });
    });
}

} // namespace
} // namespace fraja::broker
