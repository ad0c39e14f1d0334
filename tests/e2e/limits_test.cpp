// The limits that the system sets, met by real processes.
#include "tests/e2e/farm.hpp"

#include <algorithm>
#include <fstream>
#include <sstream>
#include <sys/resource.h>

namespace fraja::e2e {
namespace {

/// Words before a command that is to have so many file descriptors, at first.
Words with_descriptors(const std::string& options, std::uint64_t count) {
    return {"/bin/sh", "-c", "ulimit " + options + " " + std::to_string(count) + " && exec \"$@\"",
            "sh"};
}

/// The soft limit of a running process.
std::uint64_t descriptors_of(const Process& process) {
    std::ifstream limits("/proc/" + std::to_string(process.pid()) + "/limits");
    const std::string name = "Max open files";
    for (std::string line; std::getline(limits, line);)
        if (line.starts_with(name)) {
            std::uint64_t soft = 0;
            std::istringstream(line.substr(name.size())) >> soft;
            return soft;
        }
    return 0;
}

TEST_CASE("a broker has as many descriptors as its peers take, whatever it was started with") {
    rlimit here{};
    REQUIRE(getrlimit(RLIMIT_NOFILE, &here) == 0);
    const std::uint64_t wanted = 20'000 + 2 * 5'000 + 100;
    Farm farm({"--heartbeat", heartbeat_option}, with_descriptors("-Sn", 200));
    CHECK(descriptors_of(farm.broker()) == std::min<std::uint64_t>(wanted, here.rlim_max));
    // Enough for most farms, which need not be told.
    CHECK(contains(farm.broker().err(), "there is room for") == (here.rlim_max < 1'000 + 100));
}

TEST_CASE("a broker whose room for connections is nearly used up says so, once") {
    const std::uint64_t others = 100;
    Farm farm({"--heartbeat", heartbeat_option},
              with_descriptors("-n", others + 12)); // of 12 connections 11 are much
    farm.add_emulated("e", 11, {"--emulate", "11@1k"});
    CHECK(farm.broker()
              .wait_for_words(Process::Stream::err,
                              "of the room for 12 connections, 11 are taken: the system", patience)
              .has_value());
    farm.add_worker("one more");
    CHECK(farm.broker().err().find("are taken") == farm.broker().err().rfind("are taken"));
}

TEST_CASE("a broker that the system lets have few connections says how many, and serves these") {
    const Scratch scratch;
    Farm farm({"--heartbeat", heartbeat_option}, with_descriptors("-n", 300));
    farm.add_worker("one");
    CHECK(descriptors_of(farm.broker()) == 300);
    CHECK(farm.broker().err().find("there is room for 200 connections, and 20000 workers and 5000 "
                                   "clients take 30000") != std::string::npos);
    CHECK(farm.submit({scene("cone"), "-r", "20x15", "-o", scratch.file("cone.png")}).exit == 0);
}

} // namespace
} // namespace fraja::e2e
