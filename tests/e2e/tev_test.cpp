#include "common/image_io/picture_file.hpp"
#include "common/net/clock.hpp"
#include "tests/e2e/farm.hpp"

#include <arpa/inet.h>
#include <array>
#include <cstring>
#include <map>
#include <netinet/in.h>
#include <poll.h>
#include <span>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

using namespace fraja;
using namespace fraja::e2e;

namespace {

/// What a packet holds, read from its beginning on.
class Reader {
public:
    explicit Reader(std::string_view bytes) : bytes_(bytes) {}
    template <class T>
    T take() {
        T value{};
        const auto from = take_bytes(sizeof value);
        std::memcpy(&value, from.data(), sizeof value);
        return value;
    }
    std::string take_text() {
        const auto end = bytes_.find('\0');
        REQUIRE(end != std::string_view::npos);
        return std::string(take_bytes(end + 1).substr(0, end));
    }
    std::string_view take_bytes(std::size_t size) {
        REQUIRE(size <= bytes_.size());
        const auto taken = bytes_.substr(0, size);
        bytes_.remove_prefix(size);
        return taken;
    }
    [[nodiscard]] bool is_empty() const { return bytes_.empty(); }

private:
    std::string_view bytes_;
};

/// Takes a client, one at a time, and puts together what it is told, as tev does.
class FakeTev {
public:
    struct Image {
        std::int32_t width = 0, height = 0;
        std::vector<float> rgb;
    };

    FakeTev() { open(); }
    ~FakeTev() { close(); }
    FakeTev(const FakeTev&) = delete;
    FakeTev& operator=(const FakeTev&) = delete;

    /// At the port that it had before, if it had one.
    void open() {
        listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        const int yes = 1, few_bytes = 4096;
        ::setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
        ::setsockopt(listener_, SOL_SOCKET, SO_RCVBUF, &few_bytes, sizeof few_bytes);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(port_);
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        auto* const generic = reinterpret_cast<sockaddr*>(&address);
        REQUIRE(::bind(listener_, generic, sizeof address) == 0);
        REQUIRE(::listen(listener_, 4) == 0);
        socklen_t size = sizeof address;
        REQUIRE(::getsockname(listener_, generic, &size) == 0);
        port_ = ntohs(address.sin_port);
    }
    /// Forgets what it was told.
    void close() {
        for (int* fd : {&client_, &listener_})
            if (*fd >= 0)
                ::close(std::exchange(*fd, -1));
        buffer_.clear();
        images_.clear();
    }
    [[nodiscard]] std::string place() const { return "127.0.0.1:" + std::to_string(port_); }

    /// Waits a moment for something to happen, and takes it in; `reading` or only the connection.
    void serve(bool reading = true) {
        std::array<pollfd, 2> entries = {{{listener_, POLLIN, 0}, {client_, POLLIN, 0}}};
        if (!reading)
            entries[1].fd = -1;
        if (::poll(entries.data(), entries.size(), 50) <= 0)
            return;
        if (entries[0].revents != 0) {
            if (client_ >= 0)
                ::close(client_);
            client_ = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
            buffer_.clear();
            ++connections_;
        }
        if (entries[1].revents != 0)
            read();
    }
    [[nodiscard]] int connections() const { return connections_; }
    [[nodiscard]] const std::map<std::string, Image>& images() const { return images_; }

private:
    void read() {
        std::array<char, 65536> bytes;
        const ssize_t n = ::recv(client_, bytes.data(), bytes.size(), 0);
        if (n <= 0) {
            ::close(std::exchange(client_, -1));
            return;
        }
        buffer_.append(bytes.data(), static_cast<std::size_t>(n));
        std::uint32_t length = 0;
        while (buffer_.size() >= sizeof length) {
            std::memcpy(&length, buffer_.data(), sizeof length);
            REQUIRE(length > sizeof length);
            if (buffer_.size() < length)
                break;
            take(Reader(std::string_view(buffer_).substr(sizeof length, length - sizeof length)));
            buffer_.erase(0, length);
        }
    }
    void take(Reader packet) {
        const auto type = packet.take<std::uint8_t>();
        if (type == 2) {
            images_.erase(packet.take_text());
        } else {
            REQUIRE((type == 4 || type == 6));
            (void)packet.take<bool>();
            const std::string name = packet.take_text();
            type == 4 ? create(name, packet) : update(name, packet);
        }
        CHECK(packet.is_empty());
    }
    void create(const std::string& name, Reader& packet) {
        REQUIRE_FALSE(images_.contains(name)); // tev would have two of them
        Image& image = images_[name];
        image.width = packet.take<std::int32_t>();
        image.height = packet.take<std::int32_t>();
        take_channels(packet);
        image.rgb.resize(static_cast<std::size_t>(3 * image.width * image.height));
    }
    void update(const std::string& name, Reader& packet) {
        REQUIRE(images_.contains(name));
        Image& image = images_[name];
        take_channels(packet);
        std::array<std::int32_t, 4> rect{};
        for (std::int32_t& side : rect)
            side = packet.take<std::int32_t>();
        const auto [x, y, w, h] = rect;
        REQUIRE((x >= 0 && y >= 0 && x + w <= image.width && y + h <= image.height));
        std::array<std::int64_t, 3> offsets{}, strides{};
        for (std::int64_t& offset : offsets)
            offset = packet.take<std::int64_t>();
        for (std::int64_t& stride : strides)
            stride = packet.take<std::int64_t>();
        const auto data = packet.take_bytes(static_cast<std::size_t>(12 * w * h));
        for (std::size_t c = 0; c < 3; ++c)
            for (std::int64_t i = 0; i < std::int64_t{w} * h; ++i) {
                const std::int64_t from = offsets[c] + i * strides[c];
                const std::int64_t to = 3 * ((y + i / w) * image.width + x + i % w);
                std::memcpy(&image.rgb.at(static_cast<std::size_t>(to) + c), data.data() + 4 * from,
                            4);
            }
    }
    static void take_channels(Reader& packet) {
        REQUIRE(packet.take<std::int32_t>() == 3);
        for (const char* channel : {"R", "G", "B"})
            CHECK(packet.take_text() == channel);
    }

    int listener_ = -1, client_ = -1;
    std::uint16_t port_ = 0;
    int connections_ = 0;
    std::string buffer_;
    std::map<std::string, Image> images_;
};

/// Until the watcher has left.
std::optional<int> serve_to_the_end(FakeTev& tev, Process& watcher, bool reading = true) {
    const Instant end = net::now() + patience;
    while (net::now() < end) {
        tev.serve(reading);
        if (const auto exit = watcher.wait_for_exit(0s)) {
            for (int i = 0; i < 100; ++i) // what is still on its way
                tev.serve(reading);
            return exit;
        }
    }
    return std::nullopt;
}

std::vector<float> local_radiance(const Scratch& scratch, const Words& picture) {
    (void)local_picture(scratch, picture, "local.exr");
    const auto read = read_radiance(scratch.file("local.exr"));
    REQUIRE(read.has_value());
    return read->rgb;
}

} // namespace

TEST_CASE("tev gets the very pixels of the picture") {
    const Scratch scratch;
    FakeTev tev;
    Farm farm;
    const Words picture = {scene("cone"), "-r", "64x48", "--crop", "5,7,50,40"};
    const auto want = local_radiance(scratch, picture);
    const std::string job = farm.detach(picture);
    Process watcher = farm.watch_from_the_start(job, {"--json", "--tev", tev.place()});
    farm.add_worker("ada");
    CHECK(serve_to_the_end(tev, watcher) == 0);
    INFO(watcher.err());
    REQUIRE(tev.images().contains("cone #1"));
    const auto& image = tev.images().at("cone #1");
    CHECK(image.width == 50);
    CHECK(image.height == 40);
    CHECK((image.rgb == want));
    CHECK(contains(watcher.err(), "tev at " + tev.place() + " is shown the picture"));
}

TEST_CASE("a tev that went and came back gets everything again") {
    const Scratch scratch;
    FakeTev tev;
    Farm farm;
    const Words picture = {scene("cone"), "-r", "64x48", "--tile", "8"};
    const auto want = local_radiance(scratch, picture);
    const std::string job = farm.detach(picture);
    Process watcher = farm.watch_from_the_start(job, {"--json", "--tev", tev.place()});
    farm.add_emulated("slow", 1, {"--emulate", "1@1k"}); // some seconds
    wait_for_tiles(watcher, 5);
    while (!tev.images().contains("cone #1"))
        tev.serve();
    tev.close();
    REQUIRE(watcher.wait_for_words(Process::Stream::err, "has gone", patience).has_value());
    tev.open();
    CHECK(serve_to_the_end(tev, watcher) == 0);
    INFO(watcher.err());
    CHECK(tev.connections() == 2);
    REQUIRE(tev.images().contains("cone #1"));
    CHECK((tev.images().at("cone #1").rgb == want));
}

TEST_CASE("a tev that reads nothing holds nobody up") {
    FakeTev tev;
    Farm farm;
    farm.add_worker("ada");
    const Words picture = {scene("cone"), "-r", instrumented ? "320x240" : "1280x960"}; // megabytes
    const std::string job = farm.detach(picture);
    Process watcher = farm.watch(job, {"--json", "--tev", tev.place()});
    CHECK(serve_to_the_end(tev, watcher, false) == 0);
    CHECK(tev.connections() == 1);
    check_each_pixel_once(tile_lines(watcher.out()), instrumented ? 320 : 1280,
                          instrumented ? 240 : 960);
}

TEST_CASE("where no tev is, that is said once, with what to do") {
    FakeTev tev;
    tev.close();
    Farm farm;
    farm.add_worker("ada");
    const std::string job = farm.detach({scene("cone"), "-r", "32x24"});
    Process watcher = farm.watch(job, {"--json", "--tev", tev.place()});
    CHECK(watcher.wait_for_exit(patience) == 0);
    const auto first = watcher.err().find("no tev at " + tev.place());
    REQUIRE(first != std::string::npos);
    CHECK(contains(watcher.err(), "start tev there"));
    CHECK(watcher.err().find("no tev at", first + 1) == std::string::npos);
    Process lost = farm.watch(job, {"--tev", "no-such-host.invalid:1"});
    CHECK(lost.wait_for_exit(patience) == 2);
    CHECK(contains(lost.err(), "--tev no-such-host.invalid:1: "));
}
