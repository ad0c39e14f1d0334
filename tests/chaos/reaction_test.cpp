// How soon the farm reacts: to a worker that is no more, and to an answer that is not wanted any
// more.
#include "common/base/rng.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "tests/chaos/peer.hpp"
#include "tests/e2e/farm.hpp"
#include "tests/support/scene_text.hpp"

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

using namespace fraja;
using namespace fraja::e2e;
using namespace fraja::protocol;
using chaos::Peer;

namespace {

/// Beyond the mark: until a process of a busy machine gets a processor.
constexpr Duration scheduling = instrumented ? Duration(2s) : Duration(150ms);

double ms(Duration d) {
    return seconds(d) * 1e3;
}

/// What a farm of one worker and one witness does when the worker is no more.
class Requeueing {
public:
    /// Until the witness has both tiles that the worker had.
    Duration measure(int signal) {
        Process& worker = farm_.add_worker("worker" + std::to_string(++rounds_));
        const std::string job = farm_.detach({scene("overlapping_spheres"), "--kernel", "reference",
                                              "-r", "512x256", "-a", "64", "--tile", "256"});
        Peer witness(context_, farm_.endpoint());
        witness.say(chaos::hello_of("witness", 2));
        REQUIRE(witness.hear_only<Welcome>(patience).has_value());
        CHECK(tiles_until(witness, net::now() + std::chrono::milliseconds(rng_.below(500)), 1) ==
              0);
        const Instant begin = net::now();
        worker.send(signal);
        REQUIRE(tiles_until(witness, begin + patience, 2) == 2);
        const Duration took = net::now() - begin;
        witness.say(Goodbye{});
        worker.send(SIGKILL);
        CHECK(worker.wait_for_exit(patience) == -SIGKILL);
        Peer client(context_, farm_.endpoint());
        client.say(ClientHello{"test", "0"});
        client.say(ControlJob{.job = *parse_id<JobId>(job), .deed = JobDeed::cancel});
        CHECK(client.hear_only<JobState>(patience).has_value());
        client.say(Goodbye{});
        return took;
    }

private:
    /// The tiles that the witness is given, at most `wanted`. It beats.
    static int tiles_until(Peer& witness, Instant end, int wanted) {
        std::vector<TileInFlight> tiles;
        while (net::now() < end && static_cast<int>(tiles.size()) < wanted) {
            witness.say(
                WorkerBeat{.credit = 2, .in_flight = tiles, .tiles_received = tiles.size()});
            if (const auto order =
                    witness.hear_only<RenderTile>(std::min<Duration>(50ms, end - net::now())))
                tiles.push_back({order->job, order->tile, order->attempt, 0});
        }
        return static_cast<int>(tiles.size());
    }

    Farm farm_{Words{"--heartbeat", heartbeat_option, "--max-attempts", "1000"}};
    net::Context context_;
    Rng rng_{1};
    int rounds_ = 0;
};

/// A broker to one worker, of the test's own making.
class FakeBroker {
public:
    FakeBroker()
        : router_(std::move(*net::RouterSocket::bind(context_, "tcp://127.0.0.1:0"))),
          scene_(Blob(scene_text("overlapping_spheres.raj"))) {
        auto worker =
            Process::start({{program("fraja-worker"), "-b", router_.endpoint(), "-j", "1"}});
        REQUIRE(worker.has_value());
        worker_ = std::move(*worker);
    }

    /// Has the worker begin a tile that takes minutes, and cancels it; until its thread has done
    /// another tile, of one pixel. (That the first one is cancelled, it answers before.)
    Duration time_to_cancel(const PictureSettings& settings) {
        while (!peer_)
            hear();
        const RenderTile order = tile({tile_side_max, tile_side_max}, settings);
        say(order);
        hear_until<WorkerBeat>([&](const WorkerBeat& beat) {
            return std::ranges::any_of(beat.in_flight, [&](const TileInFlight& tile) {
                return tile.attempt == order.attempt && tile.rays > 0;
            });
        });
        PictureSettings quick = settings;
        quick.aa = 0;
        quick.error = 0;
        const RenderTile next = tile({1, 1}, quick);
        say(next);
        const Instant begin = net::now();
        say(CancelTile{order.job, order.tile, order.attempt});
        hear_until<TileFailed>([&](const TileFailed& failed) {
            CHECK(failed.attempt == order.attempt);
            CHECK(failed.code == FailureCode::cancelled);
            return true;
        });
        hear_until<TileRendered>([&](const TileRendered& rendered) {
            CHECK(rendered.attempt == next.attempt);
            return true;
        });
        return net::now() - begin;
    }

private:
    RenderTile tile(Extent size, const PictureSettings& settings) {
        return {.job = job_,
                .attempt = AttemptNumber{++attempts_},
                .rect = {0, 0, size.width, size.height},
                .scene = content_hash(scene_),
                .scene_bytes = scene_.size(),
                .settings = settings};
    }
    template <class M, class Wanted>
    void hear_until(Wanted wanted) {
        const Instant end = net::now() + patience;
        for (;;) {
            REQUIRE(net::now() < end);
            const auto message = hear();
            if (const auto* m = message ? std::get_if<M>(&*message) : nullptr; m && wanted(*m))
                return;
        }
    }
    void say(const Message& message) {
        REQUIRE(router_.send(*peer_, encode(message)) == net::SendStatus::sent);
    }
    /// Answers what every broker answers.
    std::optional<Message> hear() {
        auto received = router_.receive();
        if (!received) {
            const auto ended = worker_->wait_for_exit(0s); // and it is listened to
            INFO(worker_->story());
            REQUIRE(!ended.has_value());
            net::wait({router_}, 20ms);
            return std::nullopt;
        }
        auto message = decode(received->frames);
        REQUIRE(message.has_value());
        if (const auto* hello = std::get_if<WorkerHello>(&*message)) {
            peer_ = received->peer;
            say(Welcome{.broker = random_id<BrokerId>(),
                        .epoch = 1,
                        .heartbeat = 50ms,
                        .liveness = 100,
                        .stream = "tcp://127.0.0.1:1",
                        .program_version = "test",
                        .incarnation = hello->incarnation});
        } else if (std::holds_alternative<WorkerBeat>(*message)) {
            say(Beat{});
        } else if (const auto* need = std::get_if<NeedChunk>(&*message)) {
            say(Chunk{need->blob, 0, scene_.size(), {scene_}});
        }
        return std::move(*message);
    }

    net::Context context_;
    net::RouterSocket router_;
    Blob scene_;
    std::optional<Process> worker_;
    std::optional<net::PeerId> peer_;
    JobId job_ = random_id<JobId>();
    std::uint32_t attempts_ = 0;
};

/// When a line of a program's log was written: it begins with that.
Duration written_at(std::string_view line) {
    std::tm time{};
    int ms = 0;
    REQUIRE(std::sscanf(std::string(line).c_str(), "%d-%d-%d %d:%d:%d.%d", &time.tm_year,
                        &time.tm_mon, &time.tm_mday, &time.tm_hour, &time.tm_min, &time.tm_sec,
                        &ms) == 7);
    time.tm_year -= 1900;
    --time.tm_mon;
    return std::chrono::seconds(timegm(&time)) + std::chrono::milliseconds(ms);
}

/// A machine that is a tenth as fast as it was, until the line comes.
std::optional<std::string> slowed_until(Process& slow, Process& speaker, const std::string& words) {
    const auto has_come = [&](Duration timeout) {
        return speaker.wait_for_words(Process::Stream::err, words, timeout);
    };
    std::optional<std::string> line;
    for (const Instant end = net::now() + patience; !line && net::now() < end;) {
        slow.send(SIGSTOP);
        line = has_come(18ms);
        slow.send(SIGCONT);
        if (!line)
            line = has_come(2ms);
    }
    return line;
}

/// What a worker's log says of its last cancelled tile of a job, and of a tile that it drew then.
struct Freed {
    Duration cancelled{}, next_done{};
};
std::optional<Freed> freed(const std::string& log, const std::string& job,
                           const std::string& next) {
    const auto of = [](const std::string& id, const char* fate) {
        return " of job " + id.substr(0, 8) + ": " + fate;
    };
    std::optional<Duration> cancelled;
    std::istringstream lines(log);
    for (std::string line; std::getline(lines, line);) {
        if (line.find(of(job, "cancelled")) != std::string::npos)
            cancelled = written_at(line);
        else if (line.find(of(job, "done")) != std::string::npos)
            cancelled.reset(); // it was through with it
        else if (cancelled && line.find(of(next, "done")) != std::string::npos)
            return Freed{*cancelled, written_at(line)};
    }
    return std::nullopt;
}

} // namespace

TEST_CASE("chaos: whoever was too late stops at once and goes on with something else") {
    const Scratch scratch;
    const Words picture = {scene("overlapping_spheres"),        "--kernel", "reference", "-r",
                           instrumented ? "100x75" : "400x300", "-a",       "2"};
    // Neither is lost when it is stopped for a while.
    Farm farm({"--heartbeat", "5s", "--log-level", "debug"});
    farm.add_worker("slow", {"-j", "1", "--tag", "slow", "--log-level", "debug"});
    farm.add_worker("fast", {"-j", "1"});
    std::optional<Freed> measured;
    Duration all_done{};
    for (int round = 0; round < 5 && !measured; ++round) {
        const std::string job = farm.detach(picture);
        Process watcher = farm.watch(job, {"--json", "-o", scratch.file("farm.png")});
        wait_for_tiles(watcher, 6); // so the two are thought to be equally fast
        // When it is free it draws this, and nobody else does.
        const std::string next =
            farm.detach({scene("cone"), "-r", "1x1", "--tile", "1", "--tag", "slow", "-p", "-1"});
        const auto done = slowed_until(farm.worker(0), farm.broker(), job + " is done");
        REQUIRE(done.has_value());
        all_done = written_at(*done);
        CHECK(watcher.wait_for_exit(patience) == 0);
        Process last = farm.watch(next, {"--json"});
        CHECK(last.wait_for_exit(patience) == 0);
        const auto said = farm.worker(0).wait_for_words(
            Process::Stream::err, " of job " + next.substr(0, 8) + ": done", patience);
        REQUIRE(said.has_value());
        measured = freed(farm.worker(0).err(), job, next);
    }
    CHECK((bytes_of(scratch.file("farm.png")) == local_picture(scratch, picture)));
    INFO(farm.worker(0).story());
    CHECK(farm.broker().err().find("late on slow, given out once more") != std::string::npos);
    REQUIRE(measured.has_value());
    std::printf("an overbooked tile's loser: it heard of it %.0f ms after the picture was done, "
                "and had drawn its next tile %.0f ms later\n",
                ms(measured->cancelled - all_done), ms(measured->next_done - measured->cancelled));
    const Duration at_most = instrumented ? Duration(5s) : Duration(1s); // the machine is busy
    CHECK(measured->next_done - measured->cancelled <= at_most);
    CHECK(measured->cancelled - all_done <= at_most);
}

TEST_CASE(
    "chaos: what a killed or stopped worker had is given to another within three heartbeats") {
    Requeueing farm;
    for (const int signal : {SIGKILL, SIGSTOP}) {
        std::vector<Duration> times;
        for (int i = 0; i < 4; ++i)
            times.push_back(farm.measure(signal));
        std::ranges::sort(times);
        std::printf("requeued after signal %d: %.0f to %.0f ms, heartbeats of %.0f ms\n", signal,
                    ms(times.front()), ms(times.back()), ms(heartbeat));
        CHECK(times.back() <= 3 * heartbeat + scheduling);
    }
}

TEST_CASE("a worker stops within 100 ms what is not wanted any more") {
    FakeBroker broker;
    const Extent size{tile_side_max, tile_side_max};
    PictureSettings settings{.size = size, .crop = {0, 0, size.width, size.height}, .aa = 64};
    for (const KernelChoice kernel : {KernelChoice::reference, KernelChoice::fast})
        for (const double error : {0.0, 1e-3}) {
            settings.kernel = kernel;
            settings.error = error;
            settings.aa = error > 0 ? 0 : 64;
            settings.max_samples = samples_max;
            CAPTURE(static_cast<int>(kernel));
            CAPTURE(error);
            std::vector<Duration> times;
            for (int i = 0; i < 5; ++i)
                times.push_back(broker.time_to_cancel(settings));
            std::ranges::sort(times);
            std::printf("%s, error %g: stopped after %.1f to %.1f ms\n",
                        kernel == KernelChoice::fast ? "fast" : "reference", error,
                        ms(times.front()), ms(times.back()));
            CHECK(times[2] <= (instrumented ? Duration(1s) : Duration(100ms)));
            CHECK(times.back() <= 100ms + scheduling);
        }
}
