#include "common/base/rng.hpp"
#include "common/net/clock.hpp"
#include "tests/e2e/farm.hpp"

#include <csignal>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

using namespace fraja;
using namespace fraja::e2e;

TEST_CASE("twenty watchers that join at random moments each report every tile exactly once") {
    Farm farm;
    farm.add_worker("one");
    farm.add_worker("two");
    const Words picture = {scene("overlapping_spheres"),
                           "--kernel", // seconds, so that there are moments to join at
                           "reference",
                           "-r",
                           instrumented ? "40x30" : "320x240",
                           "-a",
                           "2",
                           "--tile",
                           instrumented ? "2" : "10"}; // 300 or 768 tiles
    const std::uint32_t width = instrumented ? 40 : 320, height = instrumented ? 30 : 240;
    const std::string job = farm.detach(picture);
    Process first = farm.watch(job);
    const auto seed =
        static_cast<std::uint64_t>(std::chrono::steady_clock::now().time_since_epoch().count());
    CAPTURE(seed);
    Rng rng(seed);
    std::vector<Process> watchers;
    std::size_t seen = 0;
    for (int i = 0; i < 19; ++i) {
        const std::size_t next = std::min<std::size_t>(290, seen + rng.below(30));
        if (next > seen)
            wait_for_tiles(first, next);
        seen = next;
        watchers.push_back(farm.watch(job));
    }
    watchers.push_back(std::move(first));
    for (Process& watcher : watchers) {
        CHECK(watcher.wait_for_exit(patience) == 0);
        INFO(watcher.err());
        check_each_pixel_once(tile_lines(watcher.out()), width, height);
    }
    // And one that comes when all is over.
    Process late = farm.watch(job);
    CHECK(late.wait_for_exit(patience) == 0);
    check_each_pixel_once(tile_lines(late.out()), width, height);
}

TEST_CASE("a watcher keeps a picture that ends as the picture") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one");
    const Words picture = {scene("cone"), "-r", "64x48"};
    const std::string want = local_picture(scratch, picture);
    const std::string job = farm.detach(picture);
    Process watcher = farm.watch(job, {"-o", scratch.file("now.png")});
    CHECK(watcher.wait_for_exit(patience) == 0);
    CHECK((bytes_of(scratch.file("now.png")) == want));
}

TEST_CASE("a watcher ends as its job does") {
    Farm farm;
    farm.add_worker("one");
    Process none = farm.watch("no-such-job");
    CHECK(none.wait_for_exit(patience) == 6);
    const std::string job = farm.detach({scene("overlap_without_priority"), "-r", "40x30"});
    Process failing = farm.watch(job);
    CHECK(failing.wait_for_exit(patience) == 1);
}

namespace {

/// A named pipe whose reader takes something only when it is asked to.
class LazyReader {
public:
    explicit LazyReader(std::string path) : path_(std::move(path)) {
        REQUIRE(::mkfifo(path_.c_str(), 0600) == 0);
        fd_ = ::open(path_.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
        REQUIRE(fd_ >= 0);
    }
    ~LazyReader() { ::close(fd_); }
    LazyReader(const LazyReader&) = delete;
    LazyReader& operator=(const LazyReader&) = delete;
    /// Some bytes; none where there are none at the moment.
    [[nodiscard]] std::string read() const {
        std::string text(4096, '\0');
        const ssize_t n = ::read(fd_, text.data(), text.size());
        text.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
        return text;
    }
    /// `argv` with its stdout here.
    [[nodiscard]] Words command(const Words& argv) const {
        return with({"/bin/sh", "-c", "exec \"$@\" >\"$0\"", path_}, argv);
    }

private:
    std::string path_;
    int fd_ = -1;
};

} // namespace

TEST_CASE("a watcher whose lines nobody takes keeps its picture current, and hears signals") {
    const Scratch scratch;
    Farm farm;
    farm.add_worker("one");
    // More lines than a pipe has room for.
    const Words picture = {scene("cone"), "-r", "48x48", "--tile", "1"};
    const std::string want = local_picture(scratch, {scene("cone"), "-r", "48x48"});
    const std::string job = farm.detach(picture);
    Process until_done = farm.watch(job);
    REQUIRE(until_done.wait_for_exit(patience) == 0);

    const auto watch = [&](const LazyReader& reader, const std::string& output) {
        auto watcher = Process::start({reader.command(
            {program("fraja-watch"), "-b", farm.endpoint(), job, "--json", "-o", output})});
        REQUIRE(watcher.has_value());
        const auto is_there = [&] { return fs::exists(output) && bytes_of(output) == want; };
        for (const Instant end = net::now() + patience; net::now() < end && !is_there();)
            REQUIRE_FALSE(watcher->wait_for_exit(20ms).has_value());
        CHECK(is_there());
        return *std::move(watcher);
    };
    const LazyReader nobody(scratch.file("nobody"));
    Process stuck = watch(nobody, scratch.file("stuck.png"));
    CHECK_FALSE(stuck.wait_for_exit(0s).has_value());
    stuck.send(SIGTERM);
    CHECK(stuck.wait_for_exit(patience) == 143);

    const LazyReader slow(scratch.file("slow"));
    Process waiting = watch(slow, scratch.file("waiting.png"));
    std::string lines;
    while (!waiting.wait_for_exit(1ms))
        lines += slow.read();
    for (std::string more; !(more = slow.read()).empty();)
        lines += more;
    CHECK(waiting.wait_for_exit(0s) == 0);
    CHECK(lines.size() > 65536);
    check_each_pixel_once(tile_lines(lines), 48, 48);
}
