// FakeFarm: a broker of few words with one job, and a network that delays, drops, repeats and
// breaks, in pretend time. Drives a core until it is over and counts what it delivered.
#pragma once

#include "client/core.hpp"
#include "common/base/assert.hpp"
#include "common/base/rng.hpp"
#include "common/protocol/bitmap.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/topics.hpp"
#include "tests/support/messages.hpp"

#include <algorithm>
#include <cstring>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace fraja::client {

struct Faults {
    double stream_drop = 0, stream_repeat = 0; ///< of a published message
    double session_drop = 0;                   ///< of a message either way
    double rubbish = 0; ///< a message of nonsense beside each that is delivered
    Duration delay_max = std::chrono::milliseconds(5);
    Duration stream_delay_max = std::chrono::milliseconds(5);
    Duration heal_after = std::chrono::seconds(20); ///< then the network is as good as gold
    std::vector<Duration> forgets_sessions = {};    ///< the broker restarts, with its jobs
    std::vector<Duration> forgets_all = {};         ///< the broker restarts without a memory
    std::vector<Duration> submitted_again = {};     ///< by somebody else, after that
    std::vector<std::pair<Duration, Duration>> partitions = {}; ///< nothing passes from .. to ..
    bool no_stream = false;                                     ///< nothing is ever published
};

struct FakeJob {
    protocol::PictureSettings settings{.size = {40, 30}, .crop = {0, 0, 40, 30}};
    std::uint32_t tile_side = 4;
    Duration tile_time = std::chrono::milliseconds(30);   ///< one tile is done each
    protocol::JobPhase ending = protocol::JobPhase::done; ///< how it ends
    std::uint32_t ends_after = UINT32_MAX;                ///< tiles, where it does not end well
    std::uint32_t done_at_start = 0;
    bool exists_at_start = false; ///< else it must be submitted
    std::uint32_t repair_tiles_max = 256;
};

/// One that the broker has before anybody asks.
inline FakeJob existing(std::uint32_t done_at_start = 0) {
    FakeJob job;
    job.exists_at_start = true;
    job.done_at_start = done_at_start;
    return job;
}

class FakeFarm {
public:
    FakeFarm(FakeJob job, Faults faults, std::uint64_t seed)
        : plan_(std::move(job)), faults_(std::move(faults)), rng_(seed) {
        state_.job = JobId{{1, 2, 3}};
        state_.job_name = "cone";
        state_.number = 17;
        state_.epoch = 1;
        state_.settings = plan_.settings;
        for (std::uint32_t y = plan_.settings.crop.y;
             y < plan_.settings.crop.y + plan_.settings.crop.height; y += plan_.tile_side)
            for (std::uint32_t x = plan_.settings.crop.x;
                 x < plan_.settings.crop.x + plan_.settings.crop.width; x += plan_.tile_side)
                rects_.push_back({x, y,
                                  std::min(plan_.tile_side,
                                           plan_.settings.crop.x + plan_.settings.crop.width - x),
                                  std::min(plan_.tile_side, plan_.settings.crop.y +
                                                                plan_.settings.crop.height - y)});
        state_.cell_side = plan_.tile_side;
        state_.cell_count = static_cast<std::uint32_t>(rects_.size());
        if (plan_.exists_at_start) {
            exists_ = true;
            state_.phase = protocol::JobPhase::queued;
            for (std::uint32_t i = 0; i < plan_.done_at_start; ++i)
                finish_tile(false);
        }
        next_tile_ = now_ + plan_.tile_time;
    }

    /// Until the core is over, or `limit` has passed. Whether it is over.
    bool run(Core& core, Duration limit) {
        std::vector<Action> actions;
        core.start(now_, actions);
        perform(core, actions);
        while (!outcome && now_ < Instant{} + limit) {
            advance(core);
            if (!outcome && wants_to_stop && wants_to_stop())
                return false;
        }
        return outcome.has_value();
    }

    [[nodiscard]] Instant now() const { return now_; }
    [[nodiscard]] const protocol::JobState& state() const { return state_; }
    [[nodiscard]] std::uint32_t cell_count() const { return state_.cell_count; }
    [[nodiscard]] bool healed() const { return now_ >= Instant{} + faults_.heal_after; }

    // What the core made of it.
    std::optional<Outcome> outcome;
    std::map<std::uint32_t, int> delivered; ///< since the job was last accepted
    std::vector<protocol::JobState> states;
    int accepted_count = 0, connects = 0, lost_count = 0, submissions = 0, repairs = 0, hellos = 0;
    bool pixels_right = true;
    std::set<Nonce> nonces;
    std::function<bool()> wants_to_stop;
    Bytes scene_received;
    ContentHash scene_hash;
    std::uint64_t scene_bytes = 0;

private:
    struct ToClient {
        Instant at;
        bool stream;
        protocol::Message message;
    };
    struct ToBroker {
        Instant at;
        std::variant<protocol::Message, Subscribe, Unsubscribe> what;
    };

    [[nodiscard]] bool chance(double p) { return !healed() && rng_.unit() < p; }
    [[nodiscard]] bool parted() const {
        return std::ranges::any_of(faults_.partitions, [this](const auto& p) {
            return now_ >= Instant{} + p.first && now_ < Instant{} + p.second;
        });
    }
    Duration delay(Duration most) { return from_seconds(rng_.unit() * seconds(most)); }

    void advance(Core& core) {
        Instant next = core.next_deadline();
        const auto soonest = [&](Instant at) { next = std::min(next, at); };
        if (!session_.empty())
            soonest(session_.front().at);
        if (!stream_.empty())
            soonest(stream_.front().at);
        if (!inbox_.empty())
            soonest(inbox_.front().at);
        if (exists_ && !is_over(state_.phase))
            soonest(next_tile_);
        soonest(next_digest_);
        for (const Duration at : faults_.forgets_sessions)
            if (Instant{} + at > now_)
                soonest(Instant{} + at);
        now_ = std::max(now_, next);

        restart_if_due();
        if (exists_ && !is_over(state_.phase) &&
            state_.phase != protocol::JobPhase::waiting_for_scene && now_ >= next_tile_) {
            finish_tile(true);
            next_tile_ = now_ + plan_.tile_time;
        } else if (now_ >= next_tile_) {
            next_tile_ = now_ + plan_.tile_time;
        }
        if (now_ >= next_digest_) {
            if (exists_ && !is_over(state_.phase))
                publish_state();
            next_digest_ = now_ + std::chrono::milliseconds(100);
        }
        while (!inbox_.empty() && inbox_.front().at <= now_) {
            const auto what = std::move(inbox_.front().what);
            inbox_.pop_front();
            std::visit([this](const auto& w) { take(w); }, what);
        }
        std::vector<Action> actions;
        while (!outcome && deliver(core, session_, actions)) {
        }
        while (!outcome && deliver(core, stream_, actions)) {
        }
        if (!outcome) {
            core.step(now_, Tick{}, actions);
            perform(core, actions);
        }
    }

    bool deliver(Core& core, std::deque<ToClient>& queue, std::vector<Action>& actions) {
        if (queue.empty() || queue.front().at > now_)
            return false;
        const ToClient next = std::move(queue.front());
        queue.pop_front();
        // Before a job is known, any job may be meant.
        if (accepted_count > 0 && chance(faults_.rubbish))
            step(core, rubbish(), next.stream, actions);
        if (!outcome)
            step(core, next.message, next.stream, actions);
        return true;
    }

    void step(Core& core, protocol::Message message, bool stream, std::vector<Action>& actions) {
        if (stream)
            core.step(now_, FromStream{std::move(message)}, actions);
        else
            core.step(now_, FromBroker{std::move(message)}, actions);
        perform(core, actions);
    }

    /// Near misses, which are worse than noise.
    protocol::Message rubbish() {
        protocol::TileDone tile = tile_done(static_cast<std::uint32_t>(rng_.below(rects_.size())));
        protocol::JobState state = state_;
        switch (rng_.below(12)) {
        case 0:
            tile.tile = TileIndex{state_.cell_count + static_cast<std::uint32_t>(rng_.below(9))};
            return tile;
        case 1:
            tile.rect.x = UINT32_MAX - 1;
            return tile;
        case 2:
            tile.rect.width = 0;
            return tile;
        case 3:
            tile.blobs.push_back(Blob(Bytes(1)));
            return tile;
        case 4:
            tile.blobs.clear();
            return tile;
        case 5:
            tile.job.bytes[9] ^= 1;
            return tile;
        case 6:
            state.settings.depth += 1;
            state.cell_count += 1;
            return state;
        case 7:
            state.job.bytes[9] ^= 1;
            state.phase = protocol::JobPhase::done;
            return state;
        case 8:
            state.settings.size.width = 1u << 31;
            return state;
        case 9:
            state.done_count = state.cell_count + 1;
            return protocol::RepairDone{state, 0};
        case 10:
            return protocol::Barrier{Nonce{{42}}, 1};
        default:
            for (;;) { // but nothing that a session must believe
                protocol::Message message = random_message(rng_);
                if (!std::holds_alternative<protocol::Refused>(message) &&
                    !std::holds_alternative<protocol::Welcome>(message))
                    return message;
            }
        }
    }

    // ------------------------------------------------------------------------------- the broker

    void restart_if_due() {
        const auto due = [this](std::vector<Duration>& times) {
            return std::erase_if(times, [this](Duration at) { return Instant{} + at <= now_; }) > 0;
        };
        if (due(faults_.submitted_again))
            exists_ = true;
        const bool without_memory = due(faults_.forgets_all);
        if (!due(faults_.forgets_sessions) && !without_memory)
            return;
        ++state_.epoch;
        welcomed_ = false;
        session_.clear();
        stream_.clear();
        inbox_.clear();
        if (without_memory) {
            exists_ = false;
            done_.clear();
            state_.done_count = 0;
        }
    }

    void finish_tile(bool publish) {
        std::uint32_t tile = 0;
        do
            tile = static_cast<std::uint32_t>(rng_.below(rects_.size()));
        while (done_.contains(tile));
        done_.insert(tile);
        state_.phase = protocol::JobPhase::running;
        state_.done_count = static_cast<std::uint32_t>(done_.size());
        state_.elapsed = now_.since_start;
        if (publish)
            this->publish(protocol::job_topic(state_.job), tile_done(tile));
        const bool whole = done_.size() == rects_.size();
        const bool breaks =
            plan_.ending != protocol::JobPhase::done && done_.size() >= plan_.ends_after;
        if (!whole && !breaks)
            return;
        state_.phase = breaks ? plan_.ending : protocol::JobPhase::done;
        state_.reason = breaks ? "as planned" : "";
        if (publish)
            publish_state();
    }

    [[nodiscard]] protocol::TileDone tile_done(std::uint32_t tile) {
        protocol::TileDone done;
        done.job = state_.job;
        done.tile = TileIndex{tile};
        done.rect = rects_[tile];
        done.worker_name = "ada";
        Bytes pixels(12 * done.rect.pixel_count(), static_cast<std::byte>(tile));
        const auto cut = static_cast<std::ptrdiff_t>(rng_.below(pixels.size() + 1));
        done.blobs = {Blob(Bytes(pixels.begin(), pixels.begin() + cut)),
                      Blob(Bytes(pixels.begin() + cut, pixels.end()))};
        return done;
    }

    void publish_state() {
        state_.elapsed = now_.since_start;
        publish(protocol::job_topic(state_.job), state_);
    }

    void publish(const std::string& topic, protocol::Message message) {
        if (!topics_.contains(topic) || faults_.no_stream || parted())
            return;
        if (chance(faults_.stream_drop))
            return;
        // In order, as one connection is.
        const Instant last = stream_.empty() ? now_ : stream_.back().at;
        const Instant at = std::max(last, now_ + delay(faults_.stream_delay_max));
        const bool repeat = chance(faults_.stream_repeat);
        stream_.push_back({at, true, message});
        if (repeat)
            stream_.push_back({at, true, std::move(message)});
    }

    void answer(protocol::Message message) {
        if (parted() || chance(faults_.session_drop))
            return;
        const Instant last = session_.empty() ? now_ : session_.back().at;
        session_.push_back(
            {std::max(last, now_ + delay(faults_.delay_max)), false, std::move(message)});
    }

    void take(const Subscribe& s) {
        topics_.insert(s.topic);
        if (const auto nonce = protocol::topic_id<Nonce>('N', s.topic)) {
            nonces.insert(*nonce);
            publish(s.topic, protocol::Barrier{*nonce, state_.epoch});
        }
    }
    void take(const Unsubscribe& u) { topics_.erase(u.topic); }

    void take(const protocol::Message& message) {
        using namespace protocol;
        if (std::holds_alternative<ClientHello>(message)) {
            ++hellos;
            welcomed_ = true;
            return answer(Welcome{BrokerId{{7}}, state_.epoch, std::chrono::seconds(1), 3,
                                  "tcp://127.0.0.1:50058", "test"});
        }
        if (!welcomed_)
            return answer(Refused{RefusalCode::unknown_peer, JobId{}, "say hello first"});
        if (std::holds_alternative<Beat>(message))
            return answer(Beat{});
        if (const auto* submit = std::get_if<SubmitJob>(&message))
            return take_submission(*submit);
        if (const auto* chunk = std::get_if<Chunk>(&message))
            return take_chunk(*chunk);
        if (std::holds_alternative<FindJob>(message))
            return exists_ ? answer(state_) : forget(JobId{});
        if (const auto* cancel = std::get_if<ControlJob>(&message)) {
            if (!exists_)
                return forget(cancel->job);
            if (!is_over(state_.phase))
                state_.phase = JobPhase::cancelled;
            return answer(state_);
        }
        if (const auto* repair = std::get_if<Repair>(&message))
            return take_repair(*repair);
    }

    void forget(const JobId& job) {
        answer(protocol::Refused{protocol::RefusalCode::no_such_job, job, "no such job"});
    }

    void take_submission(const protocol::SubmitJob& submit) {
        ++submissions;
        if (!exists_) {
            exists_ = true;
            state_.job = submit.job;
            state_.scene = scene_hash = submit.scene;
            state_.settings = submit.settings;
            scene_bytes = submit.scene_bytes;
            state_.phase = protocol::JobPhase::waiting_for_scene;
            scene_received.clear();
        }
        answer(state_);
        if (state_.phase == protocol::JobPhase::waiting_for_scene)
            answer(protocol::NeedChunk{scene_hash, scene_received.size()});
    }

    void take_chunk(const protocol::Chunk& chunk) {
        if (!exists_ || state_.phase != protocol::JobPhase::waiting_for_scene ||
            chunk.blob != scene_hash || chunk.offset_bytes != scene_received.size())
            return;
        const Blob& bytes = chunk.blobs.at(0);
        scene_received.insert(scene_received.end(), bytes.begin(), bytes.end());
        if (scene_received.size() < scene_bytes)
            return answer(protocol::NeedChunk{scene_hash, scene_received.size()});
        state_.phase = protocol::JobPhase::queued;
        answer(state_);
    }

    void take_repair(const protocol::Repair& repair) {
        ++repairs;
        if (!exists_ || repair.job != state_.job)
            return forget(repair.job);
        const protocol::Bitmap have(repair.have);
        std::uint32_t sent = 0, left = 0;
        for (const std::uint32_t tile : done_) {
            if (have.test(tile))
                continue;
            if (sent < std::min(repair.tiles_max, plan_.repair_tiles_max)) {
                ++sent;
                answer(tile_done(tile));
            } else {
                ++left;
            }
        }
        answer(protocol::RepairDone{state_, left});
    }

    // ------------------------------------------------------------------------------- the client

    void perform(Core& core, std::vector<Action>& actions) {
        for (std::size_t i = 0; i < actions.size(); ++i) {
            const Action action = actions[i];
            std::visit([this](const auto& a) { perform(a); }, action);
            if (std::exchange(not_sent_, false))
                core.step(now_, NotSent{}, actions);
        }
        actions.clear();
    }
    void to_broker(decltype(ToBroker::what) what) {
        const Instant last = inbox_.empty() ? now_ : inbox_.back().at;
        inbox_.push_back({std::max(last, now_ + delay(faults_.delay_max)), std::move(what)});
    }
    void perform(const Connect&) {
        ++connects;
        welcomed_ = false;
        session_.clear();
        connected_at_ = now_ + delay(faults_.delay_max);
    }
    void perform(const Speak&) { FRAJA_ASSERT(false); } // all here are of one version
    void perform(const Look&) { FRAJA_ASSERT(false); }  // its brokers are given
    void perform(const StopLooking&) {}
    void perform(const OpenStream&) {
        topics_.clear();
        stream_.clear();
    }
    void perform(const Subscribe& s) { to_broker(s); }
    void perform(const Unsubscribe& u) { to_broker(u); }
    void perform(const Send& send) {
        if (now_ < connected_at_)
            not_sent_ = true;
        else if (!parted() && !chance(faults_.session_drop))
            to_broker(send.message);
    }
    void perform(const News& news) {
        if (const auto* accepted = std::get_if<Accepted>(&news)) {
            ++accepted_count;
            delivered.clear();
            states.push_back(accepted->state);
        } else if (const auto* tile = std::get_if<TileArrived>(&news)) {
            const auto index = static_cast<std::uint32_t>(tile->tile.tile);
            ++delivered[index];
            for (const Blob& blob : tile->tile.blobs)
                for (const std::byte byte : blob)
                    pixels_right = pixels_right && byte == static_cast<std::byte>(index);
        } else if (const auto* changed = std::get_if<StateChanged>(&news)) {
            states.push_back(changed->state);
        } else if (const auto* connection = std::get_if<ConnectionChanged>(&news)) {
            lost_count += connection->connected ? 0 : 1;
        } else if (const auto* finished = std::get_if<Finished>(&news)) {
            outcome = finished->outcome;
        }
    }

    FakeJob plan_;
    Faults faults_;
    Rng rng_;
    Instant now_{};
    protocol::JobState state_;
    std::vector<PixelRect> rects_;
    std::set<std::uint32_t> done_;
    bool exists_ = false, welcomed_ = false, not_sent_ = false;
    Instant next_tile_{}, next_digest_{}, connected_at_{};
    std::set<std::string> topics_;
    std::deque<ToClient> session_, stream_; // each in order
    std::deque<ToBroker> inbox_;
};

} // namespace fraja::client
