#include "tests/transcripts/players.hpp"

#include "common/base/text.hpp"
#include "tests/transcripts/printing.hpp"

#include <algorithm>
#include <utility>

namespace fraja::broker {

using namespace protocol;
using namespace std::chrono_literals;

const std::map<std::string_view, Players::Deed> Players::deeds = {
    {"broker", &Players::broker},   {"worker", &Players::worker},
    {"client", &Players::client},   {"leave", &Players::leave},
    {"silent", &Players::silent},   {"unreachable", &Players::unreachable},
    {"hang", &Players::hang},       {"wake", &Players::wake},
    {"beat", &Players::beat},       {"pass", &Players::pass},
    {"submit", &Players::submit},   {"scene", &Players::scene},
    {"control", &Players::control}, {"find", &Players::find},
    {"repair", &Players::repair},   {"watch", &Players::watch},
    {"render", &Players::render},   {"fail", &Players::fail},
    {"again", &Players::again},     {"stored", &Players::stored},
    {"trouble", &Players::trouble}, {"recovered", &Players::recovered},
    {"unwatch", &Players::unwatch},
};

std::vector<std::string> Players::perform(std::string_view command) {
    Words words(command);
    const std::string name = words.next("a command");
    const auto deed = deeds.find(name);
    if (deed == deeds.end())
        throw BadCommand("there is no command '" + name + "'");
    (this->*deed->second)(words);
    return std::exchange(lines_, {});
}

Farm& Players::farm() {
    if (!farm_)
        start({}, false);
    return *farm_;
}

void Players::start(const Limits& limits, bool keeps) {
    farm_.emplace(limits, keeps);
    farm_->on_action = [this](const Action& action) { notice(action); };
}

/// A line of it; and workers take their tiles.
void Players::notice(const Action& action) {
    const auto* send = std::get_if<Send>(&action);
    if (const auto to = send ? workers_.find(send->peer) : workers_.end(); to != workers_.end()) {
        if (const auto* tile = std::get_if<RenderTile>(&send->message))
            to->second.tiles.push_back(*tile);
        if (std::holds_alternative<Dismissed>(send->message))
            to->second.silent = true;
    }
    if (beats_by_itself_ && send && std::holds_alternative<Beat>(send->message))
        return;
    std::string line = printed(action);
    if (passing_since_)
        line = "+" + printed(farm_->now - *passing_since_) + " " + line;
    lines_.push_back(std::move(line));
}

// ------------------------------------------------------------------------------------ who is there

void Players::broker(Words& words) {
    if (farm_)
        throw BadCommand("the broker is there already");
    const bool keeps = words.next_is("store");
    Limits limits;
    limits.attempts_max = words.number("attempts_max", limits.attempts_max);
    if (words.has("quarantine")) {
        const auto window = parse_duration(words.text("quarantine"));
        if (!window)
            throw BadCommand("quarantine takes a duration");
        limits.quarantine_window = *window;
    }
    words.end();
    start(limits, keeps);
}

void Players::worker(Words& words) {
    const std::string name = words.next("a worker's name");
    Worker worker;
    worker.threads = words.number("threads", 1);
    worker.credit = words.number("credit", worker.threads);
    if (!is_understood(name, words))
        return;
    const auto known = workers_.find(name);
    worker.id =
        known != workers_.end() ? known->second.id : static_cast<std::uint8_t>(workers_.size() + 1);
    worker.beats_at = farm().now + 1s;
    workers_[name] = worker;
    farm().worker_arrives(name, worker.id, worker.threads, worker.credit);
}

void Players::client(Words& words) {
    const std::string name = words.next("a client's name");
    if (!is_understood(name, words))
        return;
    clients_[name] = {.beats_at = farm().now + 1s};
    farm().client_arrives(name);
}

/// Or else the broker has heard what it makes of such a hello.
bool Players::is_understood(const std::string& name, Words& words) {
    const auto spoken = static_cast<protocol::Version>(words.number("version", protocol::version));
    words.end();
    farm().versions_spoken[name] = spoken;
    if (protocol::is_spoken(spoken))
        return true;
    protocol::Packet hello = protocol::encode(protocol::ClientHello{});
    hello.header[4] = static_cast<std::byte>(spoken);
    const Blob frames[] = {Blob(hello.header), Blob(hello.body)};
    farm().event(PeerSpokeRubbish{name, protocol::decode(frames).error(), spoken});
    return false;
}

void Players::leave(Words& words) {
    const std::string name = words.next("who leaves");
    words.end();
    if (clients_.erase(name) == 0) {
        worker_of(name).silent = true;
        worker_of(name).tiles.clear();
    }
    farm().say(name, Goodbye{});
}

void Players::unreachable(Words& words) {
    const std::string name = words.next("whose connection is gone");
    words.end();
    if (clients_.erase(name) == 0)
        worker_of(name).silent = true;
    farm().event(PeerUnreachable{name});
}

void Players::silent(Words& words) {
    const std::string name = words.next("who is silent");
    words.end();
    if (const auto found = clients_.find(name); found != clients_.end())
        found->second.silent = true;
    else
        worker_of(name).silent = true;
}

void Players::hang(Words& words) {
    worker_of(words.next("a worker's name")).hangs = true;
    words.end();
}

void Players::wake(Words& words) {
    Worker& sleeper = worker_of(words.next("a worker's name"));
    words.end();
    sleeper.hangs = sleeper.silent = false;
    sleeper.beats_at = farm().now;
}

void Players::beat(Words& words) {
    const std::string name = words.next("a worker's name");
    Worker& beating = worker_of(name);
    beating.credit = words.number("credit", beating.credit);
    words.end();
    send_beat(name, beating);
}

/// Its threads are at the oldest of its tiles; the others wait.
void Players::send_beat(const std::string& name, Worker& worker) {
    if (!worker.hangs)
        ++worker.rays;
    std::vector<TileInFlight> tiles;
    for (const RenderTile& tile : worker.tiles)
        tiles.push_back(
            {tile.job, tile.tile, tile.attempt, tiles.size() < worker.threads ? worker.rays : 0});
    farm().beat_with(name, worker.credit, std::move(tiles));
}

Instant Players::next_beat() {
    Instant next = Instant::never();
    for (const auto& [name, worker] : workers_)
        if (!worker.silent)
            next = std::min(next, worker.beats_at);
    for (const auto& [name, client] : clients_)
        if (!client.silent)
            next = std::min(next, client.beats_at);
    return next;
}

void Players::beat_all_that_are_due() {
    beats_by_itself_ = true;
    for (auto& [name, worker] : workers_)
        if (!worker.silent && worker.beats_at <= farm().now) {
            worker.beats_at = farm().now + 1s;
            send_beat(name, worker);
        }
    for (auto& [name, client] : clients_)
        if (!client.silent && client.beats_at <= farm().now) {
            client.beats_at = farm().now + 1s;
            farm().say(name, Beat{});
        }
    beats_by_itself_ = false;
}

/// As a poll loop would: it wakes at whole milliseconds.
void Players::pass(Words& words) {
    const auto duration = parse_duration(words.next("a duration"));
    words.end();
    if (!duration)
        throw BadCommand("pass takes a duration, as 250ms or 3s");
    passing_since_ = farm().now;
    const Instant end = farm().now + *duration;
    while (farm().now < end) {
        const Instant deadline{std::chrono::ceil<std::chrono::milliseconds>(
            farm().dispatcher.next_deadline().since_start)};
        const Instant tick = std::max(deadline, farm().now + 1ms);
        farm().now = std::min({tick, end, std::max(next_beat(), farm().now)});
        beat_all_that_are_due();
        if (farm().now == tick)
            farm().event(Tick{});
    }
    passing_since_.reset();
}

// ------------------------------------------------------------------------------------ who is meant

Players::Worker& Players::worker_of(const std::string& name) {
    const auto found = workers_.find(name);
    if (found == workers_.end())
        throw BadCommand("there is no worker '" + name + "'");
    return found->second;
}

std::string Players::next_client(Words& words) const {
    std::string name = words.next("a client's name");
    if (!clients_.contains(name))
        throw BadCommand("there is no client '" + name + "'");
    return name;
}

JobId Players::job_of(Words& words) {
    const std::uint32_t id = words.number("job");
    if (id == 0 || id > UINT8_MAX)
        throw BadCommand("jobs are numbered from 1 to 255");
    return id_of<JobId>(static_cast<std::uint8_t>(id));
}

std::string Players::topic_of(Words& words) {
    const bool is_farm = words.next_is("farm");
    std::string topic = is_farm ? std::string(farm_topic) : job_topic(job_of(words));
    words.end();
    return topic;
}

} // namespace fraja::broker
