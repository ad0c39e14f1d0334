// A worker that speaks well and answers black pixels: with --verify it is found out.
#include "common/protocol/limits.hpp"
#include "common/protocol/probe.hpp"
#include "tests/chaos/peer.hpp"
#include "tests/e2e/ring.hpp"

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>

using namespace fraja;
using namespace fraja::chaos;
using namespace fraja::e2e;

namespace {

/// Draws nothing, and is faster than anybody else.
class LyingWorker {
public:
    explicit LyingWorker(const std::string& endpoint, const std::string& name = "liar",
                         const std::optional<net::Keys>& keys = {})
        : thread_([=](const std::stop_token& stop) { run(stop, endpoint, name, keys); }) {}

private:
    static protocol::TileRendered answer_to(const protocol::RenderTile& order) {
        const std::uint64_t bytes =
            order.probe_side > 0
                ? sizeof(float) * protocol::probe_squares(order.rect, order.probe_side)
                : order.rect.pixel_count() * order.settings.pixel_bytes();
        protocol::TileRendered answer;
        answer.job = order.job;
        answer.tile = order.tile;
        answer.attempt = order.attempt;
        answer.pass = order.pass;
        answer.rect = order.rect;
        answer.rays = {.camera = order.rect.pixel_count()};
        answer.elapsed = std::chrono::milliseconds(1);
        answer.blobs = cut(Blob(Bytes(bytes)), protocol::chunk_bytes);
        return answer;
    }
    static void run(const std::stop_token& stop, const std::string& endpoint,
                    const std::string& name, const std::optional<net::Keys>& keys) {
        const net::Context context(keys);
        Peer peer(context, endpoint);
        peer.say(hello_of(name, 2));
        std::uint64_t received = 0;
        Instant next_beat{};
        while (!stop.stop_requested()) {
            if (net::now() >= next_beat) {
                peer.say(
                    protocol::WorkerBeat{.credit = 2, .in_flight = {}, .tiles_received = received});
                next_beat = net::now() + heartbeat / 4;
            }
            const auto message = peer.hear(heartbeat / 8);
            const auto* order = message ? std::get_if<protocol::RenderTile>(&*message) : nullptr;
            if (!order)
                continue;
            ++received;
            peer.say(answer_to(*order));
        }
    }

    std::jthread thread_;
};

RunResult ctl(const Farm& farm, const Words& words) {
    auto result = run({with({program("fraja-ctl"), "-b", farm.endpoint()}, words)}, patience);
    REQUIRE(result.has_value());
    return std::move(*result);
}

} // namespace

TEST_CASE("a worker that answers wrong pixels is found and named, and the picture is right") {
    const Scratch scratch;
    const Words picture{scene("cone"), "-r", "320x240", "--tile", "16"};
    const std::string want = local_picture(scratch, picture);
    Farm farm;
    farm.add_worker("honest-1");
    farm.add_worker("honest-2");
    const LyingWorker liar(farm.endpoint());
    REQUIRE(farm.broker()
                .wait_for_words(Process::Stream::err, "worker liar is here", patience)
                .has_value());

    const auto believed = farm.submit(with(picture, {"-o", scratch.file("believed.png")}));
    CHECK(believed.exit == 0);
    CHECK((bytes_of(scratch.file("believed.png")) != want)); // so it does harm

    const auto checked =
        farm.submit(with(picture, {"--verify", "100%", "--json", "-o", scratch.file("right.png")}));
    INFO(checked.err);
    CHECK(checked.exit == 0);
    CHECK((bytes_of(scratch.file("right.png")) == want));
    CHECK(contains(checked.err, "worker liar answers wrong pixels"));
    const auto report = nlohmann::json::parse(checked.out);
    REQUIRE(report.at("distrusted").size() == 1);
    CHECK(report.at("distrusted")[0].at("name") == "liar");
    CHECK(report.at("checks").at("agreed") == 300);
    CHECK(report.at("checks").at("unchecked") == 0);
    const RunResult workers = ctl(farm, {"workers"});
    CHECK(contains(workers.out, "distrusted: "));

    // It gets nothing any more, whether anybody looks or not.
    CHECK(farm.submit(with(picture, {"-o", scratch.file("next.png")})).exit == 0);
    CHECK((bytes_of(scratch.file("next.png")) == want));
}

TEST_CASE("two liars with one key have one voice, and lie for nothing") {
    const Scratch scratch;
    const Ring ring;
    ring.allow(
        {{"worker", "worker"}, {"second", "worker"}, {"branch", "worker"}, {"ada", "submit"}});
    const Words picture{scene("cone"), "-r", "160x120", "--tile", "16"};
    Farm farm(ring.broker_options());
    for (const char* name : {"worker", "second"})
        farm.add_worker(name, {"-j", "1", "--key-file", ring.file(name)});
    const net::Keys keys{*net::key_pair(ring.key("branch"), ring.secret("branch")),
                         *net::parse_public_key(ring.key("farm"))};
    const LyingWorker liar(farm.endpoint(), "liar-1", keys), twin(farm.endpoint(), "liar-2", keys);
    for (const char* name : {"liar-1", "liar-2"})
        REQUIRE(farm.broker()
                    .wait_for_words(Process::Stream::err,
                                    std::string("worker ") + name + " is here", patience)
                    .has_value());
    const auto checked =
        farm.submit(with(picture, {"--verify", "100%", "--json", "--key-file", ring.file("ada"),
                                   "-o", scratch.file("x.png")}));
    INFO(checked.err);
    CHECK(checked.exit == 0);
    CHECK((bytes_of(scratch.file("x.png")) == local_picture(scratch, picture)));
    CHECK(contains(checked.err, "answers wrong pixels"));
    const auto report = nlohmann::json::parse(checked.out);
    REQUIRE(report.at("distrusted").size() == 1); // whatever they call themselves
    CHECK(report.at("distrusted")[0].at("name").get<std::string>().starts_with("liar-"));
    CHECK(report.at("checks").at("agreed") == 80);
    CHECK(report.at("checks").at("unchecked") == 0);
}

TEST_CASE(
    "without a second worker --verify says what it could not check, and the picture is there") {
    const Scratch scratch;
    const Words picture{scene("cone"), "-r", "64x48", "--tile", "16"};
    Farm farm;
    farm.add_worker("alone");
    const auto done =
        farm.submit(with(picture, {"--verify", "1", "-o", scratch.file("unchecked.png")}));
    CHECK(done.exit == 0);
    CHECK(contains(done.err, "--verify: 12 tiles of 12 could not be checked"));
    CHECK((bytes_of(scratch.file("unchecked.png")) == local_picture(scratch, picture)));
}
