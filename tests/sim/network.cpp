#include "tests/sim/network.hpp"

#include "common/protocol/codec.hpp"

#include <algorithm>
#include <utility>
#include <variant>

namespace fraja::sim {

using namespace std::chrono_literals;

namespace {

constexpr std::uint32_t hurries_max = 1'000;

/// A connection that is silent for so long is given up by ZeroMQ (net/sockets.cpp).
constexpr Duration connection_patience = 30s;

std::uint64_t bytes_of(const protocol::Message& message) {
    const protocol::Packet packet = protocol::encode(message);
    std::uint64_t bytes = packet.header.size() + packet.body.size();
    for (const Blob& blob : packet.blobs)
        bytes += blob.size();
    return bytes;
}

Duration service_of(const ServiceTimes& times, const protocol::Message& heard) {
    if (std::holds_alternative<protocol::WorkerBeat>(heard))
        return times.beat;
    const auto* answer = std::get_if<protocol::TileRendered>(&heard);
    if (!answer)
        return {};
    std::uint64_t pixel_bytes = 0;
    for (const Blob& blob : answer->blobs)
        pixel_bytes += blob.size();
    return times.answer +
           from_seconds(seconds(times.mib) * static_cast<double>(pixel_bytes) / (1 << 20));
}

void note(Traffic& traffic, const protocol::Message& heard) {
    ++traffic.heard;
    traffic.beats += std::holds_alternative<protocol::WorkerBeat>(heard);
    if (const auto* answer = std::get_if<protocol::TileRendered>(&heard)) {
        ++traffic.answers;
        for (const Blob& blob : answer->blobs)
            traffic.pixel_bytes += blob.size();
    }
}

} // namespace

// ------------------------------------------------------------------------------------- processes

void Network::begin_life(Process& process) {
    ++process.life;
    process.running = true;
    process.frozen_until = farm_.now();
}

void Network::end_life(Process& process) {
    process.running = false;
    ++process.life;
    process.backlog.clear();
    process.deadline = process.planned = Instant::never();
}

void Network::thaw_when_due(Process& process) {
    farm_.agenda.at(process.frozen_until, [this, &process, life = process.life] {
        while (process.life == life && !process.backlog.empty()) {
            if (farm_.now() < process.frozen_until)
                return thaw_when_due(process);
            Deed deed = std::move(process.backlog.front());
            deed();
            if (process.life == life) // and last: what comes meanwhile goes behind
                process.backlog.pop_front();
        }
    });
}

void Network::be_busy(Duration service) {
    if (service <= Duration::zero())
        return;
    traffic_.busy += service;
    broker_.frozen_until = std::max(broker_.frozen_until, farm_.now() + service);
}

// Deadlines move with every step: so one tick is planned, and looks again when it comes too soon.
void Network::wake(Process& process, Instant deadline) {
    if (deadline > farm_.now())
        process.hurries = 0;
    else if (process.backlog.empty() && ++process.hurries == hurries_max) // it does tick, that is
        farm_.violation("a program's deadline is over again and again: it spins");
    process.deadline =
        deadline == Instant::never() ? deadline : std::max(deadline, farm_.now() + 1us);
    if (process.deadline < process.planned)
        plan_tick(process, process.deadline);
}

void Network::plan_tick(Process& process, Instant when) {
    process.planned = when;
    farm_.agenda.at(when, [this, &process, when, life = process.life] {
        if (process.life != life || process.planned != when)
            return;
        process.planned = Instant::never();
        if (process.deadline == Instant::never())
            return;
        if (process.deadline > when)
            return plan_tick(process, process.deadline);
        process.deadline = Instant::never();
        in_process(process, [&process] { process.tick(); });
    });
}

// ----------------------------------------------------------------------------------------- lines

Traffic Network::traffic() const {
    Traffic traffic = traffic_;
    traffic.connections = lines_.size();
    return traffic;
}

Instant Network::arrival(const Line& line, Instant& last, Instant sent) {
    last = std::max({last, sent + farm_.delay(), line.silent_until});
    return last;
}

void Network::connect(Line& line) {
    if (!std::exchange(line.known, true))
        known_.push_back(&line);
    const std::uint64_t life = line.owner.life, generation = ++line.generation;
    line.wanted = true;
    line.up = false;
    const Duration delay = farm_.delay() + (line.pipe ? line.pipe->delay() : Duration::zero());
    farm_.agenda.after(delay, [this, &line, life, generation] {
        if (!line.owner.running || line.owner.life != life || line.generation != generation)
            return;
        if (!broker_.running || farm_.now() < line.silent_until)
            return farm_.agenda.after(100ms, [this, &line, life, generation] {
                if (line.owner.life == life && line.generation == generation)
                    connect(line);
            });
        line.up = true;
        line.to_broker = line.to_node = farm_.now();
        line.peer = "peer " + std::to_string(++peers_);
        lines_[line.peer] = {&line, generation};
        if (line.reconnected)
            line.reconnected();
    });
}

void Network::disconnect(Line& line) {
    if (line.up)
        lines_.erase(line.peer);
    line.wanted = line.up = false;
    ++line.generation;
}

void Network::break_line(Line& line) {
    if (!line.owner.running || !line.wanted)
        return;
    disconnect(line);
    connect(line);
}

void Network::silence(Line& line, Instant until) {
    line.silent_until = std::max(line.silent_until, until);
    if (until - farm_.now() > connection_patience)
        break_line(line);
}

void Network::break_all_lines() {
    for (std::size_t i = 0; i < known_.size(); ++i)
        break_line(*known_[i]);
}

template <class F>
void Network::plan_arrival(Instant when, protocol::Message&& message, F arrive) {
    const auto lag = farm_.duplicate_lag();
    if (lag)
        farm_.agenda.at(when + *lag, [arrive, again = message]() mutable { arrive(again); });
    farm_.agenda.at(when, [arrive, message = std::move(message)]() mutable { arrive(message); });
}

bool Network::to_broker(Line& line, protocol::Message& message) {
    if (!line.up)
        return false;
    line.hellos_said += std::holds_alternative<protocol::WorkerHello>(message);
    const Instant sent = line.pipe ? line.pipe->up(farm_.now(), bytes_of(message)) : farm_.now();
    plan_arrival(arrival(line, line.to_broker, sent), std::move(message),
                 [this, &line, generation = line.generation, hellos = line.hellos_said,
                  peer = line.peer](protocol::Message& arrived) {
                     if (line.generation != generation || hellos < line.hellos_heard)
                         return;
                     line.hellos_heard = hellos;
                     note(traffic_, arrived);
                     in_process(broker_, [this, peer, arrived = std::move(arrived)]() mutable {
                         const Duration service = service_of(farm_.scenario.service, arrived);
                         broker_hears(std::move(peer), std::move(arrived));
                         be_busy(service);
                     });
                 });
    return true;
}

bool Network::to_node(const broker::PeerId& peer, protocol::Message&& message) {
    const auto found = lines_.find(peer);
    if (found == lines_.end())
        return false;
    Line& line = *found->second.first;
    ++traffic_.said;
    const Instant sent = line.pipe ? line.pipe->down(farm_.now(), bytes_of(message)) : farm_.now();
    plan_arrival(arrival(line, line.to_node, sent), std::move(message),
                 [this, &line, generation = found->second.second](protocol::Message& arrived) {
                     if (line.generation == generation && line.up)
                         in_process(line.owner, [&line, socket = line.socket,
                                                 arrived = std::move(arrived)]() mutable {
                             if (line.socket == socket)
                                 line.hear(std::move(arrived));
                         });
                 });
    return true;
}

void cut_off(const std::set<const Process*>& group, const std::vector<Node>& nodes, Instant until) {
    for (const auto& [line, network] : nodes)
        if (group.contains(&line->owner) != group.contains(&network->broker()))
            network->silence(*line, until);
}

void cut_apart(const Process& one, const Process& other, const std::vector<Node>& nodes,
               Instant until) {
    for (const auto& [line, network] : nodes)
        if ((&line->owner == &one && &network->broker() == &other) ||
            (&line->owner == &other && &network->broker() == &one))
            network->silence(*line, until);
}

} // namespace fraja::sim
