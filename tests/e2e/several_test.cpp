// Several brokers that stand for each other, as processes: any but one of them may die in the
// middle of a job.
#include "common/net/clock.hpp"
#include "common/net/keys.hpp"
#include "common/net/sockets.hpp"
#include "common/protocol/codec.hpp"
#include "tests/e2e/brokers.hpp"
#include "tests/e2e/ring.hpp"

#include <algorithm>
#include <optional>
#include <variant>

using namespace fraja;
using namespace fraja::e2e;

namespace {

/// Who says to be a broker, and what it hears; nothing: it is not let in.
std::optional<protocol::Refused> claim_to_be_broker(const net::Context& context,
                                                    const std::string& endpoint) {
    auto socket = net::DealerSocket::connect(context, endpoint);
    REQUIRE(socket.has_value());
    protocol::BrokerHello words;
    words.broker = random_id<BrokerId>();
    words.endpoint = "tcp://127.0.0.1:1";
    const auto hello = protocol::encode(words);
    bool said = false;
    for (const Instant end = net::now() + patience; net::now() < end; net::wait({*socket}, 10ms)) {
        said = said || socket->send(hello) == net::SendStatus::sent;
        if (!said && !socket->refusal().empty())
            return std::nullopt;
        while (const auto frames = socket->receive()) {
            const auto message = protocol::decode(*frames);
            REQUIRE(message.has_value());
            REQUIRE(std::holds_alternative<protocol::Refused>(*message));
            return std::get<protocol::Refused>(*message);
        }
    }
    FAIL("neither let in nor refused");
    return std::nullopt;
}

} // namespace

TEST_CASE("any but one of several brokers may die in the middle of a job, one by one or at once") {
    struct Row {
        std::size_t count;
        std::vector<std::vector<std::size_t>> deaths; ///< those who die at once
        std::size_t left;
    };
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    std::vector<Row> rows{{3, {{0}, {1}}, 2}};
    if (!instrumented)
        rows = {{3, {{0, 1}}, 2},
                {3, {{1, 2}}, 0},
                {5, {{0}, {1}, {2}, {3}}, 4},
                {5, {{0, 1, 3, 4}}, 2}};
    for (const Row& row : rows) {
        CAPTURE(row.count);
        CAPTURE(row.left);
        Brokers brokers(row.count);
        const Process one = start_worker(brokers, "one"), two = start_worker(brokers, "two");
        Process client = start_program(
            "fraja-submit",
            with(long_picture(), {"-b", brokers.endpoint(0), "-o", scratch.file("farm.png")}));
        brokers.wait_for(1, " pixels queued");
        Process watcher = start_program("fraja-watch", {"-b", brokers.endpoint(1), "--json", "#1"});
        for (const std::vector<std::size_t>& dead : row.deaths) {
            wait_for_tiles(watcher, 3);
            for (const std::size_t i : dead)
                brokers.at(i).send(SIGKILL);
            for (const std::size_t i : dead)
                (void)brokers.at(i).wait_for_exit(patience);
        }
        INFO(brokers.at(row.left).err());
        INFO(client.err());
        INFO(watcher.err());
        CHECK(client.wait_for_exit(patience) == 0);
        CHECK(contains(client.err(), "goes on with the broker at ") == (row.left != 0));
        CHECK((bytes_of(scratch.file("farm.png")) == want));
        CHECK(watcher.wait_for_exit(patience) == 0);
        check_each_pixel_once(tile_lines(watcher.out()), instrumented ? 100 : 320,
                              instrumented ? 75 : 240);
    }
}

TEST_CASE("a broker may come, another may be told to go, and the new one may be the last") {
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    Brokers brokers(2);
    const Process one = start_worker(brokers, "one");
    Process client = start_program(
        "fraja-submit",
        with(long_picture(), {"-b", brokers.endpoint(0), "-o", scratch.file("farm.png")}));
    brokers.wait_for(0, " pixels queued");
    brokers.start(2); // nobody was told of it
    brokers.wait_for(2, "has all that the other brokers have");
    brokers.wait_for(2, "worker one is here");
    brokers.at(0).send(SIGTERM);
    CHECK(brokers.at(0).wait_for_exit(patience) == 0);
    brokers.kill(1);
    brokers.wait_for(2, "has taken over");
    INFO(brokers.at(2).err());
    INFO(client.err());
    CHECK(client.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("farm.png")) == want));
}

TEST_CASE("emulated workers that are told of all brokers serve those that are left") {
    const Scratch scratch;
    const Words picture = {scene("overlapping_spheres"), "-r", instrumented ? "32x24" : "96x72"};
    const std::string want = local_picture(scratch, picture);
    Brokers brokers(3);
    std::string all = brokers.endpoint(0);
    for (std::size_t i = 1; i < brokers.count(); ++i)
        all += "," + brokers.endpoint(i);
    Process workers = start_program("fraja-worker", {"-b", all, "--name", "many", "--emulate",
                                                     instrumented ? "3@2k" : "3@10k"});
    for (std::size_t i = 0; i < brokers.count(); ++i)
        for (const char* number : {"1", "2", "3"})
            brokers.wait_for(i, std::string("worker many/") + number + " is here");
    Process client = start_program(
        "fraja-submit", with(picture, {"-b", brokers.endpoint(0), "-o", scratch.file("farm.png")}));
    for (std::size_t dead = 0; dead + 1 < brokers.count(); ++dead) {
        brokers.wait_for(dead, dead == 0 ? " pixels queued" : "has taken over");
        brokers.kill(dead);
    }
    INFO(brokers.at(2).err());
    INFO(client.err());
    CHECK(client.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("farm.png")) == want));
}

TEST_CASE("a broker that comes back is given all, and the next one may die") {
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    Brokers brokers(2);
    Process worker = start_worker(brokers, "one");
    Process client = start_program(
        "fraja-submit",
        with(long_picture(), {"-b", brokers.endpoint(1), "-o", scratch.file("farm.png")}));
    brokers.wait_for(0, " pixels queued");
    brokers.kill(0);
    brokers.wait_for(1, "this broker leads");
    brokers.start(0);
    brokers.wait_for(0, "has all that the other brokers have");
    brokers.wait_for(0, "worker one is here");
    brokers.kill(1);
    brokers.wait_for(0, "this broker leads");
    INFO(brokers.at(0).err());
    INFO(client.err());
    CHECK(client.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("farm.png")) == want));
}

TEST_CASE("a branch serves all brokers above it, whichever leads, and hears of them from one") {
    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    for (const std::size_t named : {0u, 1u}) {
        CAPTURE(named);
        Brokers roots(2);
        Farm branch({"--heartbeat", heartbeat_option, "--upstream", roots.endpoint(named)});
        branch.add_worker("leaf");
        const std::string name = ":" + std::to_string(branch.broker().pid()) + " is here";
        for (std::size_t i = 0; i < 2; ++i)
            roots.wait_for(i, name);
        Process client = start_program(
            "fraja-submit",
            with(long_picture(), {"-b", roots.endpoint(0), "-o", scratch.file("farm.png")}));
        roots.wait_for(1, " pixels queued");
        Process watcher = start_program("fraja-watch", {"-b", roots.endpoint(1), "--json", "#1"});
        wait_for_tiles(watcher, 1);
        roots.kill(0);
        INFO(roots.at(1).err());
        INFO(client.err());
        CHECK(client.wait_for_exit(patience) == 0);
        CHECK((bytes_of(scratch.file("farm.png")) == want));
        if (instrumented)
            break;
    }
}

TEST_CASE("that a single broker is left to keep a job is said, also of one that is left or brief") {
    const Scratch scratch;
    Brokers brokers(2);
    const Process worker = start_worker(brokers, "one");
    const std::string words = "warning: a single broker of 2 keeps the job";
    const auto submit_here = [&](const Words& options) {
        auto ran = submit(with({"-b", brokers.endpoint(1), scene("cone"), "-r", "32x24"}, options));
        INFO(ran.err);
        REQUIRE(ran.exit == 0);
        return ran;
    };
    const auto kept = submit_here({"--detach", "--json"});
    CHECK(!contains(kept.err, "keeps the job"));
    CHECK(nlohmann::json::parse(kept.out).at("copies") == 1);
    CHECK(nlohmann::json::parse(kept.out).at("copies_wanted") == 1);

    brokers.kill(0);
    brokers.wait_for(1, "kept by this one alone");
    const auto detached = submit_here({"--detach"});
    CHECK(contains(detached.err, words));
    CHECK(std::ranges::count(detached.out, '\n') == 1); // the id
    const std::vector<Words> rows{{"--detach", "--json"},
                                  {"--json", "-o", scratch.file("brief.png")}};
    for (const Words& options : rows) {
        const auto ran = submit_here(options);
        CHECK(contains(ran.err, words));
        CHECK(nlohmann::json::parse(ran.out).at("copies") == 0);
        CHECK(nlohmann::json::parse(ran.out).at("copies_wanted") == 1);
    }
    brokers.wait_for(1, "is kept by this broker alone: no other one is here");
}

TEST_CASE("fraja-ctl shows the brokers that were not named, and who leads") {
    Brokers brokers(3);
    const auto shown =
        run({{program("fraja-ctl"), "-b", brokers.endpoint(2), "brokers"}}, patience);
    REQUIRE(shown.has_value());
    CHECK(shown->exit == 0);
    INFO(shown->out);
    for (std::size_t i = 0; i < 3; ++i)
        CHECK(contains(shown->out, brokers.endpoint(i) + (i == 0 ? "  leads" : "  stands by")));
}

TEST_CASE("brokers with keys stand for each other, and nobody else does") {
    const Ring ring;
    ring.allow({{"worker", "worker"}, {"second", "worker"}, {"ada", "submit,admin"}});
    Brokers brokers(3, ring.farm_options());
    Process one = start_worker(brokers, "one", {"--key-file", ring.file("worker")});
    Process two = start_worker(brokers, "two", {"--key-file", ring.file("second")});

    // A friend without the role, somebody whom nobody knows, somebody without a key, and a broker
    // of another farm.
    const auto context_of = [&](const std::string& name) {
        const auto pair = net::key_pair(ring.key(name), ring.secret(name));
        REQUIRE(pair.has_value());
        return net::Context(net::Keys{*pair, {ring.key("farm")}});
    };
    const auto refused = claim_to_be_broker(context_of("worker"), brokers.endpoint(1));
    REQUIRE(refused.has_value());
    CHECK(refused->code == protocol::RefusalCode::not_allowed);
    brokers.wait_for(1, "refused BrokerHello: the key of worker lacks the role broker");
    CHECK(!claim_to_be_broker(context_of("stranger"), brokers.endpoint(1)));
    brokers.wait_for(1, "nobody knows it");
    CHECK(!claim_to_be_broker(net::Context(), brokers.endpoint(1)));
    brokers.wait_for(1, " ended before a key was shown");
    Process other = start_program(
        "fraja-broker", {"--bind", "tcp://127.0.0.1:0", "--publish", "tcp://127.0.0.1:0", "--state",
                         "none", "--peer", brokers.endpoint(1), "--key-file", ring.file("eve"),
                         "--broker-key", ring.key("eve"), "--allow", ring.allow_file()});
    REQUIRE(other.wait_for_words(Process::Stream::err,
                                 "broker " + brokers.endpoint(1) + " does not let this one in",
                                 patience));
    const auto shown = run({{program("fraja-ctl"), "-b", brokers.endpoint(2), "--key-file",
                             ring.file("ada"), "--json", "brokers"}},
                           patience);
    REQUIRE(shown.has_value());
    CHECK(shown->exit == 0);
    INFO(shown->out);
    CHECK(std::ranges::count(shown->out, '\n') == 3);

    const Scratch scratch;
    const std::string want = local_picture(scratch, long_picture());
    Process client =
        start_program("fraja-submit", with(long_picture(), {"-b", brokers.endpoint(0), "--key-file",
                                                            ring.file("ada"), "--verify", "0.2",
                                                            "-o", scratch.file("farm.png")}));
    brokers.wait_for(0, " pixels queued");
    for (std::size_t dead = 0; dead < 2; ++dead) {
        brokers.kill(dead);
        brokers.wait_for(dead + 1, "this broker leads");
    }
    INFO(brokers.at(2).err());
    INFO(client.err());
    CHECK(client.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("farm.png")) == want));
}

TEST_CASE("a broker that has keys and is told of another one's is told how it is meant") {
    const Ring ring;
    ring.allow({{"worker", "worker"}});
    const auto ran =
        run({{program("fraja-broker"), "--state", "none", "--bind", "tcp://127.0.0.1:0",
              "--publish", "tcp://127.0.0.1:0", "--peer", "tcp://127.0.0.1:1", "--key-file",
              ring.file("farm"), "--broker-key", ring.key("eve"), "--allow", ring.allow_file()}},
            patience);
    REQUIRE(ran.has_value());
    CHECK(ran->exit != 0);
    CHECK(contains(ran->err, "have one key, that of --key-file; here --broker-key names another"));
}
