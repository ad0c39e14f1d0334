// Programs of other versions: of the one before, which is served and serves, by the bytes that its
// broker has said; and of those that do not fit, which are told so.
#include "common/net/sockets.hpp"
#include "tests/captures/capture.hpp"
#include "tests/e2e/farm.hpp"

#include <csignal>

using namespace fraja;
using namespace fraja::e2e;

namespace {

protocol::Packet packet_of(const std::vector<Blob>& frames) {
    return {Bytes(frames[0].begin(), frames[0].end()),
            Bytes(frames[1].begin(), frames[1].end()),
            {frames.begin() + 2, frames.end()}};
}

/// A broker of the version before, as far as it is kept what it said to one that called.
class OldBroker {
public:
    explicit OldBroker(const std::string& name)
        : capture_(read_capture(captures / last_version / "old_broker" / (name + ".txt"))),
          part_(capture_, Part::Of::called),
          router_(*net::RouterSocket::bind(context_, "tcp://127.0.0.1:0")) {}

    [[nodiscard]] const std::string& endpoint() const { return router_.endpoint(); }
    [[nodiscard]] const Capture& capture() const { return capture_; }

    /// Until it has said all, and has heard that.
    template <class M>
    M serve_until() {
        const auto end = std::chrono::steady_clock::now() + patience;
        for (;;) {
            REQUIRE(std::chrono::steady_clock::now() < end);
            net::wait({router_}, 100ms);
            while (const auto received = router_.receive()) {
                versions.push_back(*protocol::version_of(received->frames));
                const auto message = protocol::decode(received->frames);
                REQUIRE(message.has_value());
                part_.hear(*message);
                while (const Captured* words = part_.next()) {
                    part_.said(words);
                    (void)router_.send(received->peer, packet_of(words->unpacked()));
                }
                if (part_.is_over() && std::holds_alternative<M>(*message))
                    return std::get<M>(*message);
            }
        }
    }

    std::vector<protocol::Version> versions; ///< in which it was spoken to

private:
    const net::Context context_;
    const Capture capture_;
    Part part_;
    net::RouterSocket router_;
};

void check_that_it_came_down(const OldBroker& broker) {
    REQUIRE(broker.versions.size() > 1);
    CHECK(broker.versions.front() == protocol::version);
    CHECK(broker.versions.back() == protocol::oldest_version_spoken);
}

} // namespace

TEST_CASE("fraja-worker draws for a broker of the version before, and the same pixels") {
    OldBroker broker("worker");
    auto worker = Process::start(
        {{program("fraja-worker"), "-b", broker.endpoint(), "-j", "1", "--name", "ada"}});
    REQUIRE(worker.has_value());
    const auto answer = broker.serve_until<protocol::TileRendered>();
    const auto then = all_of<protocol::TileRendered>(broker.capture()).at(0);
    REQUIRE(answer.blobs.size() == then.blobs.size());
    for (std::size_t i = 0; i < then.blobs.size(); ++i)
        CHECK(answer.blobs[i] == then.blobs[i]);
    CHECK(answer.tile == then.tile);
    CHECK(answer.rays.camera == then.rays.camera);
    worker->send(SIGTERM);
    (void)broker.serve_until<protocol::Goodbye>();
    CHECK(worker->wait_for_exit(patience) == 0);
    check_that_it_came_down(broker);
    CHECK(contains(worker->err(), ", by protocol version " + last_version));
    CHECK_FALSE(contains(worker->err(), "refused"));
}

TEST_CASE("fraja-ctl asks a broker of the version before") {
    OldBroker broker("show");
    auto ctl = Process::start({{program("fraja-ctl"), "-b", broker.endpoint(), "show", "solid"}});
    REQUIRE(ctl.has_value());
    (void)broker.serve_until<protocol::Goodbye>();
    CHECK(ctl->wait_for_exit(patience) == 0);
    check_that_it_came_down(broker);
    CHECK(contains(ctl->out(), "#1 solid"));
    CHECK(contains(ctl->out(), "done"));
    CHECK(ctl->err().empty());
}

TEST_CASE("who speaks a version that does not fit is told both, and the broker logs it once") {
    Farm farm;
    const net::Context context;
    auto peer = net::DealerSocket::connect(context, farm.endpoint());
    REQUIRE(peer.has_value());
    protocol::Packet hello = protocol::encode(protocol::ClientHello{"old", "0"});
    hello.header[4] = std::byte{10};
    const std::string both = "the peer speaks protocol version 10, this program versions " +
                             last_version + " and " + std::to_string(protocol::version) +
                             ": the peer is too old, and must be updated";
    for (int i = 0; i < 3; ++i) {
        while (peer->send(hello) != net::SendStatus::sent)
            net::wait({*peer}, 10ms);
        std::optional<net::Frames> frames;
        while (!(frames = peer->receive()))
            net::wait({*peer}, 100ms);
        CHECK(protocol::version_of(*frames) == protocol::version);
        const auto answer = protocol::decode(*frames);
        REQUIRE(answer.has_value());
        REQUIRE(std::holds_alternative<protocol::Refused>(*answer));
        CHECK(std::get<protocol::Refused>(*answer).code == protocol::RefusalCode::version_mismatch);
        CHECK(std::get<protocol::Refused>(*answer).reason == both);
    }
    REQUIRE(farm.broker().wait_for_words(Process::Stream::err, both, patience).has_value());
    const auto said = farm.broker().err(); // of all three, as the last has been answered
    const auto first = said.find(both);
    CHECK(said.find(both, first + 1) == std::string::npos);
}

TEST_CASE("programs leave a broker of a version that does not fit with exit 4, and say both") {
    const net::Context context;
    auto broker = net::RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(broker.has_value());
    protocol::Packet refusal = protocol::encode(
        protocol::Refused{protocol::RefusalCode::version_mismatch, {}, "not understood here"});
    struct Row {
        unsigned version;
        const char* cure;
    };
    for (const auto& [version, cure] : {Row{10, "the peer is too old, and must be updated"},
                                        Row{13, "this program is too old, and must be updated"}})
        for (const Words& words : {Words{"fraja-ctl", "jobs"}, Words{"fraja-worker"}}) {
            CAPTURE(version);
            CAPTURE(words[0]);
            refusal.header[4] = static_cast<std::byte>(version);
            auto process = Process::start({with({program(words[0]), "-b", broker->endpoint()},
                                                {words.begin() + 1, words.end()})});
            REQUIRE(process.has_value());
            const auto end = std::chrono::steady_clock::now() + patience;
            while (!process->wait_for_exit(0s) && std::chrono::steady_clock::now() < end) {
                net::wait({*broker}, 10ms);
                while (const auto hello = broker->receive())
                    (void)broker->send(hello->peer, refusal);
            }
            CHECK(process->wait_for_exit(patience) == 4);
            INFO(process->story());
            const std::string both = "the peer speaks protocol version " + std::to_string(version) +
                                     ", this program versions " + last_version + " and " +
                                     std::to_string(protocol::version) + ": " + cure;
            CHECK(contains(process->err(), both));
        }
}
