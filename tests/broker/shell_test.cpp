#include "broker/shell.hpp"

#include "common/protocol/codec.hpp"
#include "common/protocol/topics.hpp"
#include "tests/broker/store_support.hpp"

#include <doctest/doctest.h>
#include <future>
#include <thread>

using namespace fraja;
using namespace fraja::broker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

namespace {

/// A broker in a thread, on ports that the system chose.
class RunningBroker {
public:
    explicit RunningBroker(const std::filesystem::path& state = {}) {
        options_.state = state;
        options_.bind = "tcp://127.0.0.1:0";
        options_.publish = "tcp://127.0.0.1:0";
        options_.on_listening = [this](const std::string& bound, const std::string& published) {
            listening_.set_value({bound, published});
        };
        thread_ =
            std::jthread([this] { CHECK(run_broker(context, options_, control_).has_value()); });
        std::tie(endpoint, stream) = listening_.get_future().get();
    }
    ~RunningBroker() { control_.stop(); }

    net::Context context;
    std::string endpoint, stream;

private:
    Options options_;
    std::promise<std::pair<std::string, std::string>> listening_;
    Control control_;
    std::jthread thread_; // joined first
};

template <class S>
auto receive_within(S& socket, Duration patience) {
    auto received = socket.receive();
    for (Duration waited{}; !received && waited < patience; waited += 100ms) {
        net::wait({socket}, 100ms);
        received = socket.receive();
    }
    return received;
}

template <class M>
M expect(net::DealerSocket& socket) {
    const auto frames = receive_within(socket, 10s);
    REQUIRE(frames.has_value());
    const auto message = decode(*frames);
    REQUIRE(message.has_value());
    REQUIRE(std::holds_alternative<M>(*message));
    return std::get<M>(*message);
}

void say(net::DealerSocket& socket, const Message& message) {
    while (socket.send(encode(message)) != net::SendStatus::sent) // until the connection stands
        net::wait({socket}, 10ms);
}

} // namespace

TEST_CASE("the shell carries messages between sockets and the dispatcher") {
    RunningBroker broker;
    auto client = net::DealerSocket::connect(broker.context, broker.endpoint);
    REQUIRE(client.has_value());
    say(*client, ClientHello{"test", "0"});
    CHECK(expect<Welcome>(*client).stream == broker.stream);
    say(*client, Beat{});
    expect<Beat>(*client);
}

TEST_CASE("a nonce that is subscribed comes back as a barrier") {
    RunningBroker broker;
    auto subscriber = net::SubscriberSocket::connect(broker.context, broker.stream);
    REQUIRE(subscriber.has_value());
    const auto nonce = random_id<Nonce>();
    subscriber->subscribe(barrier_topic(nonce));
    const auto published = receive_within(*subscriber, 10s);
    REQUIRE(published.has_value());
    CHECK(published->topic == barrier_topic(nonce));
    const auto message = decode(published->frames);
    REQUIRE(message.has_value());
    CHECK(std::get<Barrier>(*message).nonce == nonce);
}

TEST_CASE("bytes that are no message are answered and harm nobody") {
    RunningBroker broker;
    auto client = net::DealerSocket::connect(broker.context, broker.endpoint);
    REQUIRE(client.has_value());
    say(*client, ClientHello{"test", "0"});
    expect<Welcome>(*client);
    for (const char* noise : {"", "x", "FRJA", "FRJA\1\0\5\0"})
        CHECK(client->send(Packet{to_bytes(noise), to_bytes("\xdd\xff\xff\xff\xff"), {}}) ==
              net::SendStatus::sent);
    Packet other_version = encode(Beat{});
    other_version.header[4] = std::byte(version + 1);
    CHECK(client->send(other_version) == net::SendStatus::sent);
    for (int i = 0; i < 4; ++i)
        CHECK(expect<Refused>(*client).code == RefusalCode::malformed);
    CHECK(expect<Refused>(*client).code == RefusalCode::version_mismatch);
    say(*client, Beat{});
    expect<Beat>(*client);
}

TEST_CASE("a peer of the version before is answered in that, and all hear the stream in it") {
    RunningBroker broker;
    auto client = net::DealerSocket::connect(broker.context, broker.endpoint);
    REQUIRE(client.has_value());
    const auto answered_in = [&](const Packet& said) {
        while (client->send(said) != net::SendStatus::sent)
            net::wait({*client}, 10ms);
        const auto frames = receive_within(*client, 10s);
        REQUIRE(frames.has_value());
        return version_of(*frames);
    };
    const ClientHello hello{"test", "0"};
    CHECK(answered_in(encode(hello, oldest_version_spoken)) == oldest_version_spoken);
    CHECK(answered_in(encode(Beat{}, oldest_version_spoken)) == oldest_version_spoken);
    Packet malformed = encode(Beat{}, oldest_version_spoken);
    malformed.body = to_bytes("\xdd\xff\xff\xff\xff");
    CHECK(answered_in(malformed) == oldest_version_spoken);
    CHECK(answered_in(encode(hello)) == version);
    for (const int other : {oldest_version_spoken - 1, version + 1}) {
        Packet foreign = encode(hello);
        foreign.header[4] = static_cast<std::byte>(other);
        CHECK(answered_in(foreign) == version);
    }
    auto subscriber = net::SubscriberSocket::connect(broker.context, broker.stream);
    REQUIRE(subscriber.has_value());
    for (const std::string& topic : {barrier_topic(random_id<Nonce>()), std::string(farm_topic)}) {
        subscriber->subscribe(topic);
        const auto published = receive_within(*subscriber, 10s);
        REQUIRE(published.has_value());
        CHECK(version_of(published->frames) == oldest_version_spoken);
        CHECK(decode(published->frames).has_value());
    }
}

TEST_CASE("a tile that lay in the store is sent in the version of who asks for it") {
    const TempDirectory directory;
    SubmitJob job;
    job.job = random_id<JobId>();
    job.scene_bytes = 1;
    job.settings.size = {8, 8};
    job.settings.crop = {0, 0, 8, 8};
    job.tile_side = 8;
    {
        Store store = open_store(directory.path());
        commit(store, {PutJob{job, 1, 1},
                       PutTile{std::make_shared<TileDone>(
                           TileDone{.job = job.job,
                                    .rect = {0, 0, 8, 8},
                                    .worker_name = "ada",
                                    .rays = {},
                                    .blobs = {Blob(Bytes(64 * job.settings.pixel_bytes()))}})},
                       PutPhase{job.job, JobPhase::done, "", 1s}});
    }
    RunningBroker broker(directory.path());
    auto client = net::DealerSocket::connect(broker.context, broker.endpoint);
    REQUIRE(client.has_value());
    for (const Version spoken : {oldest_version_spoken, version}) {
        for (const Message& message :
             {Message(ClientHello{"test", "0"}), Message(Repair{job.job, 1, Bytes(1)})}) {
            while (client->send(encode(message, spoken)) != net::SendStatus::sent)
                net::wait({*client}, 10ms);
        }
        bool tile_came = false;
        for (bool over = false; !over;) {
            const auto frames = receive_within(*client, 10s);
            REQUIRE(frames.has_value());
            CHECK(version_of(*frames) == spoken);
            const auto message = decode(*frames);
            REQUIRE(message.has_value());
            tile_came = tile_came || std::holds_alternative<TileDone>(*message);
            over = std::holds_alternative<RepairDone>(*message);
        }
        CHECK(tile_came);
    }
}

TEST_CASE("a broker without keys refuses to serve other machines") {
    const net::Context context;
    const Control control;
    for (const char* endpoint :
         {"tcp://*:0", "tcp://0.0.0.0:0", "tcp://192.0.2.1:0", "pgm://x", "nonsense://"}) {
        CAPTURE(endpoint);
        Options options;
        options.bind = endpoint;
        const auto ran = run_broker(context, options, control);
        REQUIRE_FALSE(ran.has_value());
        CHECK(ran.error().code == ErrorCode::invalid_argument);
    }
}

TEST_CASE("a port that is taken is said to be") {
    RunningBroker broker;
    Options options;
    options.bind = broker.endpoint;
    const Control control;
    const auto ran = run_broker(broker.context, options, control);
    REQUIRE_FALSE(ran.has_value());
    CHECK(ran.error().code == ErrorCode::in_use);
    CHECK(ran.error().message.find(broker.endpoint) != std::string::npos);
}

TEST_CASE("a store with a job that nobody can have submitted is said to be damaged") {
    SubmitJob job;
    job.job = random_id<JobId>();
    job.scene_bytes = 1;
    job.settings.size = {8, 8};
    job.settings.crop = {0, 0, 8, 8};
    SubmitJob strange = job;
    strange.settings.crop.width = 9;
    struct Row {
        SubmitJob job;
        std::uint32_t passes;
        bool is_well;
    };
    for (const Row& row :
         {Row{job, 1, true}, Row{job, 0, false}, Row{job, 2, false}, Row{strange, 1, false}}) {
        const TempDirectory directory;
        {
            Store store = open_store(directory.path());
            commit(store, {PutJob{row.job, 1, row.passes}});
        }
        Options options;
        options.bind = options.publish = "tcp://127.0.0.1:0";
        options.state = directory.path();
        Control control;
        control.stop();
        const net::Context context;
        const auto bytes = [&] {
            const std::string log = directory.file().string() + "-wal";
            return bytes_of(directory.file()) + (std::filesystem::exists(log) ? bytes_of(log) : "");
        };
        const std::string before = bytes();
        const auto ran = run_broker(context, options, control);
        CHECK(ran.has_value() == row.is_well);
        CHECK((bytes() == before) == !row.is_well); // but for its epoch
        if (!row.is_well)
            CHECK(ran.error().message.find("is damaged (job " + to_string(job.job)) !=
                  std::string::npos);
    }
}
