// Players: what they want to be done, and what becomes of it.
#include "tests/transcripts/enum_names.hpp"
#include "tests/transcripts/players.hpp"

#include <algorithm>
#include <optional>

namespace fraja::broker {

using namespace protocol;

// ------------------------------------------------------------------------------ what is to be done

void Players::submit(Words& words) {
    const std::string name = next_client(words);
    const JobId job = job_of(words);
    SubmitJob submission = Farm::picture(job.bytes.back(), words.number("tiles"));
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
    farm().event(TopicSubscribed{topic_of(words)});
}

void Players::unwatch(Words& words) {
    farm().event(TopicUnsubscribed{topic_of(words)});
}

// ------------------------------------------------------------------------------------ what is done

/// The oldest that it has, of those that the line means.
RenderTile Players::take_tile(const std::string& name, Words& words) {
    std::vector<RenderTile>& tiles = worker_of(name).tiles;
    std::optional<JobId> job;
    std::optional<TileIndex> index;
    if (words.has("job"))
        job = job_of(words);
    if (words.has("tile"))
        index = TileIndex{words.number("tile")};
    const auto tile = std::ranges::find_if(tiles, [&](const RenderTile& t) {
        return t.job == job.value_or(t.job) && t.tile == index.value_or(t.tile);
    });
    words.end();
    if (tile == tiles.end())
        throw BadCommand("worker '" + name + "' has no such tile");
    RenderTile taken = *tile;
    tiles.erase(tile);
    return taken;
}

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

} // namespace fraja::broker
