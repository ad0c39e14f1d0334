#include "common/net/descriptors.hpp"

#include <doctest/doctest.h>
#include <sys/resource.h>

using namespace fraja;
using namespace fraja::net;

namespace {

rlimit descriptor_limit() {
    rlimit limit{};
    REQUIRE(getrlimit(RLIMIT_NOFILE, &limit) == 0);
    return limit;
}

} // namespace

TEST_CASE("descriptors are reserved up to the hard limit, and what is beyond it is said") {
    const rlimit before = descriptor_limit();
    REQUIRE(before.rlim_max >= 400);
    rlimit low = before;
    low.rlim_cur = 200;
    REQUIRE(setrlimit(RLIMIT_NOFILE, &low) == 0);
    CHECK(reserve_descriptors(10).has_value());
    CHECK(descriptor_limit().rlim_cur == 200); // enough as it is
    CHECK(reserve_descriptors(150).has_value());
    CHECK(descriptor_limit().rlim_cur == 400);

    const auto refused = reserve_descriptors(std::size_t{1} << 40);
    REQUIRE_FALSE(refused.has_value());
    CHECK(refused.error().code == ErrorCode::limit_exceeded);
    CHECK(refused.error().message.find("ulimit -Hn") != std::string::npos);
    REQUIRE(setrlimit(RLIMIT_NOFILE, &before) == 0);
}

TEST_CASE("connections get the descriptors that they need, or as many as can be had") {
    const rlimit before = descriptor_limit();
    REQUIRE(before.rlim_max >= 400);
    rlimit low = before;
    low.rlim_cur = 200;
    REQUIRE(setrlimit(RLIMIT_NOFILE, &low) == 0);
    CHECK(reserve_connections(50) == 50);
    CHECK(descriptor_limit().rlim_cur == 200); // enough as it is
    CHECK(reserve_connections(300) == 300);
    CHECK(descriptor_limit().rlim_cur == 400);
    const std::size_t all = reserve_connections(std::size_t{1} << 40);
    CHECK(descriptor_limit().rlim_cur == before.rlim_max);
    CHECK(all == before.rlim_max - 100);
    REQUIRE(setrlimit(RLIMIT_NOFILE, &before) == 0);
}
