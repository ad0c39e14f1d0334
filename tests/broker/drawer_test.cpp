#include "broker/drawer.hpp"
#include "tests/broker/farm.hpp"

#include <memory>

namespace fraja::broker {
namespace {

Holder listed(const std::string& key, const std::string& name) {
    return std::make_shared<protocol::KeyHolder>(
        protocol::KeyHolder{key, name, {protocol::Role::worker}});
}

TEST_CASE("whose tiles they are: of a key, whatever a worker says of itself") {
    const WorkerId one = id_of<WorkerId>(1), two = id_of<WorkerId>(2);
    const WorkerId ada = drawer_of(one, listed("A", "ada"));
    CHECK(ada == drawer_of(two, listed("A", "another name in the list")));
    CHECK(ada != drawer_of(one, listed("B", "ada")));
    CHECK(to_string(ada)[14] == '8'); // its version: a random id has 4
    CHECK(std::string("89ab").find(to_string(ada)[19]) != std::string::npos);
    CHECK(drawer_of(one, nullptr) == one);
    const auto shared = std::make_shared<protocol::KeyHolder>(
        protocol::KeyHolder{"A", "machines", {protocol::Role::worker}, true});
    CHECK(drawer_of(one, shared) == one);
    CHECK(voter_of(drawer_of(one, shared), "one") != voter_of(drawer_of(two, shared), "two"));
}

TEST_CASE("who has one voice: a key, or where there are none a name") {
    const WorkerId ada = drawer_of(id_of<WorkerId>(1), listed("A", "ada"));
    CHECK(voter_of(ada, "one") == voter_of(ada, "two"));
    CHECK(voter_of(ada, "one") != voter_of(drawer_of({}, listed("B", "bob")), "one"));
    const WorkerId random = random_id<WorkerId>();
    CHECK(voter_of(random, "one") == voter_of(random_id<WorkerId>(), "one"));
    CHECK(voter_of(random, "one") != voter_of(random, "two"));
}

} // namespace
} // namespace fraja::broker
