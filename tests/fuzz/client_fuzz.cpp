// The client's cores, whatever brokers say: a stream of events for a submission, a watcher of a job
// or of the farm, a question; and after each of them what the program around it may rely on.
#include "client/asking.hpp"
#include "client/submission.hpp"
#include "client/watching.hpp"
#include "common/base/assert.hpp"
#include "common/protocol/cells.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/passes.hpp"
#include "common/protocol/topics.hpp"
#include "tests/fuzz/arbitrary.hpp"

#include <algorithm>
#include <memory>
#include <set>
#include <tuple>

using namespace fraja;
using namespace fraja::fuzz;
using namespace fraja::protocol;

namespace {

constexpr std::size_t events_max = 400;
constexpr int ticks_max = 4; ///< at one time
constexpr std::uint32_t tile_side = 8;

client::SessionOptions session_options(Input& in) {
    client::SessionOptions options;
    options.brokers.assign(1 + in.below(3), "tcp://farm:50057");
    options.connect_timeout = std::chrono::seconds(in.below(30));
    options.client_name = "fuzz";
    return options;
}

class World {
public:
    explicit World(Input& in) : in_(in), job_(make_job(in)), core_(make_core()) {}

    void run() {
        std::vector<client::Action> actions;
        core_->start(now_, actions);
        check(actions);
        if (!in_.once_in(4))
            session(welcome());
        for (std::size_t i = 0; i < events_max && !in_.empty(); ++i)
            one_event();
    }

private:
    static SubmitJob make_job(Input& in) {
        auto job = message_of<SubmitJob>(in);
        const KnownScene& scene = any_scene(in);
        job.job = id_of<JobId>(1);
        job.job_name = "a";
        job.scene = scene.hash;
        job.scene_bytes = scene.text.size();
        job.settings = small_picture(in);
        return job;
    }

    std::unique_ptr<client::Core> make_core() {
        const std::uint32_t kind = in_.below(8);
        const client::SessionOptions session = session_options(in_);
        const Rng rng(1);
        if (kind < 3) {
            client::SubmissionRequest request{
                .job = job_, .scene_text = {}, .session = session, .timeout = {}};
            for (const KnownScene& scene : known_scenes())
                if (scene.hash == job_.scene)
                    request.scene_text = scene.text;
            request.detach = in_.once_in(8);
            if (in_.once_in(4))
                request.timeout = time_step(in_);
            if (in_.once_in(4) && job_.settings.limited_in_time())
                request.ends_at = now_ + time_step(in_);
            return std::make_unique<client::Submission>(request, rng);
        }
        if (kind < 6) {
            client::WatchRequest request{.job = "a", .session = session, .until = {}};
            request.until.share = in_.once_in(4) ? in_.below(5) / 4.0 : 1;
            request.until.once = in_.once_in(4);
            return std::make_unique<client::JobWatching>(request, rng);
        }
        if (kind == 6)
            return std::make_unique<client::FarmWatching>(session);
        client::Question question =
            client::WorkerQuestion{"w", message_of<ControlWorker>(in_).deed};
        if (in_.below(4) != 0)
            question = client::JobQuestion{
                "a",
                in_.below(2) == 1 ? std::optional(message_of<ControlJob>(in_).deed) : std::nullopt};
        return std::make_unique<client::Asking>(question, session);
    }

    void one_event() {
        switch (in_.below(16)) {
        case 0:
            now_ = now_ + time_step(in_);
            return step(client::Tick{});
        case 1:
            return tick_when_due();
        case 2:
        case 3:
            return session(in_.once_in(4) ? message_of<Welcome>(in_) : welcome());
        case 4:
        case 5:
            return session(state());
        case 6:
            return stream(state());
        case 7:
        case 8:
            return stream(tile());
        case 9:
            return session(tile());
        case 10:
            return session(RepairDone{state(), in_.below(3)});
        case 11:
            return barrier();
        case 12:
            return session(answer());
        case 13:
            return stumble();
        case 14:
            return session(any_message(in_));
        case 15:
            return stream(any_message(in_));
        }
    }

    void session(Message message) {
        const Version said_in = fuzz::version_of(message);
        step(client::FromBroker{std::move(message), said_in});
    }
    void stream(Message message) { step(client::FromStream{std::move(message)}); }

    Welcome welcome() {
        return {.broker = id_of<BrokerId>(1),
                .epoch = 1,
                .heartbeat = std::chrono::seconds(1),
                .liveness = 3,
                .stream = "tcp://*:50058",
                .program_version = {},
                .incarnation = 0};
    }

    /// Of this job, and possible, mostly.
    JobState state() {
        if (in_.once_in(8))
            return message_of<JobState>(in_);
        JobState state;
        fill(in_, state.phase);
        copy_common(state, job_);
        state.epoch = in_.below(3);
        state.cell_side = tile_side;
        state.cell_count = tiles_per_pass() * pass_count(job_.settings);
        state.done_count = in_.below(state.cell_count + 1);
        state.elapsed = std::chrono::milliseconds(in_.byte());
        if (state.phase == JobPhase::done && !in_.once_in(4))
            state.done_count = state.cell_count;
        return state;
    }

    [[nodiscard]] PixelRect cells() const { return cells_of(job_.settings.crop, tile_side); }
    [[nodiscard]] std::uint32_t tiles_per_pass() const {
        return static_cast<std::uint32_t>(cells().pixel_count());
    }

    TileDone tile() {
        if (in_.once_in(8))
            return message_of<TileDone>(in_);
        TileDone tile;
        const std::uint32_t number = in_.below(tiles_per_pass() * pass_count(job_.settings));
        copy_common(tile, job_);
        tile.tile = static_cast<decltype(tile.tile)>(number);
        tile.pass = number / tiles_per_pass();
        const CellGrid grid(job_.settings.crop, tile_side);
        CellRect rect = grid.at(number % tiles_per_pass());
        rect.width += in_.below(grid.all().width - rect.column);
        rect.height += in_.below(grid.all().height - rect.row);
        tile.rect = grid.pixels(rect);
        tile.blobs =
            pixels(tile.rect.pixel_count() * job_.settings.pixel_bytes() + in_.once_in(8), in_);
        return tile;
    }

    void barrier() {
        auto barrier = message_of<Barrier>(in_);
        for (const std::string& topic : topics_)
            if (const auto nonce = topic_id<Nonce>('N', topic))
                barrier.nonce = *nonce;
        stream(barrier);
    }

    /// To what was asked last.
    Message answer() {
        if (in_.below(2)) {
            auto refused = message_of<Refused>(in_);
            refused.job = job_.job;
            return refused;
        }
        auto need = message_of<NeedChunk>(in_);
        need.blob = job_.scene;
        if (!in_.once_in(4))
            need.offset_bytes = in_.below(2) * chunk_bytes;
        return need;
    }

    void stumble() {
        std::string text;
        fill(in_, text);
        switch (in_.below(16)) {
        case 15:
            return step(client::Undecodable{Error{ErrorCode::version_mismatch, text}});
        case 14:
            return step(client::Undecodable{Error{ErrorCode::malformed_frame, text}});
        default:
            return step(client::NotSent{});
        }
    }

    /// Ticks when they are due move the deadline on: or the shell would never wait.
    void tick_when_due() {
        const Instant due = core_->next_deadline();
        if (due == Instant::never())
            return;
        now_ = std::max(now_, due);
        if (now_.since_start > std::chrono::hours(24 * 365))
            return;
        for (int i = 0; i < ticks_max && core_->next_deadline() <= now_; ++i)
            step(client::Tick{});
        FRAJA_ASSERT(core_->next_deadline() > now_);
    }

    void step(const client::Event& event) {
        std::vector<client::Action> actions;
        core_->step(now_, event, actions);
        check(actions);
        FRAJA_ASSERT(finished_ == (core_->next_deadline() == Instant::never()));
    }

    void check(const std::vector<client::Action>& actions) {
        for (const auto& action : actions) {
            FRAJA_ASSERT(!finished_);
            std::visit([this](const auto& a) { check(a); }, action);
        }
    }

    void check(const client::Connect& connect) { FRAJA_ASSERT(!connect.broker.empty()); }
    void check(const client::Speak& speak) { spoken_ = speak.version; }
    void check(const client::Look&) { FRAJA_ASSERT(false); } // it was given no source
    void check(const client::StopLooking&) { FRAJA_ASSERT(false); }
    void check(const client::OpenStream&) { topics_.clear(); }
    void check(const client::Subscribe& subscribe) { topics_.insert(subscribe.topic); }
    void check(const client::Unsubscribe& unsubscribe) { topics_.erase(unsubscribe.topic); }
    void check(const client::Send& send) { (void)encode(send.message, spoken_); } // it can be sent

    void check(const client::News& news) {
        std::visit([this](const auto& n) { check_news(n); }, news);
    }
    /// Anew, where the broker had forgotten the job.
    void check_news(const client::Accepted&) { arrived_.clear(); }
    void check_news(const client::TileArrived& news) {
        const TileDone& tile = news.tile;
        FRAJA_ASSERT(static_cast<std::size_t>(tile.tile) < news.cell_count);
        bool is_new = false;
        for (std::uint32_t y = tile.rect.y; y < tile.rect.y + tile.rect.height; ++y)
            for (std::uint32_t x = tile.rect.x; x < tile.rect.x + tile.rect.width; ++x)
                is_new = arrived_.insert({tile.pass, x, y}).second || is_new;
        FRAJA_ASSERT(is_new);
        FRAJA_ASSERT(!tile.rect.empty() && !tile.blobs.empty());
    }
    void check_news(const client::Finished&) { finished_ = true; }
    template <class N>
    void check_news(const N&) {}

    Input& in_;
    const SubmitJob job_;
    std::unique_ptr<client::Core> core_;
    Instant now_{};
    Version spoken_ = version;
    std::set<std::string> topics_;
    std::set<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>> arrived_; ///< pass, x, y
    bool finished_ = false;
};

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    Input in(data, size);
    World(in).run();
    return 0;
}
