// Brokers that are found without an address: by announcements and by the DNS, between machines that
// are namespaces.
#include "common/discovery/beacon.hpp"
#include "common/discovery/beacon_sockets.hpp"
#include "tests/e2e/ring.hpp"
#include "tests/support/dns_server.hpp"
#include "tests/support/network_or_skip.hpp"

#include <atomic>
#include <csignal>
#include <doctest/doctest.h>
#include <fstream>
#include <memory>
#include <optional>
#include <poll.h>
#include <string>
#include <thread>
#include <vector>

using namespace fraja;
using namespace fraja::e2e;

namespace {

using Stream = Process::Stream;

Process start_on(const TestNetwork& network, std::size_t host, Words words) {
    words.front() = program(words.front());
    auto process = Process::start(network.on(host, {std::move(words)}));
    REQUIRE(process.has_value());
    return std::move(*process);
}

RunResult run_on(const TestNetwork& network, std::size_t host, Words words) {
    words.front() = program(words.front());
    auto result = run(network.on(host, {std::move(words)}), patience);
    REQUIRE(result.has_value());
    return std::move(*result);
}

/// On a port that the system chose, for all of the network.
struct Broker {
    Broker(const TestNetwork& network, std::size_t host, const Words& options)
        : process(start_on(network, host,
                           with({"fraja-broker", "--bind", "tcp://*:0", "--publish", "tcp://*:0",
                                 "--state", "none", "--heartbeat", heartbeat_option},
                                options))) {
        const auto line = process.wait_for_words(Stream::out, "listening ", patience);
        INFO(process.story());
        REQUIRE(line.has_value());
        const std::size_t end = line->find(" stream ");
        port = line->substr(line->rfind(':', end) + 1, end - line->rfind(':', end) - 1);
        endpoint = "tcp://" + TestNetwork::address(host) + ":" + port;
    }
    void wait_for(const std::string& words) {
        const auto line = process.wait_for_words(Stream::err, words, patience);
        INFO(process.story());
        REQUIRE(line.has_value());
    }
    void kill() {
        process.send(SIGKILL);
        (void)process.wait_for_exit(patience);
    }
    Process process;
    std::string port, endpoint;
};

const Words small_picture = {scene("cone"), "-r", "64x48"};

/// What a socket of that host hears next.
class Ear {
public:
    Ear(const TestNetwork& network, std::size_t host) {
        network.visit(host, [this] {
            auto opened = discovery::BeaconReceiver::open();
            REQUIRE(opened);
            receiver_.emplace(*std::move(opened));
        });
    }
    [[nodiscard]] Bytes next() const {
        for (;;) {
            if (const auto datagram = receiver_->receive())
                return datagram->bytes;
            pollfd readable[] = {{receiver_->fd(), POLLIN, 0}, {receiver_->fd6(), POLLIN, 0}};
            REQUIRE(::poll(readable, 2, 60'000) > 0);
        }
    }

private:
    std::optional<discovery::BeaconReceiver> receiver_;
};

void send_beacon(const TestNetwork& network, std::size_t host, std::span<const std::byte> bytes) {
    network.visit(host, [&] {
        const auto sender = discovery::BeaconSender::open({.multicast = false});
        REQUIRE(sender);
        CHECK(sender->send(bytes) == 1);
    });
}

/// Beacons of whoever likes, as often as a broker's, and more of them.
class Shouting {
public:
    Shouting(const TestNetwork& network, std::size_t host, std::vector<Bytes> what)
        : thread_([&network, host, what = std::move(what)](const std::stop_token& stop) {
              while (!stop.stop_requested()) {
                  for (const Bytes& bytes : what)
                      send_beacon(network, host, bytes);
                  std::this_thread::sleep_for(100ms); // as a sender, not as a test that waits
              }
          }) {}

private:
    std::jthread thread_;
};

Bytes as_bytes(const discovery::Beacon& beacon) {
    const auto bytes = discovery::encode_beacon(beacon);
    return Bytes(bytes.begin(), bytes.end());
}

/// Behind a resolver's settings that are the process's own.
Words resolving(const std::string& resolv_conf, Words words) {
    words.front() = program(words.front());
    return with({"unshare", "--mount", "sh", "-c",
                 "mount --bind \"$0\" /etc/resolv.conf && exec \"$@\"", resolv_conf},
                words);
}

} // namespace

TEST_CASE("worker and client find a broker of another machine, by broadcast and by multicast") {
    const auto network = network_or_skip(3);
    if (!network)
        return;
    const Scratch scratch;
    const std::string local = local_picture(scratch, small_picture);
    for (const std::string way : {"broadcast", "multicast"}) {
        CAPTURE(way);
        Broker broker(*network, 0, {"--insecure", "--announce=" + way});
        const Process worker =
            start_on(*network, 1, {"fraja-worker", "-b", "auto", "-j", "1", "--name", "finder"});
        broker.wait_for("worker finder is here");
        const std::string file = scratch.file(way + ".png");
        const auto drawn = run_on(
            *network, 2, with(with({"fraja-submit", "-b", "auto"}, small_picture), {"-o", file}));
        INFO(drawn.err);
        REQUIRE(drawn.exit == 0);
        CHECK(bytes_of(file) == local);
        CHECK(contains(drawn.err, "found the broker at tcp://"));
        CHECK(contains(drawn.err, " by its announcement; without keys nothing proves whose it is"));
        CHECK(contains(worker.err(), "without keys any broker that announces itself"));
    }
}

TEST_CASE("the other programs find brokers, too") {
    const auto network = network_or_skip(2);
    if (!network)
        return;
    Broker broker(*network, 0, {"--insecure", "--announce=broadcast"});
    const auto ask = [&](Words words) {
        words.insert(words.begin() + 1, {"-b", "auto"});
        const auto result = run_on(*network, 1, std::move(words));
        INFO(result.err);
        CHECK(result.exit == 0);
        return result.out;
    };
    CHECK(contains(ask({"fraja-ctl", "stats"}), "workers           0 with 0 threads"));
    CHECK(contains(ask({"fraja-watch", "--once"}), broker.endpoint));
    CHECK(contains(ask({"fraja-ctl", "brokers"}), broker.endpoint));
    CHECK(contains(ask({"fraja-ctl", "doctor"}), "names " + broker.endpoint));
}

TEST_CASE("with keys nobody but the own farm's broker is used, whoever announces himself") {
    const auto network = network_or_skip(3);
    if (!network)
        return;
    const Ring ring;
    ring.allow({{"worker", "worker"}, {"ada", "submit"}});
    const Words with_keys = with({"--announce"}, ring.farm_options());
    // A stranger's broker lets in everybody whom it knows, and says that it is of this farm as
    // well.
    Broker strangers(
        *network, 2,
        {"--announce", "--key-file", ring.file("stranger"), "--allow", ring.allow_file()});
    Broker keyless(*network, 2, {"--announce", "--insecure"});
    const auto farm = discovery::fingerprint_of({ring.key("farm")});
    const auto port = static_cast<std::uint16_t>(std::stoi(strangers.port));
    const Shouting shouting(
        *network, 2,
        {as_bytes({.port = port, .farm = farm}),
         as_bytes({.port = static_cast<std::uint16_t>(std::stoi(keyless.port)), .farm = farm}),
         to_bytes("rubbish"), Bytes(1400)});
    Process worker = start_on(*network, 1,
                              {"fraja-worker", "-b", "auto", "--key-file", ring.file("worker"),
                               "-j", "1", "--name", "finder"});
    const Scratch scratch;
    Process submit = start_on(*network, 1,
                              with(with({"fraja-submit", "-b", "auto", "--key-file",
                                         ring.file("ada"), "--connect-timeout", "1h"},
                                        small_picture),
                                   {"-o", scratch.file("a.png")}));
    // Both have met the impostors when the true one comes.
    strangers.wait_for("connections ended before a key was shown");
    for (const char* words : {"breaks off every handshake", "it has no keys, and we do"}) {
        const auto said = worker.wait_for_words(Stream::err, words, patience);
        INFO(worker.story());
        REQUIRE(said.has_value());
    }
    Broker own(*network, 0, with_keys);
    own.wait_for("worker finder is here");
    const auto exit = submit.wait_for_exit(patience);
    INFO(submit.story());
    CHECK(exit == 0);
    CHECK_FALSE(contains(submit.err(), "without keys nothing proves"));
    for (const Broker* other : {&strangers, &keyless}) {
        INFO(other->process.story());
        CHECK_FALSE(contains(other->process.err(), "is here"));
    }
}

TEST_CASE("nothing is sent by who is not told to, and clients send nothing at all") {
    const auto network = network_or_skip(2);
    if (!network)
        return;
    const Ear ear(*network, 1);
    const Scratch scratch;
    Broker broker(*network, 0, {"--insecure"});
    const Process worker =
        start_on(*network, 0, {"fraja-worker", "-b", broker.endpoint, "-j", "1", "--name", "w"});
    const Process listener = start_on(*network, 0, {"fraja-worker", "-b", "auto", "-j", "1"});
    broker.wait_for("worker w is here");
    const auto drawn = run_on(*network, 0,
                              with(with({"fraja-submit", "-b", broker.endpoint}, small_picture),
                                   {"-o", scratch.file("a.png")}));
    CHECK(drawn.exit == 0);
    const auto unfound =
        run_on(*network, 0, {"fraja-ctl", "-b", "auto", "--connect-timeout", "1500ms", "jobs"});
    INFO(unfound.err);
    CHECK(unfound.exit == 3);
    CHECK(contains(unfound.err,
                   "no broker was found by auto: none announces itself on this network "
                   "(fraja-broker --announce)"));
    send_beacon(*network, 0, to_bytes("the end"));
    CHECK(ear.next() == to_bytes("the end"));
}

TEST_CASE("a worker looks for another broker when the one that it found is gone") {
    const auto network = network_or_skip(3);
    if (!network)
        return;
    Broker first(*network, 0, {"--insecure", "--announce=broadcast"});
    Process worker =
        start_on(*network, 1, {"fraja-worker", "-b", "auto", "-j", "1", "--name", "finder"});
    first.wait_for("worker finder is here");
    first.kill();
    Broker second(*network, 2, {"--insecure", "--announce=broadcast"});
    second.wait_for("worker finder is here");
    const auto let_go = worker.wait_for_words(
        Stream::err, first.endpoint + ": served no more: it is not found any more", patience);
    INFO(worker.story());
    CHECK(let_go.has_value());
    worker.send(SIGTERM);
    CHECK(worker.wait_for_exit(patience) == 0);
}

TEST_CASE("a worker that has found nobody leaves when it is told to") {
    const auto network = network_or_skip(1);
    if (!network)
        return;
    for (const int signal : {SIGTERM, SIGINT}) {
        Process worker = start_on(*network, 0, {"fraja-worker", "-b", "auto", "-j", "1"});
        REQUIRE(worker.wait_for_words(Stream::err, "any broker that announces itself", patience));
        worker.send(signal);
        CHECK(worker.wait_for_exit(patience) == 0);
    }
}

TEST_CASE("brokers are those that the DNS names, and it is asked again when they are gone") {
    const auto network = network_or_skip(2);
    if (!network)
        return;
    std::unique_ptr<DnsServer> dns;
    network->visit(1, [&] { dns = std::make_unique<DnsServer>(53); });
    const Scratch scratch;
    const std::string settings = scratch.file("resolv.conf");
    std::ofstream(settings) << "nameserver 127.0.0.1\noptions timeout:1 attempts:1\n";
    const auto name_broker = [&](const Broker& broker) {
        dns->set("_fraja._tcp.farm.test",
                 {.records = {{20, 0, static_cast<std::uint16_t>(std::stoi(broker.port)),
                               TestNetwork::address(0)}}});
    };
    auto started =
        Process::start(network->on(1, {resolving(settings, {"fraja-worker", "-b", "srv:farm.test",
                                                            "-j", "1", "--name", "asker"})}));
    REQUIRE(started);
    Process worker = *std::move(started);
    const auto said = worker.wait_for_words(Stream::err, "the DNS knows no such name", patience);
    INFO(worker.story());
    REQUIRE(said.has_value());
    auto first = std::make_unique<Broker>(*network, 0, Words{"--insecure"});
    name_broker(*first);
    first->wait_for("worker asker is here");
    first->kill();
    Broker second(*network, 0, {"--insecure"});
    name_broker(second);
    second.wait_for("worker asker is here");

    const std::string file = scratch.file("a.png");
    const auto drawn = run(
        network->on(1, {resolving(settings,
                                  with(with({"fraja-submit", "-b", "srv:farm.test"}, small_picture),
                                       {"-o", file}))}),
        patience);
    REQUIRE(drawn);
    INFO(drawn->err);
    CHECK(drawn->exit == 0);
    CHECK(bytes_of(file) == local_picture(scratch, small_picture));
    const auto unknown =
        run(network->on(1, {resolving(settings, {"fraja-ctl", "-b", "srv:nobody.test",
                                                 "--connect-timeout", "2s", "jobs"})}),
            patience);
    REQUIRE(unknown);
    CHECK(unknown->exit == 3);
    CHECK(contains(unknown->err,
                   "no broker was found by srv:_fraja._tcp.nobody.test: the DNS knows "
                   "no such name"));
}
