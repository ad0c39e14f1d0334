// Who plays with the broker's core in a transcript: workers, clients and a store, each of which
// does what a line tells it to, and a clock that stands still but for `pass`.
//
//     broker store attempts_max=2   the first, if at all: with a store, with other limits
//     worker a threads=1 credit=2   arrives, or comes back; version=11: and speaks that one
//     client c                      likewise
//     submit c job=1 tiles=4        a picture of 4x1 tiles of 10x10 pixels; priority=N
//     scene c                       sends the scene, the same for all pictures
//     render a                      answers the oldest tile that it has; job=1 tile=2 that one
//     fail a machine                likewise; scene or cancelled
//     again a                       sends its last pixels once more
//     beat a credit=2               by hand
//     leave a, unreachable a        says goodbye; its connection is gone
//     silent a, hang a, wake a      in `pass` it beats no more; beats and traces nothing; does both
//     pass 3s                       workers and clients beat each second, the core ticks when it
//                                   wants to. Answers to these beats are not shown.
//     control c cancel job=1        pause, resume, retry, set_priority priority=N
//     control c drain worker=a      undrain, kick
//     find c job=1, repair c job=1  asks for a job's state; for the tiles of it
//     watch job=1, watch farm       somebody subscribes to the stream
//     unwatch farm                  and nobody does any more
//     stored                        all is kept that was to be; to=N up to there
//     trouble the disk is full      nothing can be kept now
//     recovered                     it can again
#pragma once

#include "tests/broker/farm.hpp"
#include "tests/transcripts/words.hpp"

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::broker {

class Players {
public:
    /// What the core does about it, an action a line. BadCommand: it cannot be done.
    std::vector<std::string> perform(std::string_view command);

private:
    struct Worker {
        std::uint8_t id = 0;
        std::uint32_t threads = 1, credit = 1;
        std::vector<protocol::RenderTile> tiles; ///< not answered, the oldest first
        std::optional<protocol::TileRendered> last_answer;
        bool silent = false, hangs = false;
        Instant beats_at;
        std::uint64_t rays = 0; ///< of each tile that is being rendered
    };
    struct Client {
        Instant beats_at;
        bool silent = false;
    };
    using Deed = void (Players::*)(Words&);
    static const std::map<std::string_view, Deed> deeds;

    // who is there
    void broker(Words& words);
    void worker(Words& words);
    void client(Words& words);
    void leave(Words& words);
    void unreachable(Words& words);
    void silent(Words& words);
    void hang(Words& words);
    void wake(Words& words);
    void beat(Words& words);
    void pass(Words& words);
    // what is to be done
    void submit(Words& words);
    void scene(Words& words);
    void control(Words& words);
    void find(Words& words);
    void repair(Words& words);
    void watch(Words& words);
    void unwatch(Words& words);
    // what is done
    void render(Words& words);
    void fail(Words& words);
    void again(Words& words);
    void stored(Words& words);
    void trouble(Words& words);
    void recovered(Words& words);

    [[nodiscard]] Farm& farm();
    void start(const Limits& limits, bool keeps);
    [[nodiscard]] bool is_understood(const std::string& name, Words& words);
    [[nodiscard]] Worker& worker_of(const std::string& name);
    [[nodiscard]] std::string next_client(Words& words) const;
    [[nodiscard]] static JobId job_of(Words& words);
    [[nodiscard]] static std::string topic_of(Words& words);
    protocol::RenderTile take_tile(const std::string& name, Words& words);
    void send_beat(const std::string& name, Worker& worker);
    void beat_all_that_are_due();
    [[nodiscard]] Instant next_beat();
    void notice(const Action& action);

    std::optional<Farm> farm_;
    std::map<std::string, Worker> workers_;
    std::map<std::string, Client> clients_;
    std::vector<std::string> lines_;       ///< of this command
    std::optional<Instant> passing_since_; ///< during `pass`
    bool beats_by_itself_ = false;         ///< so its answer is not shown
};

} // namespace fraja::broker
