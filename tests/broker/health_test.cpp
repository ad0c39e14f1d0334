#include "broker/health.hpp"

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

using namespace fraja;
using namespace fraja::broker;
using namespace std::chrono_literals;

TEST_CASE("a broker is well while its loop turns and its store takes what it is given") {
    const Instant now{1h};
    Report report;
    report.at = now - loop_patience;
    CHECK(health_of(&report, now).is_well);
    CHECK(to_json(health_of(&report, now)) ==
          "{\"schema\":\"fraja.health/1\",\"status\":\"ok\"}\n");

    const Health hangs = health_of(&report, now + 1ms);
    CHECK_FALSE(hangs.is_well);
    CHECK(hangs.reason.find("loop has not turned for 0:05") != std::string::npos);

    report.at = now;
    report.figures.store_trouble = "disk full";
    const Health full = health_of(&report, now);
    CHECK_FALSE(full.is_well);
    CHECK(full.reason.find("disk full") != std::string::npos);

    CHECK_FALSE(health_of(nullptr, now).is_well);

    // What a new start would not mend.
    CHECK(liveness_of(&report, now).is_well);
    CHECK(liveness_of(nullptr, now).is_well);
    CHECK(liveness_of(&report, now + loop_patience + 1ms) ==
          health_of(&report, now + loop_patience + 1ms));
    CHECK_FALSE(liveness_of(&report, now + loop_patience + 1ms).is_well);
}

TEST_CASE("a reason is JSON whatever it quotes") {
    const auto object = nlohmann::json::parse(to_json({false, "\"\\\n\xff"}));
    CHECK(object.at("status") == "failing");
    CHECK(object.contains("reason"));
}
