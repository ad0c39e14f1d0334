// A dispatcher with people around it, for tests: whoever speaks has a name, time passes when told.
#pragma once

#include "broker/dispatcher.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/topics.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace fraja::broker {

inline const Bytes scene_bytes = to_bytes("a scene, as far as a broker knows");
inline const ContentHash scene_hash = protocol::content_hash(scene_bytes);

template <class Id>
Id id_of(std::uint8_t n) {
    Id id;
    id.bytes[15] = n;
    return id;
}

class Farm {
public:
    explicit Farm(Limits those = {}, bool keeps = false)
        : limits(those),
          dispatcher({id_of<BrokerId>(99), 7, "tcp://127.0.0.1:50058", keeps}, those) {}

    // --------------------------------------------------------------------------------- speaking
    void event(const Event& e) {
        std::vector<Action> actions;
        dispatcher.step(now, e, actions);
        for (Action& action : actions)
            take(std::move(action));
    }
    void say(const PeerId& peer, protocol::Message message) {
        event(PeerSaid{peer, std::move(message), {}, spoken_by(peer)});
    }
    [[nodiscard]] protocol::Version spoken_by(const PeerId& peer) const {
        const auto found = versions_spoken.find(peer);
        return found == versions_spoken.end() ? protocol::version : found->second;
    }
    void pass(Duration d) { // in small steps, as a poll loop would
        const Instant end = now + d;
        while (now < end) {
            now = std::min(
                end, std::max(dispatcher.next_deadline(), now + std::chrono::milliseconds(1)));
            event(Tick{});
        }
    }
    void subscribe(const JobId& job) { event(TopicSubscribed{protocol::job_topic(job)}); }

    void worker_arrives(const PeerId& peer, std::uint8_t id, std::uint32_t threads,
                        std::uint32_t credit, std::vector<std::string> tags = {},
                        const Holder& holder = {}) {
        event(PeerSaid{peer,
                       protocol::WorkerHello{.worker = id_of<WorkerId>(id),
                                             .incarnation = 1,
                                             .worker_name = peer,
                                             .threads = threads,
                                             .credit = credit,
                                             .speed_rays_per_s = 0,
                                             .memory_bytes = 0,
                                             .tags = std::move(tags),
                                             .program_version = "test"},
                       holder, spoken_by(peer)});
    }
    void client_arrives(const PeerId& peer) { say(peer, protocol::ClientHello{peer, "test"}); }

    /// A picture of `columns` x 1 tiles of 10x10 pixels.
    static protocol::SubmitJob picture(std::uint8_t id, std::uint32_t columns) {
        protocol::SubmitJob s;
        s.job = id_of<JobId>(id);
        s.job_name = "picture" + std::to_string(id);
        s.scene = scene_hash;
        s.scene_bytes = scene_bytes.size();
        s.settings.size = {10 * columns, 10};
        s.settings.crop = {0, 0, 10 * columns, 10};
        s.tile_side = 10;
        return s;
    }
    /// Likewise, with a share of its tiles drawn twice.
    static protocol::SubmitJob checked(std::uint8_t id, std::uint32_t columns, double verify = 1) {
        protocol::SubmitJob s = picture(id, columns);
        s.wishes.verify = verify;
        return s;
    }
    static protocol::Chunk scene_chunk() {
        return {scene_hash, 0, scene_bytes.size(), {Blob(scene_bytes)}};
    }
    JobId submit(const PeerId& client, const protocol::SubmitJob& submission) {
        if (!clients.contains(client)) {
            client_arrives(client);
            clients.insert(client);
        }
        say(client, submission);
        if (heard<protocol::NeedChunk>(client))
            say(client, scene_chunk());
        forget(client);
        return submission.job;
    }
    JobId submit(std::uint8_t id, std::uint32_t columns) {
        return submit("client", picture(id, columns));
    }

    static protocol::TileRendered answer(const protocol::RenderTile& tile) {
        return {.job = tile.job,
                .tile = tile.tile,
                .attempt = tile.attempt,
                .rays = {tile.rect.pixel_count(), 0, 0, 0},
                .elapsed = std::chrono::milliseconds(5),
                .blobs = {Blob(Bytes(tile.rect.pixel_count() * tile.settings.pixel_bytes()))}};
    }
    void render(const PeerId& peer, const protocol::RenderTile& tile) { say(peer, answer(tile)); }
    /// Whatever it is sent, until it is sent nothing.
    void render_all(const PeerId& peer) {
        for (auto given = tiles(peer); !given.empty(); given = tiles(peer))
            render(peer, given.front());
    }
    void fail(const PeerId& peer, const protocol::RenderTile& tile, protocol::FailureCode code) {
        say(peer, protocol::TileFailed{tile.job, tile.tile, tile.attempt, code, "no luck"});
    }
    void beat(const PeerId& peer, std::uint32_t credit,
              const std::vector<protocol::RenderTile>& tiles, std::uint64_t rays = 0) {
        std::vector<protocol::TileInFlight> in_flight;
        for (const auto& t : tiles)
            in_flight.push_back({t.job, t.tile, t.attempt, rays});
        beat_with(peer, credit, std::move(in_flight));
    }
    void beat_with(const PeerId& peer, std::uint32_t credit,
                   std::vector<protocol::TileInFlight> in_flight) {
        say(peer, protocol::WorkerBeat{credit, std::move(in_flight), received[peer]});
    }

    // ---------------------------------------------------------------------------------- hearing
    template <class M>
    std::vector<M> all(const PeerId& peer) const {
        std::vector<M> result;
        const auto found = sent.find(peer);
        if (found != sent.end())
            for (const protocol::Message& m : found->second)
                if (const auto* message = std::get_if<M>(&m))
                    result.push_back(*message);
        return result;
    }
    template <class M>
    bool heard(const PeerId& peer) const {
        return !all<M>(peer).empty();
    }
    template <class M>
    M last(const PeerId& peer) const {
        const auto messages = all<M>(peer);
        REQUIRE_FALSE(messages.empty());
        return messages.back();
    }
    /// The tiles sent to the peer since the last call.
    std::vector<protocol::RenderTile> tiles(const PeerId& peer) {
        auto result = all<protocol::RenderTile>(peer);
        forget(peer);
        return result;
    }
    template <class M>
    std::vector<M> published(const std::string& topic) const {
        std::vector<M> result;
        for (const Publish& p : stream)
            if (const auto* m = std::get_if<M>(&p.message); m && p.topic == topic)
                result.push_back(*m);
        return result;
    }
    protocol::JobState state(const JobId& job) {
        client_arrives("inspector");
        say("inspector", protocol::FindJob{to_string(job)});
        return last<protocol::JobState>("inspector");
    }
    void forget(const PeerId& peer) { sent.erase(peer); }

    Limits limits;
    Instant now{std::chrono::hours(1)};
    Dispatcher dispatcher;
    std::map<PeerId, std::vector<protocol::Message>> sent;
    std::map<PeerId, std::uint64_t> received;            ///< tiles, by the workers' account
    std::map<PeerId, protocol::Version> versions_spoken; ///< by those who do not speak the newest
    std::vector<Publish> stream;
    std::vector<Persist> persisted;
    std::vector<SendStored> from_store;
    std::vector<LoadScene> scenes_wanted;
    std::vector<OrderFilled> orders_filled;
    std::vector<OrderFailed> orders_failed;
    std::vector<Log> logs;
    std::function<void(const Action&)> on_action; ///< is shown each of them, in their order

private:
    /// Everything must fit on the wire: encode() asserts its limits.
    void take(Action action) {
        if (on_action)
            on_action(action);
        if (const auto* message = std::get_if<Send>(&action))
            (void)protocol::encode(message->message, message->version);
        if (const auto* message = std::get_if<Publish>(&action))
            (void)protocol::encode(message->message, protocol::oldest_version_spoken);
        if (const auto* send = std::get_if<Send>(&action)) {
            if (std::holds_alternative<protocol::Welcome>(send->message))
                received[send->peer] = 0;
            received[send->peer] += std::holds_alternative<protocol::RenderTile>(send->message);
        }
        if (auto* send = std::get_if<Send>(&action))
            sent[send->peer].push_back(std::move(send->message));
        else if (auto* publish = std::get_if<Publish>(&action))
            stream.push_back(std::move(*publish));
        else if (auto* persist = std::get_if<Persist>(&action))
            persisted.push_back(std::move(*persist));
        else if (auto* wish = std::get_if<SendStored>(&action))
            from_store.push_back(std::move(*wish));
        else if (auto* load = std::get_if<LoadScene>(&action))
            scenes_wanted.push_back(*load);
        else if (auto* filled = std::get_if<OrderFilled>(&action))
            orders_filled.push_back(std::move(*filled));
        else if (const auto* failed = std::get_if<OrderFailed>(&action))
            orders_failed.push_back(*failed);
        else if (auto* line = std::get_if<Log>(&action))
            logs.push_back(std::move(*line));
        else // a Fleet's are heard
            REQUIRE((std::holds_alternative<Dial>(action) || std::holds_alternative<Tell>(action)));
    }
    std::set<PeerId> clients;
};

/// A job whose tiles the broker chooses.
inline protocol::SubmitJob automatic(std::uint8_t id, std::uint32_t width, std::uint32_t height) {
    protocol::SubmitJob s = Farm::picture(id, 1);
    s.settings.size = {width, height};
    s.settings.crop = {0, 0, width, height};
    s.tile_side = 0;
    return s;
}

} // namespace fraja::broker
