#include "common/http/address.hpp"

#include <doctest/doctest.h>
#include <unistd.h>

using namespace fraja;
using namespace fraja::http;

TEST_CASE("an address is what a socket binds, and shows as what a browser opens") {
    struct Row {
        const char* endpoint;
        Address want;
        const char* shown;
    };
    for (const Row& row : {Row{"tcp://127.0.0.1:80", {"127.0.0.1", 80}, "http://127.0.0.1:80"},
                           Row{"tcp://[::1]:80", {"::1", 80}, "http://[::1]:80"},
                           Row{"tcp://*:0", {every_interface, 0}, "http://0.0.0.0:0"}}) {
        CAPTURE(row.endpoint);
        const Address address = address_of(*net::parse_endpoint(row.endpoint, 0));
        CHECK(address == row.want);
        CHECK(to_string(address) == row.shown);
    }
}

TEST_CASE("an address that is taken, or none of this machine's, is refused with the cure") {
    const auto first = listen_at({"127.0.0.1", 0});
    REQUIRE(first);
    CHECK(first->address.port != 0);
    const auto second = listen_at(first->address);
    REQUIRE_FALSE(second);
    CHECK(second.error().code == ErrorCode::in_use);
    CHECK(second.error().message == to_string(first->address) +
                                        ": cannot listen there: Address already in use (with port "
                                        "0 the system chooses one)");
    const auto elsewhere = listen_at({"192.0.2.1", 80});
    REQUIRE_FALSE(elsewhere);
    CHECK(elsewhere.error().message.find("http://192.0.2.1:80: cannot listen there: ") == 0);
    close(first->fd);
}
