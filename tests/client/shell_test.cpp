// The shell over real sockets, against a broker of few words on ports the system picks.
#include "client/shell.hpp"

#include "common/net/clock.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/topics.hpp"

#include <atomic>
#include <csignal>
#include <doctest/doctest.h>
#include <filesystem>
#include <map>
#include <sys/resource.h>
#include <thread>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

/// Takes one job of four tiles. The first two are published before the barrier, so that they must
/// be repaired; the third on the stream; of the fourth only the digest tells, so it is repaired.
class FourTileBroker {
public:
    FourTileBroker(const net::Context& context, const std::string& bind, const std::string& publish)
        : router_(*net::RouterSocket::bind(context, bind)),
          publisher_(*net::PublisherSocket::bind(context, publish, 1'000)),
          endpoint_(router_.endpoint()),
          thread_([this](const std::stop_token& stop) { run(stop); }) {}

    [[nodiscard]] const std::string& endpoint() const { return endpoint_; }
    [[nodiscard]] bool was_left() const { return left_; }

private:
    void run(const std::stop_token& stop) {
        while (!stop.stop_requested()) {
            net::wait({router_, publisher_}, 10ms);
            while (const auto change = publisher_.receive())
                if (const auto nonce = protocol::topic_id<Nonce>('N', change->topic);
                    nonce && change->subscribed)
                    publish(change->topic, protocol::Barrier{*nonce, 1});
            while (const auto in = router_.receive())
                if (const auto message = protocol::decode(in->frames))
                    answer(in->peer, *message);
        }
    }

    void answer(const net::PeerId& peer, const protocol::Message& message) {
        using namespace protocol;
        if (std::holds_alternative<ClientHello>(message)) {
            send(peer, Welcome{BrokerId{{1}}, 1, 1s, 3, publisher_.endpoint(), "test"});
        } else if (const auto* submit = std::get_if<SubmitJob>(&message)) {
            state_.job = submit->job;
            state_.number = 1;
            state_.job_name = submit->job_name;
            state_.scene = submit->scene;
            state_.settings = submit->settings;
            state_.phase = JobPhase::waiting_for_scene;
            state_.cell_side = 1;
            state_.cell_count = 4;
            send(peer, state_);
            send(peer, NeedChunk{submit->scene, 0});
        } else if (const auto* chunk = std::get_if<Chunk>(&message)) {
            CHECK(content_hash(chunk->blobs.at(0)) == state_.scene);
            state_.phase = JobPhase::running;
            state_.done_count = 2;
            send(peer, state_);
        } else if (const auto* repair = std::get_if<Repair>(&message)) {
            const Bitmap have(repair->have);
            for (std::uint32_t i = 0; i < state_.done_count; ++i)
                if (!have.test(i))
                    send(peer, tile(i));
            send(peer, RepairDone{state_, 0});
            if (state_.done_count == 2) {
                publish(job_topic(state_.job), tile(2));
                state_.done_count = 4;
                state_.phase = JobPhase::done;
                publish(job_topic(state_.job), state_);
            }
        } else if (std::holds_alternative<Goodbye>(message)) {
            left_ = true;
        } else {
            send(peer, Beat{});
        }
    }

    [[nodiscard]] protocol::TileDone tile(std::uint32_t i) const {
        protocol::TileDone done;
        done.job = state_.job;
        done.tile = TileIndex{i};
        done.rect = {i, 0, 1, 1};
        done.worker_name = "ada";
        done.blobs = {Blob(Bytes(12, static_cast<std::byte>(i)))};
        return done;
    }
    void send(const net::PeerId& peer, const protocol::Message& message) {
        (void)router_.send(peer, protocol::encode(message));
    }
    void publish(const std::string& topic, const protocol::Message& message) {
        publisher_.publish(topic, protocol::encode(message));
    }

    net::RouterSocket router_;
    net::PublisherSocket publisher_;
    std::string endpoint_;
    protocol::JobState state_;
    std::atomic<bool> left_ = false;
    std::jthread thread_; // last: it uses the others
};

class CountingListener : public Listener {
public:
    void hear(Instant, const News& news) override {
        if (const auto* tile = std::get_if<TileArrived>(&news)) {
            const auto index = static_cast<std::uint32_t>(tile->tile.tile);
            ++tiles[index];
            CHECK(tile->tile.blobs.at(0).data()[0] == static_cast<std::byte>(index));
        }
        if (std::holds_alternative<Accepted>(news))
            ++accepted;
    }
    std::map<std::uint32_t, int> tiles;
    int accepted = 0;
};

SubmissionRequest request_to(const std::string& broker) {
    const Bytes scene = to_bytes("a scene of sorts");
    SubmissionRequest request;
    request.job.job = random_id<JobId>();
    request.job.job_name = "cone";
    request.job.scene = protocol::content_hash(scene);
    request.job.scene_bytes = scene.size();
    request.job.settings.size = {4, 1};
    request.job.settings.crop = {0, 0, 4, 1};
    request.scene_text = Blob(scene);
    request.session = {{broker}, 10s, "test"};
    request.timeout = 60s;
    return request;
}

} // namespace

TEST_CASE("a submission runs over tcp, ipc and inproc alike, and takes its leave") {
    const std::string ipc = "ipc:///tmp/fraja-client-test-" + std::to_string(getpid());
    struct Row {
        std::string bind, publish;
    };
    for (const Row& row : {Row{"tcp://127.0.0.1:0", "tcp://127.0.0.1:0"},
                           Row{ipc + ".a", ipc + ".b"}, Row{"inproc://a", "inproc://b"}}) {
        CAPTURE(row.bind);
        const net::Context context;
        FourTileBroker broker(context, row.bind, row.publish);
        CountingListener listener;
        const Outcome outcome =
            run_submission(context, request_to(broker.endpoint()), listener, nullptr);
        CHECK(outcome == Outcome{});
        CHECK(listener.accepted == 1);
        CHECK(listener.tiles == std::map<std::uint32_t, int>{{0, 1}, {1, 1}, {2, 1}, {3, 1}});
        for (const Instant end = net::now() + 10s; !broker.was_left() && net::now() < end;)
            std::this_thread::sleep_for(5ms);
        CHECK(broker.was_left());
    }
    for (const char* end : {".a", ".b"}) // libzmq leaves them there
        std::filesystem::remove(ipc.substr(ipc.find('/') + 2) + end);
}

TEST_CASE("a broker for which no descriptor was left is connected to later") {
    struct Raised final : CountingListener {
        explicit Raised(const rlimit& to) : before(to) {}
        Instant tick(Instant now) override {
            if (++ticks == 2) // the first words had no socket
                setrlimit(RLIMIT_NOFILE, &before);
            return now + 10ms;
        }
        rlimit before;
        int ticks = 0;
    };
    const net::Context context;
    FourTileBroker broker(context, "tcp://127.0.0.1:0", "tcp://127.0.0.1:0");
    rlimit before{};
    REQUIRE(getrlimit(RLIMIT_NOFILE, &before) == 0);
    // All of it once while nothing lacks: to look at the first object of a type, the
    // undefined-behaviour sanitizer makes a pipe, and without one takes the object for rubbish.
    CHECK_FALSE(net::DealerSocket::connect(context, "nothing").has_value());
    {
        FourTileBroker other(context, "tcp://127.0.0.1:0", "tcp://127.0.0.1:0");
        Raised listener(before);
        CHECK(run_submission(context, request_to(other.endpoint()), listener, nullptr) ==
              Outcome{});
    }
    rlimit none = before;
    none.rlim_cur = 3; // those that are open stay so
    REQUIRE(setrlimit(RLIMIT_NOFILE, &none) == 0);
    CHECK_FALSE(net::DealerSocket::connect(context, broker.endpoint()).has_value());
    Raised listener(before);
    const Outcome outcome =
        run_submission(context, request_to(broker.endpoint()), listener, nullptr);
    setrlimit(RLIMIT_NOFILE, &before);
    CHECK(outcome == Outcome{});
    CHECK(listener.ticks >= 2);
    CHECK(listener.tiles.size() == 4);
}

TEST_CASE("where nobody listens the client gives up in time") {
    const net::Context context;
    // A port that was free a moment ago.
    const std::string nowhere = net::RouterSocket::bind(context, "tcp://127.0.0.1:0")->endpoint();
    auto request = request_to(nowhere);
    request.session.connect_timeout = 300ms;
    CountingListener listener;
    const Instant begin = net::now();
    const Outcome outcome = run_submission(context, std::move(request), listener, nullptr);
    CHECK(outcome.code == ExitCode::unreachable);
    CHECK(net::now() - begin >= 300ms);
    CHECK(net::now() - begin < 20s);
}

TEST_CASE("a signal ends the conversation") {
    const net::SignalWatch signals({SIGINT, SIGTERM});
    const net::Context context;
    for (const auto& [signal, want] :
         {std::pair{SIGINT, ExitCode::interrupted}, std::pair{SIGTERM, ExitCode::terminated}}) {
        CountingListener listener;
        pthread_kill(pthread_self(), signal); // it is blocked, so it waits to be read
        const Outcome outcome =
            run_submission(context, request_to("tcp://127.0.0.1:9"), listener, &signals);
        CHECK(outcome.code == want);
    }
}
