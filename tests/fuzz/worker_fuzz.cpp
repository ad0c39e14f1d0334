// The worker's core, whatever brokers say and render threads come back with: a stream of events for
// worker::Session, and after each of them what the broker and the threads may rely on.
#include "common/base/assert.hpp"
#include "common/protocol/codec.hpp"
#include "tests/fuzz/arbitrary.hpp"
#include "worker/session.hpp"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <tuple>
#include <utility>

using namespace fraja;
using namespace fraja::fuzz;
using namespace fraja::protocol;

namespace {

constexpr std::size_t events_max = 400;
constexpr std::uint32_t threads = 2;
constexpr std::uint32_t attempts_remembered = 1u << 20; // by the session

worker::Limits small_limits() {
    worker::Limits limits;
    limits.chunk_asks_max = 2;
    limits.shelf = {.idle_bytes_max = 1'000, .idle_count_max = 1};
    return limits;
}

/// What names a tile at a worker.
using TileKey = std::tuple<JobId, decltype(RenderTile::tile), decltype(RenderTile::attempt)>;

template <class M>
TileKey key_of(const M& m) {
    return {m.job, m.tile, m.attempt};
}

class World {
public:
    explicit World(Input& in)
        : in_(in), session_({id_of<WorkerId>(1), "fuzz", threads, {}}, small_limits()) {}

    void run() {
        step(worker::Tick{});
        if (!in_.once_in(4))
            hear(fitting_welcome());
        for (std::size_t i = 0; i < events_max && !in_.empty(); ++i)
            one_event();
    }

private:
    void one_event() {
        switch (in_.below(18)) {
        case 0:
            now_ = now_ + time_step(in_);
            return tick();
        case 1:
            return tick_when_due();
        case 2:
        case 3:
            return hear(welcome());
        case 4:
        case 5:
        case 6:
            return hear(order());
        case 7:
        case 8:
            return give_chunk();
        case 9:
            return compiled();
        case 10:
        case 11:
            return finish_tile();
        case 12:
            return break_tile();
        case 13:
            return cancel();
        case 14:
            return hear(in_.below(2) ? Message(Beat{}) : Message(message_of<Refused>(in_)));
        case 15:
            return leave_or_stumble();
        default:
            return hear(any_message(in_));
        }
    }

    void hear(Message message) {
        if (const auto* order = std::get_if<RenderTile>(&message))
            note_order(*order);
        if (const auto* welcome = std::get_if<Welcome>(&message))
            note_welcome(*welcome);
        const Version said_in = fuzz::version_of(message);
        if (const auto* refused = std::get_if<Refused>(&message))
            connected_ = connected_ && refused->code != RefusalCode::unknown_peer &&
                         (said_in == version || said_in == spoken_);
        step(worker::Received{std::move(message), said_in});
    }

    /// It is owed an answer, unless it has come before.
    void note_order(const RenderTile& order) {
        const auto attempt = static_cast<std::uint32_t>(order.attempt);
        if (last_attempt_ && *last_attempt_ - attempt < attempts_remembered)
            return;
        last_attempt_ = attempt;
        if (connected_)
            unanswered_.insert(key_of(order));
    }

    /// The session begins, with no tiles, if it answers the last hello.
    void note_welcome(const Welcome& welcome) {
        if (std::exchange(broker_, welcome.broker) != welcome.broker)
            last_attempt_.reset();
        connected_ = connected_ || welcome.incarnation == incarnation_;
    }

    [[nodiscard]] Welcome fitting_welcome() const {
        Welcome welcome;
        welcome.incarnation = incarnation_;
        welcome.heartbeat = std::chrono::milliseconds(500);
        welcome.liveness = 3;
        return welcome;
    }

    Welcome welcome() {
        if (in_.once_in(8))
            return message_of<Welcome>(in_);
        return fitting_welcome();
    }

    /// One that can be rendered, mostly.
    RenderTile order() {
        if (in_.once_in(8))
            return message_of<RenderTile>(in_);
        RenderTile order;
        fill(in_, order.job);
        fill(in_, order.tile);
        fill(in_, order.attempt);
        const KnownScene& scene = any_scene(in_);
        order.scene = scene.hash;
        order.scene_bytes = scene.text.size();
        order.settings = small_picture(in_);
        order.rect = order.settings.crop;
        return order;
    }

    void give_chunk() {
        if (needed_.empty())
            return;
        auto chunk = chunk_for(needed_.front()).value_or(Chunk{});
        needed_.erase(needed_.begin());
        if (chunk.blobs.empty() || in_.once_in(8)) {
            const Chunk known = chunk;
            chunk = message_of<Chunk>(in_);
            if (in_.below(2))
                copy_common(chunk, known);
        }
        hear(chunk);
    }

    void compiled() {
        ContentHash scene = any_scene(in_).hash;
        if (!compiling_.empty()) {
            scene = compiling_.front();
            compiling_.erase(compiling_.begin());
        }
        if (in_.once_in(3))
            step(worker::SceneFailed{scene, error()});
        else
            step(worker::SceneCompiled{scene});
    }

    Error error() {
        std::string text;
        fill(in_, text);
        return {static_cast<ErrorCode>(in_.below(static_cast<unsigned>(ErrorCode::refused) + 1)),
                text};
    }

    /// One that runs, or any at all: what was stopped may still end.
    worker::Ticket ticket() {
        if (running_.empty() || in_.once_in(8))
            return worker::Ticket{in_.below(20)};
        const auto at = in_.below(static_cast<std::uint32_t>(running_.size()));
        return *std::next(running_.begin(), at);
    }

    void finish_tile() {
        worker::TileFinished finished;
        finished.ticket = ticket();
        fill(in_, finished.rays);
        finished.elapsed = time_step(in_);
        finished.blobs = pixels(12, in_);
        running_.erase(finished.ticket);
        step(finished);
    }

    void break_tile() {
        const worker::Ticket broken = ticket();
        running_.erase(broken);
        step(worker::TileBroken{broken, error()});
    }

    void cancel() {
        auto cancel = message_of<CancelTile>(in_);
        if (!unanswered_.empty()) {
            const auto at = in_.below(static_cast<std::uint32_t>(unanswered_.size()));
            std::tie(cancel.job, cancel.tile, cancel.attempt) = *std::next(unanswered_.begin(), at);
        }
        hear(cancel);
    }

    void leave_or_stumble() {
        switch (in_.below(8)) {
        case 7:
            return step(worker::Drain{});
        case 6:
            return step(worker::StopNow{});
        default:
            return step(worker::Undecodable{error()});
        }
    }

    void tick() {
        worker::Tick tick;
        for (const worker::Ticket running : running_)
            tick.progress.push_back({running, in_.any_number()});
        step(tick);
    }

    /// A Tick when it is due moves the deadline on: or the shell would never wait.
    void tick_when_due() {
        const Instant due = session_.next_deadline();
        if (due == Instant::never())
            return;
        now_ = std::max(now_, due);
        tick();
        FRAJA_ASSERT(session_.next_deadline() > now_);
    }

    void step(const worker::Event& event) {
        std::vector<worker::Action> actions;
        session_.step(now_, event, actions);
        FRAJA_ASSERT(!over_ || actions.empty());
        for (const auto& action : actions)
            std::visit([this](const auto& a) { check(a); }, action);
        FRAJA_ASSERT(running_.size() <= credit_);
        FRAJA_ASSERT(over_ == (session_.next_deadline() == Instant::never()));
    }

    void check(const worker::Log&) {}

    void check(const worker::Send& send) {
        FRAJA_ASSERT(!over_);
        (void)encode(send.message, send.version); // it can be sent
        if (const auto* hello = std::get_if<WorkerHello>(&send.message)) {
            spoken_ = send.version;
            FRAJA_ASSERT(hello->incarnation > incarnation_);
            incarnation_ = hello->incarnation;
            connected_ = false;
            unanswered_.clear();
            needed_.clear();
        } else if (const auto* need = std::get_if<NeedChunk>(&send.message)) {
            needed_.push_back(*need);
        } else if (const auto* rendered = std::get_if<TileRendered>(&send.message)) {
            FRAJA_ASSERT(unanswered_.erase(key_of(*rendered)) == 1);
        } else if (const auto* failed = std::get_if<TileFailed>(&send.message)) {
            FRAJA_ASSERT(unanswered_.erase(key_of(*failed)) == 1);
        } else if (const auto* beat = std::get_if<WorkerBeat>(&send.message)) {
            FRAJA_ASSERT(beat->in_flight.size() <= credit_);
            for (const TileInFlight& tile : beat->in_flight)
                FRAJA_ASSERT(unanswered_.contains(key_of(tile)));
        } else if (std::holds_alternative<Goodbye>(send.message)) {
            said_goodbye_ = true;
        }
    }

    void check(const worker::CompileScene& compile) {
        FRAJA_ASSERT(!compile.chunks.empty());
        compiling_.push_back(compile.scene);
    }

    void check(const worker::StartTile& start) {
        FRAJA_ASSERT(!started_.contains(start.ticket)); // never used twice
        FRAJA_ASSERT(validate(start.settings) && !start.rect.empty());
        FRAJA_ASSERT(start.rect.inside(start.settings.crop));
        started_.insert(start.ticket);
        running_.insert(start.ticket);
    }

    void check(const worker::StopTile& stop) { FRAJA_ASSERT(running_.erase(stop.ticket) == 1); }

    void check(const worker::ForgetScene&) {}
    void check(const worker::HangUp&) {}

    void check(const worker::Finished& finished) {
        over_ = true;
        FRAJA_ASSERT(running_.empty());
        FRAJA_ASSERT(!said_goodbye_ || finished.reason != worker::FinishReason::version_mismatch);
        FRAJA_ASSERT(!said_goodbye_ || unanswered_.empty());
    }

    const std::uint32_t credit_ = worker::credit_for(threads, small_limits());
    Input& in_;
    worker::Session session_;
    Instant now_{};
    std::uint64_t incarnation_ = 0;
    Version spoken_ = version;
    bool connected_ = false;
    BrokerId broker_;
    std::optional<std::uint32_t> last_attempt_; ///< of its orders
    std::set<TileKey> unanswered_;              ///< of the session's tiles
    std::vector<NeedChunk> needed_;
    std::vector<ContentHash> compiling_;
    std::set<worker::Ticket> started_, running_;
    bool said_goodbye_ = false, over_ = false;
};

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    Input in(data, size);
    World(in).run();
    return 0;
}
