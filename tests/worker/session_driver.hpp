// Drives a Session by hand: its time, its events, and what it said.
#pragma once

#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "worker/session.hpp"

#include <algorithm>
#include <chrono>
#include <iterator>
#include <string>
#include <vector>

namespace fraja::worker {

inline JobId job_id(std::uint8_t number) {
    JobId id;
    id.bytes[0] = number;
    return id;
}

inline Identity test_identity(std::uint32_t threads = 2) {
    Identity identity{.worker = {}, .name = "tester", .threads = threads, .tags = {"fast", "os=x"}};
    identity.worker.bytes[3] = 7;
    return identity;
}

inline protocol::Welcome welcome() {
    return {.broker = {},
            .epoch = 1,
            .heartbeat = std::chrono::seconds(1),
            .liveness = 3,
            .stream = "tcp://127.0.0.1:1",
            .program_version = "0.0.1"};
}

/// The scene that consists of `size` bytes, all the same.
struct TestScene {
    Bytes bytes;
    ContentHash hash;
    std::vector<Blob> pieces; ///< cut as chunks are; at least one
    explicit TestScene(std::size_t size, char filling = 's')
        : bytes(size, static_cast<std::byte>(filling)), hash(protocol::content_hash(bytes)) {
        do {
            const std::size_t at = pieces.size() * protocol::chunk_bytes;
            pieces.push_back(Blob(Bytes(std::min(protocol::chunk_bytes, size - at),
                                        static_cast<std::byte>(filling))));
        } while (pieces.size() * protocol::chunk_bytes < size);
    }

    /// `offset` as in NeedChunk.
    [[nodiscard]] protocol::Chunk chunk(std::uint64_t offset) const {
        return {.blob = hash,
                .offset_bytes = offset,
                .total_bytes = bytes.size(),
                .blobs = {pieces.at(offset / protocol::chunk_bytes)}};
    }
};

/// The attempt is that of a broker that gives out tile after tile, unless it is named.
inline protocol::RenderTile order(const TestScene& scene, std::uint32_t tile,
                                  std::uint32_t attempt = 0, std::uint8_t job = 1) {
    return {.job = job_id(job),
            .tile = TileIndex{tile},
            .attempt = AttemptNumber{attempt > 0 ? attempt : tile + 1},
            .frame = 0,
            .rect = {0, 0, 16, 16},
            .scene = scene.hash,
            .scene_bytes = scene.bytes.size(),
            .settings = {}};
}

class SessionDriver {
public:
    explicit SessionDriver(Identity identity = test_identity(), const Limits& limits = {})
        : session(std::move(identity), limits) {}

    /// The actions of one step, and of the Tick that it makes due.
    /// A Welcome without an incarnation answers the last hello.
    std::vector<Action> step(Event event) {
        if (auto* received = std::get_if<Received>(&event))
            if (auto* welcome = std::get_if<protocol::Welcome>(&received->message);
                welcome && welcome->incarnation == 0)
                welcome->incarnation = incarnation;
        std::vector<Action> actions;
        session.step(now, event, actions);
        if (session.next_deadline() <= now)
            session.step(now, Tick{}, actions);
        for (const Action& action : actions)
            if (const auto* send = std::get_if<Send>(&action))
                if (const auto* hello = std::get_if<protocol::WorkerHello>(&send->message))
                    incarnation = hello->incarnation;
        return actions;
    }
    std::vector<Action> receive(protocol::Message message) {
        return step(Received{std::move(message)});
    }
    std::vector<Action> pass(Duration duration) {
        now = now + duration;
        return step(Tick{});
    }
    /// Says hello and is welcomed.
    void connect() {
        (void)step(Tick{});
        (void)receive(welcome());
    }
    /// The broker answers everything from now on, for so long.
    std::vector<Action> pass_with_beats(Duration duration) {
        std::vector<Action> all;
        const auto append = [&](std::vector<Action> actions) {
            std::ranges::move(actions, std::back_inserter(all));
        };
        for (const Instant end = now + duration; now < end;) {
            append(pass(std::chrono::milliseconds(500)));
            append(receive(protocol::Beat{}));
        }
        return all;
    }

    Instant now{std::chrono::hours(1)};
    std::uint64_t incarnation = 0; ///< of the last hello
    Session session;
};

/// The actions that are an A.
template <class A>
std::vector<A> of_type(const std::vector<Action>& actions) {
    std::vector<A> found;
    for (const Action& action : actions)
        if (const auto* a = std::get_if<A>(&action))
            found.push_back(*a);
    return found;
}

/// The messages of type M that were sent.
template <class M>
std::vector<M> sent(const std::vector<Action>& actions) {
    std::vector<M> found;
    for (const Action& action : actions)
        if (const auto* send = std::get_if<Send>(&action))
            if (const auto* m = std::get_if<M>(&send->message))
                found.push_back(*m);
    return found;
}

/// Connected, with a compiled scene of one chunk.
struct Ready : SessionDriver {
    TestScene scene{100};
    Ready() {
        connect();
        (void)receive(order(scene, 0));
        (void)receive(scene.chunk(0));
        const auto actions = step(SceneCompiled{scene.hash});
        (void)step(TileFinished{of_type<StartTile>(actions).at(0).ticket, {}, {}, {}});
    }
};

/// Of the one tile that was answered so: whose fault it is, and why.
inline std::string failure(const std::vector<Action>& actions) {
    const auto failed = sent<protocol::TileFailed>(actions);
    if (failed.size() != 1)
        return std::to_string(failed.size()) + " failures";
    const char* names[] = {"scene: ", "machine: ", "cancelled: "};
    return names[static_cast<int>(failed[0].code)] + failed[0].reason;
}

} // namespace fraja::worker
