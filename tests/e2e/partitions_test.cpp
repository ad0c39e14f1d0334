// Brokers on hosts of their own, between which the network breaks: each side goes on, and when it
// is whole again there is one job with one picture.
#include "common/net/clock.hpp"
#include "tests/e2e/brokers.hpp"
#include "tests/support/network_or_skip.hpp"

#include <nlohmann/json.hpp>

using namespace fraja;
using namespace fraja::e2e;

namespace {

constexpr std::size_t broker_count = 3;
constexpr std::size_t host_one = 3, host_two = 4, host_client = 5, host_count = 6;

/// So long that it is not done before those who are cut off are known to be gone.
Words longer_picture() {
    return {scene("overlapping_spheres"),
            "--kernel",
            "reference",
            "-r",
            instrumented ? "160x120" : "480x360",
            "-a",
            "2",
            "--tile",
            instrumented ? "8" : "16"};
}

/// Three brokers, two workers, and a client that has submitted a picture to the first broker.
class Site {
public:
    explicit Site(TestNetwork network, const Words& wishes = {})
        : network_(std::move(network)), brokers_(broker_count, {}, &network_),
          one_(start_worker(brokers_, "one", {"--log-level", "debug"}, &network_, host_one)),
          two_(start_worker(brokers_, "two", {"--log-level", "debug"}, &network_, host_two)),
          client_(start_program("fraja-submit",
                                with(with(longer_picture(), wishes),
                                     {"-b", brokers_.endpoint(0), "-o", scratch_.file("farm.png")}),
                                &network_, host_client)) {
        brokers_.wait_for(0, " pixels queued");
        for (Process* worker : {&one_, &two_})
            wait_for(*worker, ": done in ");
    }

    TestNetwork& network() { return network_; }
    Brokers& brokers() { return brokers_; }
    Process& client() { return client_; }
    /// Tiles that it has drawn, beyond those it had.
    void let_draw(Process& worker, std::size_t tiles) {
        std::size_t seen = 0;
        for (std::size_t at = 0; (at = worker.err().find(": done in ", at)) != std::string::npos;
             ++at)
            ++seen;
        std::size_t count = 0;
        REQUIRE(worker
                    .wait_for_line(
                        Process::Stream::err,
                        [&](std::string_view line) {
                            return contains(line, ": done in ") && ++count == seen + tiles;
                        },
                        patience)
                    .has_value());
    }
    Process& one() { return one_; }
    Process& two() { return two_; }

    /// The client has the picture, and all brokers have the job, done, each with all others.
    void check_one_result() {
        INFO(client_.story());
        for (std::size_t i = 0; i < broker_count; ++i)
            INFO(brokers_.at(i).story());
        CHECK(client_.wait_for_exit(patience) == 0);
        CHECK((bytes_of(scratch_.file("farm.png")) == local_picture(scratch_, longer_picture())));
        for (std::size_t i = 0; i < broker_count; ++i)
            wait_until_done_at(i);
    }

private:
    static void wait_for(Process& process, const std::string& words) {
        INFO(process.story());
        REQUIRE(process.wait_for_words(Process::Stream::err, words, patience).has_value());
    }
    /// As that broker says; asked again and again, as it may have to hear of it first.
    void wait_until_done_at(std::size_t i) {
        nlohmann::json job;
        for (const Instant end = net::now() + patience; net::now() < end;) {
            Process ctl =
                start_program("fraja-ctl", {"-b", brokers_.endpoint(i), "show", "#1", "--json"},
                              &network_, host_client);
            REQUIRE(ctl.wait_for_exit(patience) == 0);
            job = nlohmann::json::parse(ctl.out());
            if (job.at("state") == "done" && job.at("copies") == broker_count - 1)
                return;
        }
        FAIL("a broker does not have it: " << job.dump());
    }

    Scratch scratch_;
    TestNetwork network_;
    Brokers brokers_;
    Process one_, two_, client_;
};

} // namespace

TEST_CASE("a leader that is cut off with a worker draws on, as do the others, and it is one job") {
    auto network = network_or_skip(host_count);
    if (!network)
        return;
    Site site(std::move(*network));
    site.network().divide({{0, host_one}, {1, 2, host_two, host_client}});
    site.brokers().wait_for(1, "this broker leads");
    site.let_draw(site.two(), 3);
    site.network().join();
    site.check_one_result();
}

TEST_CASE(
    "a client that is cut off with the leader gets its picture, and the others have it later") {
    auto network = network_or_skip(host_count);
    if (!network)
        return;
    Site site(std::move(*network));
    site.network().divide({{0, host_one, host_client}, {1, 2, host_two}});
    site.brokers().wait_for(1, "this broker leads");
    CHECK(site.client().wait_for_exit(patience) == 0);
    site.network().join();
    site.check_one_result();
}

TEST_CASE("a broker that hears the others, and is not heard, does no harm") {
    std::vector<std::size_t> deaf{1, 2, host_client};
    bool leads_on = true; // workers hear it, and say so
    SUBCASE("by workers alone") {}
    SUBCASE("by nobody") {
        leads_on = false;
        deaf.insert(deaf.end(), {host_one, host_two});
    }
    auto network = network_or_skip(host_count);
    if (!network)
        return;
    Site site(std::move(*network));
    for (const std::size_t host : deaf)
        site.network().cut(0, host);
    for (const std::size_t i : {std::size_t{1}, std::size_t{2}})
        site.brokers().wait_for(i, "broker " + site.brokers().endpoint(0) + " is gone");
    if (!leads_on)
        site.brokers().wait_for(1, "this broker leads");
    site.let_draw(site.two(), 1);
    for (const std::size_t host : deaf)
        site.network().mend(0, host);
    site.check_one_result();
}

TEST_CASE("two brokers that only the others hear both take no turns, and a checked picture ends") {
    auto network = network_or_skip(host_count);
    if (!network)
        return;
    Site site(std::move(*network), {"--verify", "1"});
    site.network().cut(0, 1);
    site.network().cut(1, 0);
    for (const std::size_t i : {std::size_t{0}, std::size_t{1}})
        site.brokers().wait_for(i, " is gone: 1 other broker of 2");
    REQUIRE_FALSE(site.client().wait_for_exit(0ms).has_value());
    CHECK(site.client().wait_for_exit(patience) == 0);
    CHECK_FALSE(contains(site.brokers().at(0).err(), "leads no more"));
    CHECK_FALSE(contains(site.brokers().at(1).err(), "this broker leads"));
    site.network().mend(0, 1);
    site.network().mend(1, 0);
    site.check_one_result();
}

TEST_CASE("a broker that no worker reaches leaves the lead to one that they reach") {
    auto network = network_or_skip(host_count);
    if (!network)
        return;
    Site site(std::move(*network));
    for (const std::size_t host : {host_one, host_two}) {
        site.network().cut(0, host);
        site.network().cut(host, 0);
    }
    site.brokers().wait_for(1, "no worker reaches " + site.brokers().endpoint(0));
    CHECK(site.client().wait_for_exit(patience) == 0);
    for (const std::size_t host : {host_one, host_two}) {
        site.network().mend(0, host);
        site.network().mend(host, 0);
    }
    site.check_one_result();
}
