#include "common/net/endpoint.hpp"
#include "common/net/reach.hpp"
#include "common/net/sockets.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::net;

TEST_CASE("where nobody answers, it is told whether anything is there") {
    const Context context;
    std::string endpoint;
    {
        const auto router = RouterSocket::bind(context, "tcp://127.0.0.1:0");
        REQUIRE(router.has_value());
        endpoint = router->endpoint();
        CHECK(why_silent(endpoint) ==
              "something listens there, but does not answer as a broker does");
        CHECK(why_unreached(endpoint).empty());
        const auto took = reach("127.0.0.1", parse_endpoint(endpoint, 0)->port);
        REQUIRE(took.has_value());
        CHECK(*took >= Duration::zero());
        CHECK(*took < reach_timeout);
    }
    CHECK(reach("127.0.0.1", 1).error().code == ErrorCode::unreachable);
    CHECK(reach("no-such-host.invalid", 1).error().code == ErrorCode::not_found);
    CHECK(why_silent("tcp://127.0.0.1:1") == "nothing listens there");
    CHECK(why_unreached("tcp://127.0.0.1:1") == "nothing listens there");
    CHECK(why_unreached("ipc:///nowhere").empty());
    CHECK(why_silent("tcp://[::1]:1") != "");
    CHECK(why_silent("tcp://no-such-host.invalid:50057").find("host 'no-such-host.invalid'") !=
          std::string::npos);
    CHECK(why_silent("ipc:///nowhere").empty());
    CHECK(why_silent("rubbish://").empty());
}
