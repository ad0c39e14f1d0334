// The broker's core, whatever its peers say and when: a stream of events for broker::Dispatcher,
// and after each of them what every peer may rely on, judged by what it was sent. In every other
// world there is a store, and the broker dies and is started again with what that holds. Where
// others stand for it, these are strangers as well.
#pragma once

#include "broker/dispatcher.hpp"
#include "common/base/assert.hpp"
#include "common/protocol/cells.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/passes.hpp"
#include "common/protocol/topics.hpp"
#include "tests/fuzz/arbitrary.hpp"
#include "tests/sim/kept.hpp"

#include <algorithm>
#include <deque>
#include <map>
#include <memory>
#include <set>
#include <tuple>

namespace fraja::fuzz {

using namespace protocol;
using broker::PeerId;

inline constexpr std::uint32_t workers = 4, clients = 3; ///< connections
inline constexpr std::uint32_t strangers = 3;            ///< that say to be brokers, by dialling
inline constexpr std::size_t events_max = 400;
inline constexpr std::uint64_t pixels_max = 4'096; ///< of a job: more takes time, and is the same
inline constexpr std::uint64_t plan_max = 2'048;   ///< tiles, of all passes
inline constexpr std::size_t orders_max = 4;       ///< at once

/// Few of everything, so that the limits are met.
inline broker::Limits small_limits() {
    broker::Limits limits;
    limits.workers_max = 4;
    limits.clients_max = 3;
    limits.jobs_max = 3;
    limits.finished_jobs_max = 2;
    limits.stored_bytes_max = 200'000;
    limits.client_bytes_max = 150'000;
    limits.blob_bytes_max = 600'000;
    limits.repair_tiles_max = 8;
    limits.repair_bytes_max = 2'000;
    limits.farm_jobs_max = 3;
    limits.farm_workers_max = 3;
    return limits;
}

/// What names a tile at a worker.
using TileKey = std::tuple<JobId, decltype(RenderTile::tile), decltype(RenderTile::attempt)>;

template <class M>
TileKey key_of(const M& m) {
    return {m.job, m.tile, m.attempt};
}

/// A peer as it sees itself.
struct Peer {
    bool spoke = false;
    bool welcome_as_worker = false; ///< the last Welcome answered a WorkerHello
    std::uint32_t credit = 0;       ///< last said
    std::uint64_t tiles_received = 0;
    struct Tile {
        RenderTile order;
        std::uint64_t number = 0; ///< of the session's tiles, from 0
    };
    std::map<TileKey, Tile> outstanding;

    [[nodiscard]] const Tile* pick(Input& in) const {
        if (outstanding.empty())
            return nullptr;
        const auto at = in.below(static_cast<std::uint32_t>(outstanding.size()));
        return &std::next(outstanding.begin(), at)->second;
    }
};

/// Pixels: of which pass, x, y.
using Places = std::set<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>>;

/// A job as its watchers see it.
struct WatchedJob {
    std::uint32_t number = 0; ///< another one: another job of the same id
    PictureSettings settings;
    JobPhase phase{};
    std::uint32_t done_count = 0;
    Places published;
};

/// Whether there are brokers that stand for this one.
enum class Company : std::uint8_t { none, brokers };

class World {
public:
    World(Input& in, Company company) : in_(in), has_company_(company == Company::brokers) {
        if (in_.below(2))
            kept_.emplace(small_limits().tombstones_max);
        start();
    }

    void run() {
        if (!in_.once_in(4))
            begin();
        for (std::size_t i = 0; i < events_max && !in_.empty(); ++i)
            one_event();
        for (std::uint32_t id = 1; id <= ids; ++id)
            check_repair(id_of<JobId>(id));
    }

private:
    // Any peer may say anything; but mostly the first ones are workers, the others clients.
    PeerId worker() { return peer(0, workers); }
    PeerId client() { return peer(workers, clients); }
    PeerId anybody() { return peer(0, workers + clients); }
    PeerId peer(std::uint32_t first, std::uint32_t count) {
        if (in_.once_in(16))
            first = 0, count = workers + clients;
        return name_of_peer(first + in_.below(count));
    }
    static PeerId name_of_peer(std::uint32_t number) {
        return std::string(1, static_cast<char>('a' + number));
    }

    // ------------------------------------------------------------------------------ what happens

    void begin() {
        WorkerHello hello;
        hello.threads = 2;
        hello.credit = 3;
        for (std::uint32_t i = 0; i < 2; ++i) {
            hello.worker = id_of<WorkerId>(1 + i);
            say(name_of_peer(i), hello);
        }
        say(name_of_peer(workers), ClientHello{});
    }

    void start() {
        ++epoch_;
        dispatcher_ = std::make_unique<broker::Dispatcher>(
            broker::Dispatcher::Identity{.broker = id_of<BrokerId>(1),
                                         .epoch = epoch_,
                                         .stream = "tcp://*:50058",
                                         .keeps = kept_.has_value(),
                                         .started_at = now_,
                                         .endpoint = has_company_ ? endpoint_of(0) : std::string(),
                                         .peers = has_company_ ? std::vector{endpoint_of(1)}
                                                               : std::vector<std::string>(),
                                         .is_branch = !has_company_},
            small_limits());
        if (!kept_)
            return;
        broker::Restored restored{kept_->contents(now_.since_start), {}};
        for (const broker::StoredJob& stored : restored.contents.jobs) {
            if (auto scene = kept_->scene(stored.submission.scene))
                restored.scenes[stored.submission.scene] = std::move(*scene);
            WatchedJob& job = jobs_[stored.submission.job];
            job = {.number = stored.number,
                   .settings = stored.submission.settings,
                   .phase = stored.phase,
                   .done_count = 0,
                   .published = {}};
            for (const broker::StoredTile& tile : stored.tiles)
                add_places(tile.rect, tile.pass, job.published);
        }
        step(restored);
    }

    /// What was not committed is lost, and so is every session.
    void die() {
        lines_.clear();
        writing_.clear();
        orders_.clear();
        peers_.clear();
        needed_.clear();
        jobs_.clear();
        store_fails_ = false;
        persisted_ = 0;
        start();
    }

    void one_event() {
        if (has_company_ && in_.below(2) == 0)
            return broker_says();
        switch (in_.below(24)) {
        case 0:
            now_ = now_ + time_step(in_);
            return step(broker::Tick{});
        case 1:
            now_ = std::max(now_, dispatcher_->next_deadline());
            return step(broker::Tick{});
        case 2:
            return say(worker(), hello());
        case 3:
            return say(client(), in_.once_in(4) ? Message(message_of<ClientHello>(in_))
                                                : Message(ClientHello{}));
        case 4:
        case 5:
            return submit(client());
        case 6:
        case 7:
            return give_chunk();
        case 8:
        case 9:
        case 10:
        case 11:
            return render(worker());
        case 12:
            return fail(worker());
        case 13:
            return beat(worker());
        case 14:
            return ask(client());
        case 15:
            return rubbish(anybody());
        case 16:
            return step(broker::PeerUnreachable{anybody()});
        case 17:
            return subscriptions();
        case 18:
            return say_again(anybody());
        case 19:
            return say(anybody(), any_message(in_));
        case 20:
            return has_company_ ? broker_says() : order();
        case 21:
        case 22:
            return commit();
        case 23:
            return trouble();
        }
    }

    // Whoever says to be a broker, and does not keep to what brokers do.

    static std::string endpoint_of(std::uint32_t broker) {
        return "tcp://broker" + std::to_string(broker) + ":50057";
    }
    BrokerId any_broker() { return id_of<BrokerId>(in_.once_in(8) ? in_.byte() : in_.below(5)); }

    /// By a connection that it dialled, or by one on which it was.
    void broker_says() {
        const bool was_dialled = !lines_.empty() && in_.below(2) == 0;
        if (!was_dialled)
            return say(name_of_peer(workers + clients + in_.below(strangers)), broker_message());
        const auto line =
            std::next(lines_.begin(), in_.below(static_cast<std::uint32_t>(lines_.size())));
        step(broker::BrokerSaid{*line, broker_message(),
                                in_.once_in(32) ? oldest_version_spoken : version});
    }

    Message broker_message() {
        switch (in_.below(12)) {
        case 0:
        case 1: {
            auto hello = message_of<BrokerHello>(in_);
            hello.broker = any_broker();
            if (!in_.once_in(8))
                hello.endpoint = endpoint_of(in_.below(40));
            return hello;
        }
        case 2: {
            auto beat = message_of<BrokerBeat>(in_);
            beat.broker = any_broker();
            for (Member& member : beat.brokers)
                member = {any_broker(), endpoint_of(in_.below(40))};
            return beat;
        }
        case 3:
            return CompareJobs{};
        case 4:
            return message_of<JobDigests>(in_);
        case 5:
        case 6:
        case 7:
            return record();
        case 8:
            return tile_of_theirs();
        case 9:
            return known_chunk();
        case 10:
            return in_.below(2) ? Message(message_of<JobKept>(in_))
                                : Message(message_of<RepairDone>(in_));
        default:
            return any_message(in_);
        }
    }

    /// Of one picture for each id, mostly: so that words about it follow one another.
    JobRecord record() {
        auto record = message_of<JobRecord>(in_);
        fill(in_, record.submission.job);
        if (!in_.once_in(8))
            record.submission = picture_of(record.submission.job);
        record.revision.counter = in_.below(16);
        record.revision.broker = any_broker();
        record.passes = in_.once_in(8) ? in_.below(4) : 1;
        if (record.distrusted.size() > 2 && !in_.once_in(8))
            record.distrusted.resize(1);
        if (too_large(record.submission))
            record.submission = picture_of(record.submission.job);
        return record;
    }

    static SubmitJob picture_of(const JobId& job) {
        SubmitJob s;
        const KnownScene& scene = known_scenes()[job.bytes[0] % 2];
        s.job = job;
        s.job_name = "theirs";
        s.scene = scene.hash;
        s.scene_bytes = scene.text.size();
        s.settings.size = {16, 8};
        s.settings.crop = {0, 0, 16, 8};
        s.tile_side = 4;
        s.wishes.verify = job.bytes[0] % 2;
        return s;
    }

    TileDone tile_of_theirs() {
        TileDone tile;
        fill(in_, tile.job);
        const SubmitJob s = picture_of(tile.job);
        const CellGrid grid(s.settings.crop, s.tile_side);
        const std::uint32_t cell = in_.below(static_cast<std::uint32_t>(grid.count()));
        tile.tile = TileIndex(cell);
        tile.rect = grid.pixels(grid.at(cell));
        fill(in_, tile.worker);
        fill(in_, tile.epoch);
        fill(in_, tile.rays);
        tile.blobs = {
            Blob(Bytes(tile.rect.pixel_count() * s.settings.pixel_bytes() + in_.once_in(16)))};
        return tile;
    }

    Chunk known_chunk() {
        const KnownScene& scene = any_scene(in_);
        return scene.chunks[in_.below(static_cast<std::uint32_t>(scene.chunks.size()))];
    }

    /// One that is welcome, mostly.
    WorkerHello hello() {
        if (in_.once_in(8))
            return message_of<WorkerHello>(in_);
        WorkerHello hello;
        fill(in_, hello.worker);
        hello.incarnation = in_.below(4);
        hello.threads = 1 + in_.below(4);
        hello.credit = in_.below(6);
        return hello;
    }

    void submit(const PeerId& peer) {
        if (in_.once_in(8))
            return say(peer, message_of<SubmitJob>(in_));
        SubmitJob job;
        const KnownScene& scene = any_scene(in_);
        fill(in_, job.job);
        job.job_name = in_.below(2) ? "a" : "b";
        job.scene = scene.hash;
        job.scene_bytes = scene.text.size();
        fill(in_, job.settings);
        fill(in_, job.order);
        job.tile_side = 4 * in_.below(4);
        job.priority = static_cast<std::int32_t>(in_.below(3));
        say(peer, job);
    }

    /// What was asked for the longest ago, from whom it was asked, mostly.
    void give_chunk() {
        Chunk chunk;
        PeerId peer = client();
        if (!needed_.empty() && !in_.once_in(8)) {
            peer = needed_.front().first;
            chunk = chunk_for(needed_.front().second).value_or(Chunk{});
            needed_.pop_front();
        }
        if (chunk.blobs.empty())
            chunk = message_of<Chunk>(in_);
        if (in_.once_in(8)) // the right size, and other bytes
            chunk.blobs = {Blob(Bytes(chunk.blobs.front().size(), std::byte{'?'}))};
        say(peer, chunk);
    }

    void ask(const PeerId& peer) {
        switch (in_.below(4)) {
        case 0:
            return say(peer, message_of<FindJob>(in_));
        case 1:
            return in_.once_in(4) ? say(peer, message_of<ControlWorker>(in_))
                                  : say(peer, message_of<ControlJob>(in_));
        case 2:
            return say(peer, message_of<Repair>(in_));
        case 3:
            return say(peer, Beat{});
        }
    }

    void render(const PeerId& peer) {
        const Peer::Tile* tile = peers_[peer].pick(in_);
        if (!tile)
            return say(peer, message_of<TileRendered>(in_));
        auto answer = answer_to<TileRendered>(tile->order);
        if (in_.once_in(4)) {
            fill(in_, answer.rays);
            fill(in_, answer.elapsed);
        }
        const std::uint64_t bytes =
            tile->order.rect.pixel_count() * tile->order.settings.pixel_bytes();
        answer.blobs = pixels(bytes + in_.once_in(16), in_);
        say(peer, answer);
    }

    void fail(const PeerId& peer) {
        const Peer::Tile* tile = peers_[peer].pick(in_);
        const auto answer = message_of<TileFailed>(in_);
        say(peer, tile ? answer_to(tile->order, answer) : answer);
    }

    /// As the broker above would want it.
    void order() {
        if (!orders_.empty() && in_.once_in(3)) {
            const auto at =
                std::next(orders_.begin(), in_.below(static_cast<std::uint32_t>(orders_.size())));
            const JobId id = at->first;
            orders_.erase(at);
            return step(broker::OrderWithdrawn{id});
        }
        const KnownScene& scene = any_scene(in_);
        broker::Order order;
        order.id = id_of<JobId>(++last_order_);
        order.id.bytes[1] = 1; // as no client's
        fill(in_, order.settings);
        const PixelRect crop = order.settings.crop;
        if (orders_.size() >= orders_max || !validate(order.settings) ||
            crop.pixel_count() > pixels_max)
            return;
        order.rect = crop;
        if (in_.below(2))
            order.rect = {crop.x, crop.y, (crop.width + 1) / 2, (crop.height + 1) / 2};
        order.pass = in_.below(pass_count(order.settings));
        order.scene = scene.hash;
        order.scene_text = scene.text;
        if (in_.once_in(8))
            order.probe_side = 1 + in_.below(64);
        orders_.emplace(order.id, order);
        step(broker::Ordered{order});
    }

    void commit() {
        if (!kept_ || writing_.empty())
            return;
        const std::size_t count = 1 + in_.below(static_cast<std::uint32_t>(writing_.size()));
        broker::Stored stored;
        for (std::size_t i = 0; i < count; ++i) {
            stored.sequence = writing_.front().sequence;
            kept_->put(writing_.front().write, now_.since_start);
            writing_.pop_front();
        }
        step(stored);
    }

    void trouble() {
        if (!kept_)
            return;
        if (in_.once_in(3))
            return die();
        if (std::exchange(store_fails_, !store_fails_))
            step(broker::StoreWorks{});
        else
            step(broker::StoreFails{"no space"});
    }

    /// With what it has, less than that, or something else.
    void beat(const PeerId& name) {
        const Peer& peer = peers_[name];
        WorkerBeat beat;
        if (in_.once_in(8)) {
            fill(in_, beat);
        } else {
            beat.credit = in_.below(6);
            beat.tiles_received = peer.tiles_received - in_.once_in(4);
            for (const auto& [key, tile] : peer.outstanding)
                if (!in_.once_in(4)) {
                    TileInFlight& named = beat.in_flight.emplace_back();
                    copy_common(named, tile.order);
                    named.rays = in_.byte();
                }
        }
        say(name, beat);
    }

    void rubbish(const PeerId& peer) {
        std::string text;
        fill(in_, text);
        peers_[peer].spoke = true;
        step(broker::PeerSpokeRubbish{
            peer,
            Error{in_.below(2) ? ErrorCode::version_mismatch : ErrorCode::malformed_frame, text},
            text.size() % 4 == 0 ? Version{9} : version_of(peer)});
    }

    void subscriptions() {
        std::string topic(farm_topic);
        switch (in_.below(4)) {
        case 0:
            break;
        case 1:
            fill(in_, topic);
            break;
        case 2:
            topic = barrier_topic(id_of<Nonce>(in_.byte()));
            break;
        case 3:
            topic = job_topic(id_of<JobId>(1 + in_.below(ids)));
            break;
        }
        if (in_.once_in(4))
            step(broker::TopicUnsubscribed{topic});
        else
            step(broker::TopicSubscribed{topic});
    }

    void say_again(const PeerId& peer) {
        if (last_said_)
            say(peer, Message(*last_said_));
    }

    void say(const PeerId& peer, Message message) {
        if (const auto* job = std::get_if<SubmitJob>(&message); job && too_large(*job))
            return;
        note_said(peer, message);
        last_said_ = message;
        const Version spoken = is_known_to(version_of(peer), message) ? version_of(peer) : version;
        step(broker::PeerSaid{peer, std::move(message), {}, spoken});
    }

    /// Some are of the version before.
    static Version version_of(const PeerId& peer) {
        return peer.back() % 4 == 3 ? oldest_version_spoken : version;
    }

    static bool too_large(const SubmitJob& job) {
        const PixelRect& crop = job.settings.crop;
        if (!validate(job.settings))
            return false; // it is refused
        return crop.pixel_count() > pixels_max || pass_count(job.settings) > 8 ||
               crop.pixel_count() * pass_count(job.settings) /
                       std::max<std::uint64_t>(1, std::uint64_t{job.tile_side} * job.tile_side) >
                   plan_max;
    }

    // ------------------------------------------------------------------- what peers know of it

    void note_said(const PeerId& name, const Message& message) {
        Peer& peer = peers_[name];
        peer.spoke = true;
        if (const auto* hello = std::get_if<WorkerHello>(&message)) {
            said_hello_ = *hello;
        } else if (const auto* beat = std::get_if<WorkerBeat>(&message)) {
            peer.credit = std::min<std::uint32_t>(beat->credit, credit_max);
            std::set<TileKey> named;
            for (const TileInFlight& tile : beat->in_flight)
                named.insert(key_of(tile));
            std::erase_if(peer.outstanding, [&](const auto& entry) {
                return !named.contains(entry.first) && entry.second.number < beat->tiles_received;
            });
        } else if (const auto* rendered = std::get_if<TileRendered>(&message)) {
            peer.outstanding.erase(key_of(*rendered));
        } else if (const auto* failed = std::get_if<TileFailed>(&message)) {
            peer.outstanding.erase(key_of(*failed));
        }
    }

    void step(const broker::Event& first) {
        std::deque<broker::Event> events{first};
        while (!events.empty()) {
            std::vector<broker::Action> actions;
            dispatcher_->step(now_, events.front(), actions);
            events.pop_front();
            for (const auto& action : actions)
                std::visit([this](const auto& a) { check(a); }, action);
            events.insert(events.end(), loaded_.begin(), loaded_.end());
            loaded_.clear();
            said_hello_.reset();
        }
        FRAJA_ASSERT(dispatcher_->next_deadline() > now_ - std::chrono::nanoseconds(1));
        const broker::Limits limits = small_limits();
        FRAJA_ASSERT(dispatcher_->worker_count() <= limits.workers_max);
        FRAJA_ASSERT(dispatcher_->client_count() <= limits.clients_max);
        FRAJA_ASSERT(dispatcher_->job_count() <=
                     limits.jobs_max + limits.finished_jobs_max + 1 + orders_.size());
        FRAJA_ASSERT(dispatcher_->membership().peers().size() < brokers_max);
    }

    void check(const broker::Log&) {}
    void check(const broker::Dial& dial) { // who says hello as a broker is called back
        FRAJA_ASSERT(dial.endpoint.size() <= string_bytes_max);
        lines_.insert(dial.endpoint);
        FRAJA_ASSERT(lines_.size() <= brokers_max);
    }
    void check(const broker::HangUp& gone) { FRAJA_ASSERT(lines_.erase(gone.endpoint) == 1); }
    void check(const broker::Tell& words) {
        (void)encode(words.message);
        FRAJA_ASSERT(lines_.contains(words.endpoint));
    }
    void check(const broker::Persist& persist) {
        FRAJA_ASSERT(kept_ && persist.sequence == ++persisted_);
        writing_.push_back(persist);
    }
    void check(const broker::SendStored& wish) {
        FRAJA_ASSERT(kept_.has_value());
        for (const TileIndex tile : wish.tiles)
            FRAJA_ASSERT(!kept_->tiles(wish.job, tile).empty());
    }
    void check(const broker::LoadScene& load) {
        FRAJA_ASSERT(kept_.has_value());
        loaded_.push_back(broker::SceneLoaded{load.job, load.peer, kept_->scene(load.scene)});
    }
    /// Whole, and asked for.
    void check(const broker::OrderFilled& filled) {
        const auto order = orders_.find(filled.id);
        FRAJA_ASSERT(order != orders_.end());
        if (order->second.probe_side > 0) {
            FRAJA_ASSERT(filled.parts.empty());
        } else {
            Places places;
            for (const auto& part : filled.parts) {
                FRAJA_ASSERT(part->rect.inside(order->second.rect));
                add_places(part->rect, 0, places);
            }
            FRAJA_ASSERT(places.size() == order->second.rect.pixel_count());
        }
        orders_.erase(order);
    }
    void check(const broker::OrderFailed& failed) { FRAJA_ASSERT(orders_.erase(failed.id) == 1); }

    void check(const broker::Send& send) {
        (void)encode(send.message, send.version); // it can be sent
        Peer& peer = peers_[send.peer];
        FRAJA_ASSERT(peer.spoke);
        if (std::holds_alternative<Welcome>(send.message)) {
            peer.welcome_as_worker = said_hello_.has_value();
            peer.credit = said_hello_ ? said_hello_->credit : 0;
            peer.tiles_received = 0;
            peer.outstanding.clear();
        } else if (const auto* tile = std::get_if<RenderTile>(&send.message)) {
            check_order(peer, *tile);
        } else if (const auto* need = std::get_if<NeedChunk>(&send.message)) {
            needed_.emplace_back(send.peer, *need);
        } else if (const auto* state = std::get_if<JobState>(&send.message)) {
            check_state(*state);
        } else if (const auto* done = std::get_if<RepairDone>(&send.message)) {
            check_state(done->state);
        }
    }

    void check_order(Peer& peer, const RenderTile& tile) {
        FRAJA_ASSERT(peer.welcome_as_worker);
        FRAJA_ASSERT(has_company_ || peer.outstanding.size() < peer.credit); // it led no more, once
        FRAJA_ASSERT(validate(tile.settings) && !tile.rect.empty());
        FRAJA_ASSERT(tile.rect.inside(tile.settings.crop));
        FRAJA_ASSERT(!store_fails_);
        if (const auto order = orders_.find(tile.job); order != orders_.end())
            FRAJA_ASSERT(tile.rect.inside(order->second.rect) && tile.pass == order->second.pass);
        const bool fresh =
            peer.outstanding.emplace(key_of(tile), Peer::Tile{tile, peer.tiles_received++}).second;
        FRAJA_ASSERT(fresh); // or an answer could mean either
    }

    void check(const broker::Publish& publish) {
        (void)encode(publish.message, oldest_version_spoken);
        if (const auto* tile = std::get_if<TileDone>(&publish.message)) {
            FRAJA_ASSERT(publish.topic == job_topic(tile->job));
            check_published(*tile);
        } else if (const auto* state = std::get_if<JobState>(&publish.message)) {
            FRAJA_ASSERT(publish.topic == job_topic(state->job));
            check_state(*state);
        } else if (const auto* farm = std::get_if<FarmState>(&publish.message)) {
            for (const JobState& job : farm->jobs)
                check_state(job);
        }
    }

    /// What is published brings a pixel of a pass that was not there.
    void check_published(const TileDone& tile) {
        if (has_company_)
            return; // it may have come from others, and been forgotten
        WatchedJob& job = jobs_[tile.job];
        FRAJA_ASSERT(job.phase != JobPhase::done && tile.rect.inside(job.settings.crop));
        add_places(tile.rect, tile.pass, job.published);
    }

    void check_state(const JobState& state) {
        WatchedJob& job = jobs_[state.job];
        if (state.number != job.number)
            job = {.number = state.number,
                   .settings = state.settings,
                   .phase = state.phase,
                   .done_count = 0,
                   .published = {}};
        FRAJA_ASSERT(state.done_count <= state.cell_count);
        if (!has_company_) {
            FRAJA_ASSERT(state.epoch >= epoch_ && state.settings == job.settings);
            FRAJA_ASSERT(state.done_count >= job.done_count);
            // What failed or was cancelled may be tried again.
            FRAJA_ASSERT(job.phase != JobPhase::done || state.phase == job.phase);
            FRAJA_ASSERT(!is_over(job.phase) || is_over(state.phase) ||
                         state.phase == JobPhase::queued || state.phase == JobPhase::running);
        }
        FRAJA_ASSERT(state.elapsed >= Duration::zero());
        FRAJA_ASSERT(state.share_done >= 0 && state.share_done <= 1);
        FRAJA_ASSERT(state.phase != JobPhase::done || state.settings.limited_in_time() ||
                     state.done_count == state.cell_count);
        job.phase = state.phase;
        job.done_count = state.done_count;
    }

    /// A client that asks for all of a job's tiles gets each once; of a job that is done they are
    /// all of the picture, or of one pass.
    void check_repair(const JobId& id) {
        const PeerId peer = "z";
        note_said(peer, Goodbye{});
        std::vector<broker::Action> actions;
        // Silence makes room for one client more.
        dispatcher_->step(now_ = now_ + std::chrono::seconds(60), broker::Tick{}, actions);
        dispatcher_->step(now_, broker::PeerSaid{peer, ClientHello{}}, actions);
        Places places;
        Bitmap have;
        std::optional<RepairDone> done = repair(peer, id, 0, have, places);
        if (done)
            have = Bitmap(done->state.cell_count);
        while (done && done->remaining_count > 0)
            done = repair(peer, id, UINT32_MAX, have, places,
                          CellGrid(done->state.settings.crop, done->state.cell_side));
        if (!done || done->state.phase != JobPhase::done)
            return;
        const PixelRect& crop = done->state.settings.crop;
        for (std::uint32_t y = crop.y; y < crop.y + crop.height; ++y)
            for (std::uint32_t x = crop.x; x < crop.x + crop.width; ++x)
                FRAJA_ASSERT(places.contains({0, x, y}));
    }

    std::optional<RepairDone> repair(const PeerId& peer, const JobId& job, std::uint32_t tiles_max,
                                     Bitmap& have, Places& places, const CellGrid& grid = {}) {
        std::vector<broker::Action> actions;
        dispatcher_->step(now_, broker::PeerSaid{peer, Repair{job, tiles_max, have.bytes()}},
                          actions);
        std::optional<RepairDone> done;
        const auto take = [&](const TileDone& tile) {
            const auto cells = grid.cells(tile.rect);
            FRAJA_ASSERT(cells && grid.index(*cells) + tile.pass * grid.count() ==
                                      static_cast<std::size_t>(tile.tile));
            (void)grid.all_of(*cells, [&](std::uint64_t cell) {
                have.set(static_cast<std::size_t>(tile.pass * grid.count() + cell));
                return true;
            });
            add_places(tile.rect, tile.pass, places);
        };
        for (const broker::Action& action : actions)
            if (const auto* send = std::get_if<broker::Send>(&action)) {
                if (const auto* tile = std::get_if<TileDone>(&send->message))
                    take(*tile);
                else if (const auto* answer = std::get_if<RepairDone>(&send->message))
                    done = *answer;
            } else if (const auto* stored = std::get_if<broker::SendStored>(&action)) {
                FRAJA_ASSERT(kept_.has_value());
                for (const TileIndex tile : stored->tiles)
                    for (const auto& found : kept_->tiles(stored->job, tile))
                        take(*found);
            }
        return done;
    }

    /// At least one must be new.
    static void add_places(const PixelRect& rect, std::uint32_t pass, Places& places) {
        bool is_new = false;
        for (std::uint32_t y = rect.y; y < rect.y + rect.height; ++y)
            for (std::uint32_t x = rect.x; x < rect.x + rect.width; ++x)
                is_new = places.emplace(pass, x, y).second || is_new;
        FRAJA_ASSERT(is_new);
    }

    Input& in_;
    bool has_company_;
    std::set<std::string> lines_; ///< that were dialled
    std::uint64_t epoch_ = 6;
    std::unique_ptr<broker::Dispatcher> dispatcher_;
    Instant now_{};
    std::optional<sim::Kept> kept_;
    std::deque<broker::Persist> writing_; ///< and not committed
    std::uint64_t persisted_ = 0;
    bool store_fails_ = false;
    std::vector<broker::Event> loaded_;
    std::map<JobId, broker::Order> orders_; ///< open
    std::uint8_t last_order_ = 0;
    std::map<PeerId, Peer> peers_;
    std::map<JobId, WatchedJob> jobs_;
    std::deque<std::pair<PeerId, NeedChunk>> needed_; ///< asked, and not given
    std::optional<Message> last_said_;
    std::optional<WorkerHello> said_hello_; ///< in this step
};

} // namespace fraja::fuzz
