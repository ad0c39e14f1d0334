// A broker whose disk is full: it waits, says so, and goes on when there is room.
#include "tests/e2e/farm.hpp"

#include <csignal>
#include <sys/resource.h>

using namespace fraja;
using namespace fraja::e2e;

// To the broker a limit on the size of files is a disk that is full, and lifting it is room.
TEST_CASE("a job waits while the disk is full, and comes out right") {
    const Scratch scratch;
    const Words picture = {scene("overlapping_spheres"), "-r", "640x480", "--tile", "64"}; // 3.7 MB
    const std::string want = local_picture(scratch, picture);
    const std::string state = scratch.file("state");
    Farm farm({"--heartbeat", heartbeat_option, "--state", state},
              {"env", "--ignore-signal=XFSZ", "prlimit", "--fsize=1000000:unlimited"});
    farm.add_worker("one");
    const std::string job = farm.detach(picture);
    const auto broker_says = [&](std::string_view what) {
        const auto line = farm.broker().wait_for_words(Process::Stream::err, what, patience);
        INFO(farm.broker().story());
        CHECK(line.has_value());
    };
    broker_says("nothing can be kept, so nothing is handed out");
    const auto shown = run({{program("fraja-ctl"), "-b", farm.endpoint(), "show", job}}, patience);
    REQUIRE(shown.has_value());
    INFO(shown->out << shown->err);
    CHECK(contains(shown->out, "waiting: the broker cannot keep what is done"));
    const auto doctor = run({{program("fraja-ctl"), "-b", farm.endpoint(), "doctor"}}, patience);
    REQUIRE(doctor.has_value());
    INFO(doctor->out);
    CHECK(doctor->exit == 1); // it was reached
    CHECK(contains(doctor->out, "BAD store"));

    // It may even start on it.
    farm.broker().send(SIGKILL);
    REQUIRE(farm.broker().wait_for_exit(patience).has_value());
    farm.start_broker_again();
    broker_says("nothing can be kept, so nothing is handed out");

    const rlimit none{RLIM_INFINITY, RLIM_INFINITY};
    REQUIRE(::prlimit(farm.broker().pid(), RLIMIT_FSIZE, &none, nullptr) == 0);
    broker_says("what is done is kept again");
    Process watcher = farm.watch(job, {"-o", scratch.file("farm.png")});
    CHECK(watcher.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("farm.png")) == want));
    farm.broker().send(SIGTERM);
    CHECK(farm.broker().wait_for_exit(patience) == 0);
    const auto checked = run({{program("fraja-broker"), "--state", state, "--check"}}, patience);
    REQUIRE(checked.has_value());
    INFO(checked->out << checked->err);
    CHECK(checked->exit == 0);
    CHECK(contains(checked->out, "80 tiles"));
}
