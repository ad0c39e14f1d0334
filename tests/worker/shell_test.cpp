// The shell with real sockets, against a broker that the test plays.
#include "worker/shell.hpp"

#include "common/net/clock.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "tests/support/scene_text.hpp"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <doctest/doctest.h>
#include <future>
#include <map>
#include <mutex>
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
    [[nodiscard]] const net::PeerId& last_peer() const { return peer_; }
    /// Whether a worker has spoken so far.
    bool heard_anything() { return socket_.receive().has_value(); }

    /// Answers hellos as that, each with its incarnation, until so many workers beat, for which an
    /// answer came in time (on a slow machine a worker greets again before); their names.
    std::set<std::string> greet(std::size_t workers, Welcome as) {
        std::set<std::string> names;
        std::set<net::PeerId> open;
        const Instant end = net::now() + 60s;
        while (net::now() < end && open.size() < workers) {
            const auto message = receive();
            if (!message)
                continue;
            if (const auto* hello = std::get_if<WorkerHello>(&*message)) {
                names.insert(hello->worker_name);
                open.erase(peer_);
                as.incarnation = hello->incarnation;
                send(as);
                continue;
            }
            CAPTURE(name_of(*message));
            REQUIRE(std::holds_alternative<WorkerBeat>(*message));
            open.insert(peer_);
            send(Beat{});
        }
        REQUIRE(open.size() == workers);
        return names;
    }
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
            (void)socket_.send(peer_, encode(Beat{})); // a worker may have left after its last one
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
                   .on_log = [this](const LogLine& line) { note(line); }},
          thread_([&] { outcome_ = run_worker(context, options_, control); }) {}
    ~HostedWorker() { control.stop_now(); }

    FinishReason join() {
        thread_.join();
        REQUIRE(outcome_->has_value());
        return **outcome_;
    }
    /// Waits until a line of its log has that in it, for a minute at most.
    void expect_line(const std::string& text) {
        std::unique_lock lock(mutex_);
        CAPTURE(text);
        REQUIRE(noted_.wait_for(lock, 60s, [&] {
            return std::ranges::any_of(
                lines_, [&](const std::string& l) { return l.find(text) != std::string::npos; });
        }));
    }
    Control control;

private:
    void note(const LogLine& line) {
        const std::lock_guard lock(mutex_);
        lines_.push_back(line.text);
        noted_.notify_all();
    }

    std::mutex mutex_; // guards:
    std::vector<std::string> lines_;
    std::condition_variable noted_;
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

/// Of the broker of that number, of several that stand for each other.
Welcome welcome_of(std::uint8_t number, const std::vector<Member>& all) {
    Welcome welcome = quick_welcome();
    welcome.broker.bytes[0] = number;
    welcome.brokers = all;
    return welcome;
}

Member member(std::uint8_t number, const std::string& endpoint) {
    Member member{{}, endpoint};
    member.broker.bytes[0] = number;
    return member;
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
        broker->greet(1, quick_welcome());
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
    while (names.size() < 3) {
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

TEST_CASE("brokers that stand for each other hear every answer, and one is enough") {
    const net::Context context;
    std::optional<FakeBroker> first(std::in_place, context, "tcp://127.0.0.1:*");
    FakeBroker second(context, "tcp://127.0.0.1:*");
    const std::vector all{member(1, first->endpoint()), member(2, second.endpoint())};
    HostedWorker worker(context, {first->endpoint()});
    const auto hello = first->expect<WorkerHello>();
    first->send(welcome_of(1, all));
    CHECK(second.expect<WorkerHello>().worker == hello.worker);
    second.send(welcome_of(2, all));
    second.send(Brokers{{1, all[0].broker}, all});
    CHECK(second.expect<WorkerBeat>().in_flight.empty());

    const Bytes scene = scene_text("cone.raj");
    RenderTile tile = order(scene, 0), endless = order(scene, 1);
    tile.term = endless.term = {1, all[0].broker};
    first->send(tile);
    const auto need = first->expect<NeedChunk>();
    first->send(Chunk{need.blob, 0, scene.size(), {Blob(scene)}});
    const auto told = first->expect<TileRendered>(), witnessed = second.expect<TileRendered>();
    CHECK(witnessed.rect == PixelRect{0, 0, 64, 48});
    CHECK(witnessed.blobs.at(0) == told.blobs.at(0));

    endless.settings.aa = 256;
    endless.rect = {0, 0, 256, 192};
    first->send(endless);
    for (std::uint64_t rays = 0; rays == 0;) { // until it is under way, and the second has heard so
        const auto beat = second.expect<WorkerBeat>();
        second.send(Beat{});
        if (!beat.in_flight.empty())
            rays = beat.in_flight[0].rays;
    }
    first.reset();
    second.send(Brokers{{2, all[1].broker}, all});
    for (Term heard; heard.counter < 2;) {
        const auto beat = second.expect<WorkerBeat>();
        heard = beat.term;
        REQUIRE(beat.in_flight.size() == 1);
        CHECK(beat.in_flight[0].tile == endless.tile);
        CHECK(beat.in_flight[0].rect == endless.rect);
    }
    second.send(CancelTile{endless.job, endless.tile, endless.attempt});
    CHECK(second.expect<TileFailed>().code == FailureCode::cancelled);
    worker.control.drain();
    (void)second.expect<Goodbye>();
    CHECK(worker.join() == FinishReason::drained);
}

TEST_CASE("a worker opens connections to brokers that it is told of, and closes them again") {
    const net::Context context;
    FakeBroker first(context, "tcp://127.0.0.1:*"), second(context, "tcp://127.0.0.1:*");
    HostedWorker worker(context, {first.endpoint()});
    (void)first.expect<WorkerHello>();
    first.send(welcome_of(1, {member(1, first.endpoint()), member(2, second.endpoint()),
                              member(3, "carrier-pigeon://roof"), member(4, "inproc://first")}));
    worker.expect_line(second.endpoint() + ": served as well: " + first.endpoint() +
                       " tells of it");
    worker.expect_line("carrier-pigeon://roof: cannot be served: ");
    worker.expect_line("inproc://first: cannot be served: ");
    (void)second.expect<WorkerHello>(); // and is not answered
    first.send(Brokers{{}, {member(1, first.endpoint())}});
    worker.expect_line(second.endpoint() + ": served no more: no broker tells of it any more");
    first.send(Brokers{{}, {member(1, first.endpoint()), member(2, second.endpoint())}});
    while (second.expect<WorkerHello>().incarnation < 2) {
    }
    worker.control.drain();
    (void)first.expect<Goodbye>();
    CHECK(worker.join() == FinishReason::drained);
}

TEST_CASE("two endpoints that lead to one broker are served by one session") {
    const net::Context context;
    FakeBroker broker(context, "tcp://127.0.0.1:*");
    const std::string alias =
        "tcp://127.0.0.1" + broker.endpoint().substr(broker.endpoint().rfind(':'));
    HostedWorker worker(context, {broker.endpoint(), alias});
    (void)broker.expect<WorkerHello>();
    broker.send(welcome_of(1, {}));
    (void)broker.expect<WorkerHello>();
    const net::PeerId newer = broker.last_peer();
    broker.send(welcome_of(1, {}));
    worker.expect_line(alias + ": served no more: it is the broker at " + broker.endpoint());
    (void)broker.expect<Goodbye>();
    if (broker.last_peer() == newer) { // for which a broker has forgotten the older one
        const auto again = broker.expect<WorkerHello>();
        CHECK(broker.last_peer() != newer);
        Welcome welcome = welcome_of(1, {});
        welcome.incarnation = again.incarnation;
        broker.send(welcome);
    }
    for (int beats = 0; beats < 3; ++beats) {
        (void)broker.expect<WorkerBeat>();
        broker.send(Beat{});
    }
    worker.control.drain();
    (void)broker.expect<Goodbye>();
    CHECK(worker.join() == FinishReason::drained);
}

TEST_CASE("every emulated worker serves all brokers that stand for each other, as itself") {
    const net::Context context;
    FakeBroker first(context, "tcp://127.0.0.1:*"), second(context, "tcp://127.0.0.1:*");
    const std::vector all{member(1, first.endpoint()), member(2, second.endpoint())};
    HostedWorker worker(context, {first.endpoint()}, {{2, 1e6}});
    std::map<std::string, WorkerId> at_first, at_second;
    while (at_first.size() < 2) {
        const auto hello = first.expect<WorkerHello>();
        at_first[hello.worker_name] = hello.worker;
        Welcome welcome = welcome_of(1, all);
        welcome.incarnation = hello.incarnation;
        first.send(welcome);
    }
    while (at_second.size() < 2) {
        const auto hello = second.expect<WorkerHello>();
        at_second[hello.worker_name] = hello.worker;
        second.send(welcome_of(2, all));
    }
    CHECK(at_first == at_second);
    worker.control.stop_now();
    CHECK(worker.join() == FinishReason::stopped);
}

TEST_CASE("every emulated worker serves all brokers that it is given, and draws for each") {
    const net::Context context;
    std::optional<FakeBroker> first(std::in_place, context, "tcp://127.0.0.1:*");
    FakeBroker second(context, "tcp://127.0.0.1:*"); // another farm's
    HostedWorker worker(context, {first->endpoint(), second.endpoint()}, {{2, 1e9}});
    const Bytes scene = scene_text("cone.raj");
    for (FakeBroker* broker : {&*first, &second}) {
        CHECK(broker->greet(2, quick_welcome()) == std::set<std::string>{"hosted/1", "hosted/2"});
        broker->send(order(scene, 0)); // to the one that came last
        const auto need = broker->expect<NeedChunk>();
        broker->send(Chunk{need.blob, 0, scene.size(), {Blob(scene)}});
        CHECK(broker->expect<TileRendered>().blobs.size() == 1);
    }
    first.reset();
    second.send(order(scene, 1)); // goes on without it
    CHECK(second.expect<TileRendered>().blobs.size() == 1);
    worker.control.stop_now();
    CHECK(worker.join() == FinishReason::stopped);
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
    while (names.size() < 2)
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
