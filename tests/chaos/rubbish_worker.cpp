#include "tests/chaos/rubbish_worker.hpp"

#include "common/base/rng.hpp"
#include "common/protocol/codec.hpp"
#include "tests/chaos/peer.hpp"

#include <vector>

namespace fraja::chaos {
namespace {

using namespace std::chrono_literals;
using namespace protocol;

constexpr Duration heartbeat = 100ms, patience = 200ms;

/// Never as many as pixels have: these are floats.
Bytes some_bytes(Rng& rng) {
    Bytes bytes(4 * rng.below(5'000) + 1 + rng.below(3));
    for (auto& byte : bytes)
        byte = static_cast<std::byte>(rng.next());
    return bytes;
}

TileRendered answer_to(const RenderTile& order, Rng& rng) {
    return {.job = order.job,
            .tile = order.tile,
            .attempt = order.attempt,
            .rays = {.camera = rng.next() >> rng.below(64)},
            .elapsed = Duration(static_cast<Duration::rep>(rng.next() >> rng.below(64))),
            .blobs = {Blob(some_bytes(rng))}};
}

Packet no_message(Rng& rng) {
    Packet packet = encode(Beat{});
    packet.body = some_bytes(rng);
    if (rng.below(2) == 0)
        packet.header = some_bytes(rng);
    return packet;
}

/// One session's side of things.
class Session {
public:
    Session(const net::Context& context, const std::string& endpoint, Rng& rng)
        : peer_(context, endpoint), rng_(rng) {}

    bool begin(const std::string& name) {
        peer_.say(hello_of(name, 4), patience);
        return peer_.hear_only<Welcome>(patience).has_value();
    }
    void beat() {
        peer_.say(WorkerBeat{.credit = 4, .in_flight = held_, .tiles_received = received_},
                  patience);
    }
    [[nodiscard]] std::optional<Message> hear() { return peer_.hear(heartbeat); }
    /// False: the session is over.
    bool answer(const RenderTile& order, Misdeed misdeed);

private:
    Peer peer_;
    Rng& rng_;
    std::vector<TileInFlight> held_;
    std::uint64_t received_ = 0;
};

bool Session::answer(const RenderTile& order, Misdeed misdeed) {
    ++received_;
    TileRendered rendered = answer_to(order, rng_);
    switch (misdeed) {
    case Misdeed::wrong_size:
        return peer_.say(rendered, patience);
    case Misdeed::wrong_tile:
        rendered.tile = TileIndex(static_cast<std::uint32_t>(rng_.next() >> rng_.below(64)));
        return peer_.say(rendered, patience);
    case Misdeed::wrong_job:
        rendered.job = random_id<JobId>();
        return peer_.say(rendered, patience);
    case Misdeed::failure:
    case Misdeed::cancellation:
        return peer_.say(
            TileFailed{order.job, order.tile, order.attempt,
                       misdeed == Misdeed::failure ? FailureCode::machine : FailureCode::cancelled,
                       "so it is said"},
            patience);
    case Misdeed::no_message:
        return peer_.say(no_message(rng_), patience);
    case Misdeed::twice:
        return peer_.say(rendered, patience) && peer_.say(rendered, patience);
    case Misdeed::silence:
        held_.push_back({order.job, order.tile, order.attempt, 0});
        return true;
    case Misdeed::denial:
        return true;
    case Misdeed::flight:
        return false;
    }
    return false;
}

} // namespace

RubbishWorker::RubbishWorker(std::string endpoint, std::uint64_t seed)
    : thread_([this, endpoint = std::move(endpoint), seed](const std::stop_token& stop) {
          run(stop, endpoint, seed);
      }) {}

void RubbishWorker::run(const std::stop_token& stop, const std::string& endpoint,
                        std::uint64_t seed) {
    const net::Context context;
    Rng rng(seed);
    while (!stop.stop_requested()) {
        Session session(context, endpoint, rng);
        if (!session.begin("rubbish-" + std::to_string(sessions_ + 1)))
            continue; // no broker, for the moment
        ++sessions_;
        const Instant end = net::now() + std::chrono::milliseconds(500 + rng.below(3'000));
        Instant next_beat = net::now();
        bool going = true;
        while (going && !stop.stop_requested() && net::now() < end) {
            if (net::now() >= next_beat) {
                session.beat();
                next_beat = net::now() + heartbeat;
            }
            const auto message = session.hear();
            if (!message)
                continue;
            if (const auto* order = std::get_if<RenderTile>(&*message)) {
                const auto misdeed = static_cast<Misdeed>(rng.below(misdeed_count));
                ++counts_[static_cast<std::size_t>(misdeed)];
                going = session.answer(*order, misdeed);
            }
            if (const auto* refused = std::get_if<Refused>(&*message))
                going = refused->code != RefusalCode::unknown_peer;
        }
    }
}

} // namespace fraja::chaos
