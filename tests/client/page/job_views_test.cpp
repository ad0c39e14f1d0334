#include "client/page/job_views.hpp"

#include "tests/client/page/small_job.hpp"

#include <atomic>
#include <doctest/doctest.h>
#include <nlohmann/json.hpp>
#include <stdexcept>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

JobId nth(std::uint8_t number) {
    return JobId{{number}};
}

/// Goes on until the view wants to leave.
Outcome patient(JobView& view) {
    while (!view.wants_to_leave())
        std::this_thread::yield();
    return *view.wants_to_leave();
}

void await_end(const JobView& view) {
    while (!view.ended())
        std::this_thread::yield();
}

} // namespace

TEST_CASE("however many look at a job, it has one conversation") {
    std::atomic<int> conversations = 0;
    JobViews views({}, [&](JobView& view) {
        ++conversations;
        return patient(view);
    });
    const auto a = views.look_at(nth(1)), b = views.look_at(nth(1)), c = views.look_at(nth(2));
    REQUIRE(a);
    REQUIRE(b);
    REQUIRE(c);
    CHECK(&(*a)->view() == &(*b)->view());
    CHECK((*a)->view().viewers == 2);
    CHECK(views.find(nth(1)).get() == &(*a)->view());
    CHECK(views.find(nth(3)) == nullptr);
    while (conversations < 2)
        std::this_thread::yield();
    CHECK(conversations == 2);
}

TEST_CASE("a job is dropped some time after the last one has looked") {
    JobViews views({.idle_max = 30s}, patient);
    auto viewer = views.look_at(nth(1));
    REQUIRE(viewer);
    const auto view = views.find(nth(1));
    const Instant begin{};
    views.tidy(begin);
    views.tidy(begin + 1h);
    CHECK(views.find(nth(1)) == view); // somebody looks
    viewer->reset();
    views.tidy(begin + 1h);
    views.tidy(begin + 1h + 29s);
    CHECK(views.find(nth(1)) == view);
    viewer = views.look_at(nth(1)); // came back: as if never away
    views.tidy(begin + 2h);
    viewer->reset();
    views.tidy(begin + 2h);
    views.tidy(begin + 2h + 29s);
    CHECK(views.find(nth(1)) == view);
    views.tidy(begin + 2h + 30s);
    CHECK(views.find(nth(1)) == nullptr);
    await_end(*view);
    views.tidy(begin + 3h);
}

TEST_CASE("what browsers keep of an earlier view is never a later one's") {
    const auto revision_of_a_view = [] {
        JobViews views({}, [](JobView& view) {
            view.hear(Instant{}, Accepted{small_job()});
            view.hear(Instant{}, TileArrived{small_tile(0, 0.5f), 4});
            return Outcome{};
        });
        const auto viewer = views.look_at(small_job().job);
        await_end((*viewer)->view());
        const auto line = nlohmann::json::parse(*(*viewer)->view().shown().text);
        return line.at("job").at("revision").get<std::uint64_t>();
    };
    const std::uint64_t first = revision_of_a_view(), second = revision_of_a_view();
    CHECK(first < second);
    CHECK(second < std::uint64_t{1} << 53); // numbers of a script are exact up to there
}

TEST_CASE("so many jobs can be looked at and no more, but those that nobody looks at make room") {
    JobViews views({.views_max = 2}, patient);
    auto a = views.look_at(nth(1)), b = views.look_at(nth(2));
    const auto refused = views.look_at(nth(3));
    REQUIRE_FALSE(refused);
    CHECK(refused.error().code == ErrorCode::limit_exceeded);
    CHECK(refused.error().message.find("2 jobs") != std::string::npos);
    CHECK(views.look_at(nth(1)));
    a->reset();
    views.tidy(Instant{});
    CHECK(views.look_at(nth(3)));
    CHECK(views.find(nth(1)) == nullptr);
    CHECK(views.find(nth(2)) != nullptr);
}

TEST_CASE("all pictures together have so many pixels, but one of any size is shown") {
    std::atomic<int> taken = 0;
    JobViews views({.pixels_max = 7}, [&](JobView& view) { // a small job has 4
        protocol::JobState job = small_job();
        job.job = view.job();
        view.hear(Instant{}, Accepted{job});
        ++taken;
        return patient(view);
    });
    const auto first = views.look_at(nth(1));
    while (taken < 1)
        std::this_thread::yield();
    const auto second = views.look_at(nth(2));
    await_end((*second)->view());
    CHECK_FALSE((*first)->view().ended());
    CHECK((*second)->view().ended()->code == ExitCode::refused);

    JobViews none({.pixels_max = 1}, [&](JobView& view) {
        view.hear(Instant{}, Accepted{small_job()});
        ++taken;
        return patient(view);
    });
    const auto alone = none.look_at(small_job().job);
    while (taken < 3)
        std::this_thread::yield();
    CHECK((*alone)->view().pixels() == 4);
    CHECK_FALSE((*alone)->view().wants_to_leave());
}

TEST_CASE("what ended too soon begins again when the farm shows that it can go on") {
    struct Row {
        ExitCode ended;
        protocol::JobPhase phase; ///< as the farm has it now
        bool begins_again;
    };
    using enum protocol::JobPhase;
    for (const Row& row :
         {Row{ExitCode::done, done, false}, Row{ExitCode::job_failed, failed, false},
          Row{ExitCode::job_failed, running, true}, // tried again
          Row{ExitCode::no_such_job, running, true}, Row{ExitCode::refused, done, true}}) {
        CAPTURE(static_cast<int>(row.ended));
        std::atomic<int> conversations = 0;
        JobViews views({}, [&](JobView&) {
            ++conversations;
            return Outcome{row.ended, "over"};
        });
        const auto viewer = views.look_at(nth(1));
        await_end((*viewer)->view());
        protocol::FarmState farm;
        views.farm_changed(farm); // it is not there
        CHECK(conversations == 1);
        farm.jobs.resize(1);
        farm.jobs[0].job = nth(1);
        farm.jobs[0].phase = row.phase;
        views.farm_changed(farm);
        await_end((*viewer)->view());
        CHECK(conversations == (row.begins_again ? 2 : 1));
    }
}

TEST_CASE("what a conversation throws is the view's trouble") {
    JobViews views({}, [](JobView&) -> Outcome { throw std::runtime_error("disk"); });
    const auto viewer = views.look_at(nth(1));
    await_end((*viewer)->view());
    CHECK((*viewer)->view().shown().text->find("disk") != std::string::npos);
}
