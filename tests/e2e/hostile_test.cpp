// Peers that speak rubbish: refused, counted, logged, and nobody else notices.
#include "common/base/rng.hpp"
#include "common/net/sockets.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/packing.hpp"
#include "common/protocol/topics.hpp"
#include "tests/e2e/farm.hpp"
#include "tests/support/messages.hpp"

#include <arpa/inet.h>
#include <fstream>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

using namespace fraja;
using namespace fraja::e2e;

namespace {

/// A plain TCP connection that says `bytes` and leaves.
void shout(const std::string& endpoint, const std::string& bytes) {
    const int port = std::stoi(endpoint.substr(endpoint.rfind(':') + 1));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int fd = socket(AF_INET, SOCK_STREAM, 0);
    REQUIRE(fd >= 0);
    if (connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0)
        [[maybe_unused]]
        const auto sent = send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    close(fd);
}

void say(net::DealerSocket& socket, const protocol::Packet& packet) {
    while (socket.send(packet) != net::SendStatus::sent) // until the connection stands
        net::wait({socket}, 10ms);
}

} // namespace

TEST_CASE("rubbish from strangers harms neither the broker nor its jobs") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one");
    const Words picture = {scene("overlapping_spheres"),
                           "--kernel", // long enough to be disturbed
                           "reference",
                           "-r",
                           instrumented ? "40x30" : "160x120",
                           "--tile",
                           "4"};
    const std::string want = local_picture(scratch, picture);
    Words words = picture;
    words.insert(words.end(), {"-o", scratch.file("x.png")});
    Process client = farm.start_submit(words);

    const double before = resident_mib(farm.broker().pid());
    Rng rng(7);
    const int rounds = instrumented ? 100 : 500;
    for (int i = 0; i < rounds; ++i) { // bytes that are not even ZeroMQ
        std::string noise(rng.below(200), 0);
        for (char& c : noise)
            c = static_cast<char>(rng.next());
        shout(farm.endpoint(), noise);
    }
    const net::Context context;
    for (int peer = 0; peer < 5; ++peer) { // frames that are not messages
        auto socket = net::DealerSocket::connect(context, farm.endpoint());
        REQUIRE(socket.has_value());
        for (int i = 0; i < rounds; ++i) {
            protocol::Packet packet = protocol::encode(random_message(rng));
            if (rng.below(2) == 0)
                packet.body = Bytes(rng.below(2000), static_cast<std::byte>(rng.next()));
            if (rng.below(4) == 0)
                packet.header = Bytes(rng.below(12), static_cast<std::byte>(rng.next()));
            if (rng.below(50) == 0) // more frames than a message may have
                packet.blobs.assign(500, Blob(Bytes(1000)));
            say(*socket, packet);
        }
        while (socket->receive()) {
        }
    }
    CHECK(client.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("x.png")) == want));
    CHECK(farm.submit({scene("cone"), "-r", "20x15", "-o", scratch.file("c.png")}).exit == 0);
    if (!instrumented) // sanitizers keep freed memory
        CHECK(resident_mib(farm.broker().pid()) - before < 100);
}

TEST_CASE("a message beyond the limit ends its connection and nothing else") {
    Farm farm;
    farm.add_worker("one");
    const net::Context context;
    auto socket = net::DealerSocket::connect(context, farm.endpoint());
    REQUIRE(socket.has_value());
    // The answer to `message`, which is said again for as long as it may have been lost.
    const auto ask = [&](const protocol::Message& message) {
        std::optional<net::Frames> frames;
        while (!frames) {
            say(*socket, protocol::encode(message));
            net::wait({*socket}, 100ms);
            frames = socket->receive();
        }
        const auto answer = protocol::decode(*frames);
        REQUIRE(answer.has_value());
        return *answer;
    };
    CHECK(std::holds_alternative<protocol::Welcome>(ask(protocol::ClientHello{"test", "0"})));
    protocol::Packet packet = protocol::encode(protocol::Beat{});
    packet.blobs.assign(1, Blob(Bytes(protocol::packed_bytes_max)));
    say(*socket, packet);
    // ZeroMQ connects again, and the broker sees a stranger.
    protocol::Message answer;
    do
        answer = ask(protocol::Beat{});
    while (!std::holds_alternative<protocol::Refused>(answer));
    CHECK(std::get<protocol::Refused>(answer).code == protocol::RefusalCode::unknown_peer);
    const Scratch scratch;
    CHECK(farm.submit({scene("cone"), "-r", "20x15", "-o", scratch.file("c.png")}).exit == 0);
}

TEST_CASE("who subscribes to ever more topics is cut off, and fills no memory") {
    Farm farm;
    farm.add_worker("one");
    const double before = resident_mib(farm.broker().pid());
    const net::Context context;
    {
        auto socket = net::SubscriberSocket::connect(context, farm.stream());
        REQUIRE(socket.has_value());
        const auto is_cut_off = [&farm] {
            return farm.broker().wait_for_words(Process::Stream::err, "cut off", 1ms).has_value();
        };
        const auto give_up = std::chrono::steady_clock::now() + patience;
        for (int topic = 0; !is_cut_off();) {
            REQUIRE(std::chrono::steady_clock::now() < give_up);
            for (const int end = topic + 1'000; topic < end; ++topic)
                socket->subscribe(std::to_string(topic) + std::string(100, '.'));
            (void)socket->receive();
        }
    }
    if (!instrumented) // as it is in libzmq: some 40 bytes for each of 20,000 times 100
        CHECK(resident_mib(farm.broker().pid()) - before < 150);
    const Scratch scratch;
    CHECK(farm.submit({scene("cone"), "-r", "20x15", "-o", scratch.file("c.png")}).exit == 0);
}

TEST_CASE("a peer of another version is refused with exit 4") {
    const net::Context context;
    auto broker = net::RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(broker.has_value());
    const Scratch scratch;
    for (const char* name : {"fraja-submit", "fraja-worker", "fraja-watch"}) {
        CAPTURE(name);
        Words argv{program(name), "-b", broker->endpoint()};
        if (std::string_view(name) == "fraja-submit")
            argv.insert(argv.end(), {scene("cone"), "-o", scratch.file("x.png")});
        if (std::string_view(name) == "fraja-watch")
            argv.push_back("job");
        auto process = Process::start({argv});
        REQUIRE(process.has_value());
        std::optional<net::RoutedMessage> hello;
        while (!(hello = broker->receive()))
            net::wait({*broker}, 1s);
        broker->send(hello->peer,
                     protocol::encode(protocol::Refused{
                         protocol::RefusalCode::version_mismatch, {}, "version 9 is spoken here"}));
        CHECK(process->wait_for_exit(patience) == 4);
        CHECK(process->err().find("version") != std::string::npos);
        while (broker->receive()) {
        }
    }
}
