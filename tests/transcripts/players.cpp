#include "tests/transcripts/players.hpp"

#include "common/base/text.hpp"
#include "tests/transcripts/enum_names.hpp"
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
    if (!farm_) {
        farm_.emplace();
        farm_->on_action = [this](const Action& action) { notice(action); };
    }
    return *farm_;
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
    farm_.emplace(limits, keeps);
    farm_->on_action = [this](const Action& action) { notice(action); };
}

void Players::worker(Words& words) {
    const std::string name = words.next("a worker's name");
    Worker worker;
    worker.threads = words.number("threads", 1);
    worker.credit = words.number("credit", worker.threads);
    words.end();
    const auto known = workers_.find(name);
    worker.id =
        known != workers_.end() ? known->second.id : static_cast<std::uint8_t>(workers_.size() + 1);
    worker.beats_at = farm().now + 1s;
    workers_[name] = worker;
    farm().worker_arrives(name, worker.id, worker.threads, worker.credit);
}

void Players::client(Words& words) {
    const std::string name = words.next("a client's name");
    words.end();
    clients_[name] = {.beats_at = farm().now + 1s};
    farm().client_arrives(name);
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
    farm().beat(name, worker.credit, std::move(tiles));
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

// ------------------------------------------------------------------------------ what is to be done

void Players::submit(Words& words) {
    const std::string name = next_client(words);
    const std::uint32_t id = words.number("job");
    SubmitJob submission = Farm::picture(static_cast<std::uint8_t>(id), words.number("tiles"));
    submission.priority = static_cast<std::int32_t>(words.number("priority", 0));
    words.end();
    farm().say(name, submission);
}

void Players::scene(Words& words) {
    const std::string name = next_client(words);
    words.end();
    farm().say(name, Farm::scene_chunk());
}

void Players::control(Words& words) {
    const std::string name = next_client(words);
    const std::string deed = words.next("what is to be done");
    if (const auto of_job = enumerator_named<JobDeed>(deed)) {
        const ControlJob message{job_of(words), *of_job,
                                 static_cast<std::int32_t>(words.number("priority", 0))};
        words.end();
        return farm().say(name, message);
    }
    const auto of_worker = enumerator_named<WorkerDeed>(deed);
    if (!of_worker)
        throw BadCommand("nobody can '" + deed + "' a job or a worker");
    const ControlWorker message{words.text("worker"), *of_worker};
    words.end();
    farm().say(name, message);
}

void Players::find(Words& words) {
    const std::string name = next_client(words);
    const JobId job = job_of(words);
    words.end();
    farm().say(name, FindJob{to_string(job)});
}

void Players::repair(Words& words) {
    const std::string name = next_client(words);
    const JobId job = job_of(words);
    words.end();
    farm().say(name, Repair{job, farm().limits.repair_tiles_max, {}});
}

void Players::watch(Words& words) {
    const bool all = words.next_is("farm");
    const std::string topic = all ? std::string(farm_topic) : job_topic(job_of(words));
    words.end();
    farm().event(TopicSubscribed{topic});
}

// ------------------------------------------------------------------------------------ what is done

void Players::render(Words& words) {
    const std::string name = words.next("a worker's name");
    const TileRendered answer = Farm::answer(take_tile(name, words));
    worker_of(name).last_answer = answer;
    farm().say(name, answer);
}

void Players::fail(Words& words) {
    const std::string name = words.next("a worker's name");
    const std::string what = words.next("machine, scene or cancelled");
    const auto code = enumerator_named<FailureCode>(what);
    if (!code)
        throw BadCommand("a tile does not fail by '" + what + "'");
    farm().fail(name, take_tile(name, words), *code);
}

void Players::again(Words& words) {
    const std::string name = words.next("a worker's name");
    words.end();
    const auto& answer = worker_of(name).last_answer;
    if (!answer)
        throw BadCommand("worker '" + name + "' has answered nothing yet");
    farm().say(name, *answer);
}

void Players::stored(Words& words) {
    if (farm().persisted.empty())
        throw BadCommand("there is nothing to be kept");
    const std::uint64_t last = farm().persisted.back().sequence;
    const std::uint64_t to = words.has("to") ? words.number("to") : last;
    words.end();
    if (to > last)
        throw BadCommand("no more than " + std::to_string(last) + " is to be kept");
    farm().event(Stored{to});
}

void Players::trouble(Words& words) {
    farm().event(StoreFails{words.rest()});
}

void Players::recovered(Words& words) {
    words.end();
    farm().event(StoreWorks{});
}

// ------------------------------------------------------------------------------------ who is meant

Players::Worker& Players::worker_of(const std::string& name) {
    const auto found = workers_.find(name);
    if (found == workers_.end())
        throw BadCommand("there is no worker '" + name + "'");
    return found->second;
}

std::string Players::next_client(Words& words) {
    std::string name = words.next("a client's name");
    if (!clients_.contains(name))
        throw BadCommand("there is no client '" + name + "'");
    return name;
}

JobId Players::job_of(Words& words) {
    return id_of<JobId>(static_cast<std::uint8_t>(words.number("job")));
}

/// The oldest that it has; with tile= the oldest one of that number.
RenderTile Players::take_tile(const std::string& name, Words& words) {
    std::vector<RenderTile>& tiles = worker_of(name).tiles;
    auto tile = tiles.begin();
    if (words.has("tile"))
        tile = std::ranges::find(tiles, TileIndex{words.number("tile")}, &RenderTile::tile);
    words.end();
    if (tile == tiles.end())
        throw BadCommand("worker '" + name + "' has no such tile");
    RenderTile taken = *tile;
    tiles.erase(tile);
    return taken;
}

} // namespace fraja::broker
