// Drives a Crew by hand, as session_driver.hpp does a Session.
#pragma once

#include "tests/worker/session_driver.hpp"
#include "worker/crew.hpp"

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace fraja::worker {

inline BrokerId broker_id(std::uint8_t number) {
    BrokerId id;
    id.bytes[0] = number;
    return id;
}

/// The broker of that number, at its endpoint.
inline std::string endpoint_of(std::uint8_t number) {
    return "tcp://broker" + std::to_string(number) + ":50057";
}

inline std::vector<protocol::Member> members(const std::vector<std::uint8_t>& numbers) {
    std::vector<protocol::Member> all;
    for (const std::uint8_t number : numbers)
        all.push_back({broker_id(number), endpoint_of(number)});
    return all;
}

inline protocol::Term term(std::uint64_t counter, std::uint8_t leader = 1) {
    return {counter, broker_id(leader)};
}

inline protocol::Welcome welcome_of(std::uint8_t broker, std::vector<protocol::Member> list = {},
                                    const protocol::Term& greatest = {}) {
    protocol::Welcome message = welcome();
    message.broker = broker_id(broker);
    message.brokers = std::move(list);
    message.term = greatest;
    return message;
}

inline SessionIndex session(std::uint32_t number) {
    return SessionIndex{number};
}

class CrewDriver {
public:
    /// Of a worker that was told to serve the brokers 1, 2 ...; of none: those that are found.
    explicit CrewDriver(std::uint8_t given_count = 1, Identity identity = test_identity(),
                        const Limits& limits = {})
        : crew({.identity = std::move(identity),
                .endpoints = given(given_count),
                .is_looking = given_count == 0,
                .first = {},
                .limits = limits}) {}

    /// The actions of one step, and of the tick that it makes due. A Welcome without an incarnation
    /// answers the last hello.
    std::vector<CrewAction> step(CrewEvent event) {
        if (auto* of_session = std::get_if<SessionEvent>(&event))
            if (auto* received = std::get_if<Received>(&of_session->event))
                if (auto* welcome = std::get_if<protocol::Welcome>(&received->message);
                    welcome && welcome->incarnation == 0)
                    welcome->incarnation = incarnations[of_session->session];
        std::vector<CrewAction> actions;
        crew.step(now, event, actions);
        if (crew.next_deadline() <= now)
            crew.step(now, CrewTick{}, actions);
        for (const CrewAction& action : actions)
            if (const auto* send = std::get_if<Send>(&action.deed))
                if (const auto* hello = std::get_if<protocol::WorkerHello>(&send->message))
                    incarnations[action.session] = hello->incarnation;
        return actions;
    }
    std::vector<CrewAction> step(std::uint32_t of, Event event) {
        return step(SessionEvent{session(of), std::move(event)});
    }
    std::vector<CrewAction> receive(std::uint32_t of, protocol::Message message) {
        return step(of, Received{std::move(message)});
    }
    std::vector<CrewAction> pass(Duration duration) {
        now = now + duration;
        return step(CrewTick{});
    }
    /// The brokers of these sessions answer everything from now on, for so long.
    std::vector<CrewAction> pass_with_beats(Duration duration,
                                            const std::vector<std::uint32_t>& of) {
        std::vector<CrewAction> all;
        const auto append = [&](std::vector<CrewAction> actions) {
            std::ranges::move(actions, std::back_inserter(all));
        };
        for (const Instant end = now + duration; now < end;) {
            append(pass(std::chrono::milliseconds(500)));
            for (const std::uint32_t number : of)
                append(receive(number, protocol::Beat{}));
        }
        return all;
    }

    Instant now{std::chrono::hours(1)};
    std::map<SessionIndex, std::uint64_t> incarnations; ///< of the last hellos
    Crew crew;

private:
    static std::vector<std::string> given(std::uint8_t count) {
        std::vector<std::string> endpoints;
        for (std::uint8_t number = 1; number <= count; ++number)
            endpoints.push_back(endpoint_of(number));
        return endpoints;
    }
};

/// The deeds of that session that are a D.
template <class D>
std::vector<D> of_type(const std::vector<CrewAction>& actions, std::uint32_t of) {
    std::vector<D> found;
    for (const CrewAction& action : actions)
        if (const auto* deed = std::get_if<D>(&action.deed); deed && action.session == session(of))
            found.push_back(*deed);
    return found;
}

/// The messages of type M that were sent by that session.
template <class M>
std::vector<M> sent(const std::vector<CrewAction>& actions, std::uint32_t by) {
    std::vector<M> found;
    for (const Send& send : of_type<Send>(actions, by))
        if (const auto* m = std::get_if<M>(&send.message))
            found.push_back(*m);
    return found;
}

/// Serves the brokers 1 and 2 by the sessions 0 and 1, and has a scene of each.
struct Pair : CrewDriver {
    TestScene scene{100};
    /// `are_one_farm`: each names the other.
    explicit Pair(bool are_one_farm = true, const protocol::Term& greatest = {}) : CrewDriver(2) {
        list = are_one_farm ? members({1, 2}) : std::vector<protocol::Member>{};
        (void)step(CrewTick{});
        for (std::uint8_t number = 1; number <= 2; ++number)
            (void)receive(number - 1u, welcome_of(number, list, greatest));
        for (std::uint32_t of = 0; of < 2; ++of) {
            protocol::RenderTile first = order(scene, 100 + of);
            first.term = greatest;
            (void)receive(of, first);
            (void)receive(of, scene.chunk(0));
            const auto actions = step(of, SceneCompiled{scene.hash});
            (void)step(of, TileFinished{of_type<StartTile>(actions, of).at(0).ticket, {}, {}, {}});
        }
    }
    /// The broker of session `of` gives a tile, which starts.
    Ticket give(std::uint32_t of, std::uint32_t tile) {
        protocol::RenderTile message = order(scene, tile, ++attempts);
        message.term = at;
        return of_type<StartTile>(receive(of, message), of).at(0).ticket;
    }
    /// Session `of` loses its broker, which speaks no more or has forgotten the worker.
    std::vector<CrewAction> lose(std::uint32_t of) {
        return receive(of, protocol::Refused{protocol::RefusalCode::unknown_peer, {}, "who?"});
    }

    std::vector<protocol::Member> list;
    protocol::Term at; ///< of the tiles that are given
    std::uint32_t attempts = 1000;
};

} // namespace fraja::worker
