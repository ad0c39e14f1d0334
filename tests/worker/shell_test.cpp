// The shell with real sockets, against a broker that the test plays.
#include "worker/shell.hpp"

#include "common/net/clock.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "tests/support/scene_text.hpp"

#include <algorithm>
#include <chrono>
#include <doctest/doctest.h>
#include <future>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

using namespace fraja;
using namespace fraja::worker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

namespace {

/// The broker's socket, and the last worker that spoke.
class FakeBroker {
public:
    FakeBroker(const net::Context& context, const std::string& endpoint)
        : socket_(std::move(*net::RouterSocket::bind(context, endpoint))) {}

    [[nodiscard]] std::string endpoint() const { return socket_.endpoint(); }
    void call(const std::string& worker) { REQUIRE(socket_.call(worker).has_value()); }
    /// Whether a worker has spoken so far.
    bool heard_anything() { return socket_.receive().has_value(); }

    /// The next M. Beats that come before are answered, and a chunk that was asked for already is
    /// on its way (a slow machine asks again); anything else fails the test.
    template <class M>
    M expect() {
        const Instant end = net::now() + 60s;
        while (net::now() < end) {
            auto message = receive();
            if (!message)
                continue;
            if (auto* m = std::get_if<M>(&*message)) {
                if constexpr (std::is_same_v<M, NeedChunk>)
                    asked_.push_back(*m);
                return std::move(*m);
            }
            const auto* again = std::get_if<NeedChunk>(&*message);
            if (again && std::ranges::find(asked_, *again) != asked_.end())
                continue;
            CAPTURE(name_of(*message));
            REQUIRE(std::holds_alternative<WorkerBeat>(*message));
            send(Beat{});
        }
        FAIL("nothing came within a minute: " << M::name);
        return {};
    }
    void send(const Message& message) {
        REQUIRE(socket_.send(peer_, encode(message)) == net::SendStatus::sent);
    }
    void send(const Packet& packet) {
        REQUIRE(socket_.send(peer_, packet) == net::SendStatus::sent);
    }

private:
    std::optional<Message> receive() {
        auto routed = socket_.receive();
        if (!routed) {
            net::wait({socket_}, 100ms);
            return std::nullopt;
        }
        peer_ = routed->peer;
        auto message = decode(routed->frames);
        REQUIRE_MESSAGE(message.has_value(), message.error().message);
        return std::move(*message);
    }

    net::RouterSocket socket_;
    net::PeerId peer_;
    std::vector<NeedChunk> asked_;
};

/// A worker in a thread, as --local hosts one.
class HostedWorker {
public:
    HostedWorker(const net::Context& context, std::vector<std::string> brokers,
                 std::vector<EmulatedWorkers> emulated = {})
        : options_{.brokers = std::move(brokers),
                   .threads = 2,
                   .name = "hosted",
                   .tags = {},
                   .emulated = std::move(emulated),
                   .on_log = {}},
          thread_([&] { outcome_ = run_worker(context, options_, control); }) {}
    ~HostedWorker() { control.stop_now(); }

    FinishReason join() {
        thread_.join();
        REQUIRE(outcome_->has_value());
        return **outcome_;
    }
    Control control;

private:
    WorkerOptions options_;
    std::optional<Result<FinishReason>> outcome_;
    std::jthread thread_; // last: joined first
};

/// One that listens, in a thread.
class ListeningWorker {
public:
    explicit ListeningWorker(const net::Context& context,
                             std::vector<EmulatedWorkers> emulated = {}) {
        options_.listen = "tcp://127.0.0.1:0";
        options_.threads = 2;
        options_.name = "listening";
        options_.emulated = std::move(emulated);
        std::promise<std::vector<std::string>> listening;
        options_.on_listening = [&](const std::vector<std::string>& where) {
            listening.set_value(where);
        };
        thread_ = std::jthread([&] { outcome_ = run_worker(context, options_, control); });
        endpoints = listening.get_future().get();
    }
    ~ListeningWorker() { control.stop_now(); }

    FinishReason join() {
        thread_.join();
        REQUIRE(outcome_->has_value());
        return **outcome_;
    }
    Control control;
    std::vector<std::string> endpoints;

private:
    WorkerOptions options_;
    std::optional<Result<FinishReason>> outcome_;
    std::jthread thread_; // last: joined first
};

Welcome quick_welcome() {
    return {.broker = {},
            .epoch = 1,
            .heartbeat = 50ms,
            .liveness = 100,
            .stream = "",
            .program_version = "0",
            .incarnation = 1};
}

RenderTile order(const Bytes& scene, std::uint32_t tile) {
    return {.job = JobId{},
            .tile = TileIndex{tile},
            .attempt = AttemptNumber{tile + 1},
            .frame = 0,
            .rect = {64 * tile, 0, 64, 48},
            .scene = content_hash(scene),
            .scene_bytes = scene.size(),
            .settings = {}};
}

} // namespace

TEST_CASE("a worker fetches a scene, renders its tiles and says goodbye") {
    for (const std::string bound : {"inproc://broker", "tcp://127.0.0.1:*"}) {
        CAPTURE(bound);
        const net::Context context;
        FakeBroker broker(context, bound);
        HostedWorker worker(context, {broker.endpoint()});
        const auto hello = broker.expect<WorkerHello>();
        CHECK(hello.worker_name == "hosted");
        CHECK(hello.credit == 4);
        broker.send(quick_welcome());

        const Bytes scene = scene_text("cone.raj");
        broker.send(order(scene, 0));
        broker.send(order(scene, 1));
        const auto need = broker.expect<NeedChunk>();
        CHECK(need == NeedChunk{content_hash(scene), 0});
        broker.send(Chunk{need.blob, 0, scene.size(), {Blob(scene)}});
        for (int i = 0; i < 2; ++i) {
            const auto tile = broker.expect<TileRendered>();
            REQUIRE(tile.blobs.size() == 1);
            CHECK(tile.blobs[0].size() == 64 * 48 * 3 * 4);
            CHECK(tile.rays.camera > 0);
        }
        CHECK(broker.expect<WorkerBeat>().in_flight.empty());
        broker.send(Beat{});
        worker.control.drain();
        for (bool leaving = false; !leaving;) {
            leaving = broker.expect<WorkerBeat>().credit == 0;
            broker.send(Beat{});
        }
        (void)broker.expect<Goodbye>();
        CHECK(worker.join() == FinishReason::drained);
    }
}

TEST_CASE("a worker that is told to stop hands its tile back") {
    const net::Context context;
    FakeBroker broker(context, "inproc://broker");
    HostedWorker worker(context, {"inproc://broker"});
    (void)broker.expect<WorkerHello>();
    broker.send(quick_welcome());
    const Bytes scene = scene_text("tumbler.raj");
    RenderTile endless = order(scene, 0);
    endless.settings.aa = 256;
    broker.send(endless);
    (void)broker.expect<NeedChunk>();
    broker.send(Chunk{content_hash(scene), 0, scene.size(), {Blob(scene)}});
    for (std::uint64_t rays = 0; rays == 0;) { // until it is under way
        const auto beat = broker.expect<WorkerBeat>();
        broker.send(Beat{});
        REQUIRE(beat.in_flight.size() == 1);
        rays = beat.in_flight[0].rays;
    }
    worker.control.stop_now();
    CHECK(broker.expect<TileFailed>().code == FailureCode::cancelled);
    (void)broker.expect<Goodbye>();
    CHECK(worker.join() == FinishReason::stopped);
}

TEST_CASE("a worker survives rubbish and greets a broker that has forgotten it") {
    const net::Context context;
    FakeBroker broker(context, "inproc://broker");
    HostedWorker worker(context, {"inproc://broker"});
    (void)broker.expect<WorkerHello>();
    broker.send(quick_welcome());
    broker.send(Packet{to_bytes("FRJA"), to_bytes("?"), {}});
    broker.send(Packet{{}, {}, {}});
    broker.send(Refused{RefusalCode::unknown_peer, {}, "who are you?"});
    CHECK(broker.expect<WorkerHello>().incarnation == 2);
}

TEST_CASE("a worker serves two brokers with the same threads, and leaves both") {
    const net::Context context;
    FakeBroker a(context, "inproc://a"), b(context, "inproc://b");
    HostedWorker worker(context, {"inproc://a", "inproc://b"});
    const Bytes scene = scene_text("cone.raj");
    for (FakeBroker* broker : {&a, &b}) {
        (void)broker->expect<WorkerHello>();
        broker->send(quick_welcome());
        broker->send(order(scene, 0));
        (void)broker->expect<NeedChunk>();
        broker->send(Chunk{content_hash(scene), 0, scene.size(), {Blob(scene)}});
    }
    const auto from_a = a.expect<TileRendered>(), from_b = b.expect<TileRendered>();
    CHECK(from_a.blobs.at(0) == from_b.blobs.at(0));
}

TEST_CASE("a worker whose broker comes late finds it") {
    const net::Context context;
    std::string endpoint;
    {
        const FakeBroker probe(context, "tcp://127.0.0.1:*"); // a port that is free
        endpoint = probe.endpoint();
    }
    HostedWorker worker(context, {endpoint});
    std::this_thread::sleep_for(50ms);
    FakeBroker broker(context, endpoint);
    (void)broker.expect<WorkerHello>();
}

TEST_CASE("a worker of another version gives up") {
    const net::Context context;
    FakeBroker broker(context, "inproc://broker");
    HostedWorker worker(context, {"inproc://broker"});
    (void)broker.expect<WorkerHello>();
    Packet foreign = encode(Refused{RefusalCode::version_mismatch, {}, "no"});
    foreign.header[4] = std::byte{99};
    broker.send(foreign);
    CHECK(worker.join() == FinishReason::version_mismatch);
}

TEST_CASE("emulated workers are sessions of their own over one socket thread") {
    const net::Context context;
    FakeBroker broker(context, "tcp://127.0.0.1:*");
    HostedWorker worker(context, {broker.endpoint()}, {{2, 1e6}, {1, 2e6}});
    const Bytes scene = scene_text("cone.raj");
    std::set<std::string> names;
    std::set<WorkerId> ids;
    for (int i = 0; i < 3; ++i) {
        const auto hello = broker.expect<WorkerHello>();
        names.insert(hello.worker_name);
        ids.insert(hello.worker);
        CHECK(hello.threads == 2);
        CHECK(hello.tags == std::vector<std::string>{"emulated"});
    }
    CHECK(names == std::set<std::string>{"hosted/1", "hosted/2", "hosted/3"});
    CHECK(ids.size() == 3);
    worker.control.drain();
    CHECK(worker.join() == FinishReason::drained);
}

TEST_CASE("a worker that listens serves one caller after the other") {
    const net::Context context;
    ListeningWorker worker(context);
    REQUIRE(worker.endpoints.size() == 1);
    const Bytes scene = scene_text("cone.raj");
    FakeBroker patient(context, "tcp://127.0.0.1:*");
    for (int i = 0; i < 3; ++i) {
        CAPTURE(i);
        FakeBroker caller(context, "tcp://127.0.0.1:*");
        caller.call(worker.endpoints[0]);
        const auto hello = caller.expect<WorkerHello>();
        CHECK(hello.worker_name == "listening");
        Welcome welcome = quick_welcome();
        welcome.incarnation = hello.incarnation;
        caller.send(welcome);
        caller.send(order(scene, 0));
        if (i == 0) { // it is kept for those who call later
            const auto need = caller.expect<NeedChunk>();
            caller.send(Chunk{need.blob, 0, scene.size(), {Blob(scene)}});
        }
        CHECK(caller.expect<TileRendered>().blobs.size() == 1);
        if (i < 2)
            caller.send(order(scene, 1)); // and leaves without waiting for it
        else {
            patient.call(worker.endpoints[0]);
            for (int beats = 0; beats < 5; ++beats) { // the turn stays where it is
                (void)caller.expect<WorkerBeat>();
                caller.send(Beat{});
            }
            CHECK_FALSE(patient.heard_anything());
        }
    }
    (void)patient.expect<WorkerHello>();
    worker.control.drain();
    CHECK(worker.join() == FinishReason::drained);
}

TEST_CASE("a worker that listens outlives callers of another version and those who dismiss it") {
    const net::Context context;
    ListeningWorker worker(context);
    FakeBroker foreigner(context, "inproc://foreigner");
    foreigner.call(worker.endpoints[0]);
    (void)foreigner.expect<WorkerHello>();
    Packet foreign = encode(Refused{RefusalCode::version_mismatch, {}, "no"});
    foreign.header[4] = std::byte{99};
    foreigner.send(foreign);
    FakeBroker rude(context, "inproc://rude"), caller(context, "inproc://caller");
    rude.call(worker.endpoints[0]);
    (void)rude.expect<WorkerHello>();
    rude.send(Dismissed{"go away"});
    caller.call(worker.endpoints[0]);
    (void)caller.expect<WorkerHello>();
}

TEST_CASE("emulated workers that listen have an endpoint each, and a caller each") {
    const net::Context context;
    ListeningWorker worker(context, {{3, 1e6}});
    REQUIRE(worker.endpoints.size() == 3);
    FakeBroker both(context, "inproc://both"), last(context, "inproc://last");
    both.call(worker.endpoints[0]);
    both.call(worker.endpoints[1]);
    last.call(worker.endpoints[2]);
    std::set<std::string> names;
    for (int i = 0; i < 2; ++i)
        names.insert(both.expect<WorkerHello>().worker_name);
    CHECK(names == std::set<std::string>{"listening/1", "listening/2"});
    CHECK(last.expect<WorkerHello>().worker_name == "listening/3");
}

TEST_CASE("a worker that cannot listen says where, and why") {
    const net::Context context;
    const ListeningWorker worker(context);
    WorkerOptions options;
    options.name = "second";
    options.listen = worker.endpoints[0];
    Control control;
    const auto outcome = run_worker(context, options, control);
    REQUIRE_FALSE(outcome.has_value());
    CHECK(outcome.error().code == ErrorCode::in_use);
    CHECK(outcome.error().message.find(worker.endpoints[0]) != std::string::npos);
}

TEST_CASE("options that make no sense are refused before anything starts") {
    const net::Context context;
    Control control;
    const auto outcome = run_worker(context, {}, control);
    REQUIRE_FALSE(outcome.has_value());
    CHECK(outcome.error().code == ErrorCode::invalid_argument);
}
