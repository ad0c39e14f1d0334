// What the benchmarks measure with.
#pragma once

#include "common/base/pixel_rect.hpp"
#include "common/base/text.hpp"

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <linux/perf_event.h>
#include <string>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <vector>

namespace fraja {

[[noreturn]] inline void fail(const std::string& why) {
    std::fprintf(stderr, "%s\n", why.c_str());
    std::exit(2);
}

/// An option's number or size; null: it is missing.
[[nodiscard]] inline std::uint32_t count_of(const char* text) {
    const auto n = parse_count(text ? text : "");
    if (!n || *n > UINT32_MAX)
        fail(std::string("not a number: ") + (text ? text : "nothing"));
    return static_cast<std::uint32_t>(*n);
}
[[nodiscard]] inline Extent extent_of(const char* text) {
    const auto extent = parse_extent(text ? text : "");
    if (!extent)
        fail("-r takes WxH");
    return *extent;
}

/// A picture in tiles, as the benchmarks draw it.
[[nodiscard]] inline std::vector<PixelRect> tiles_of(Extent size) {
    constexpr std::uint32_t side = 32;
    std::vector<PixelRect> tiles;
    for (std::uint32_t y = 0; y < size.height; y += side)
        for (std::uint32_t x = 0; x < size.width; x += side)
            tiles.push_back(
                {x, y, std::min(side, size.width - x), std::min(side, size.height - y)});
    return tiles;
}

/// This thread's time in user mode, and the little that it is in the kernel: what tells the two
/// apart (getrusage) counts ticks, of which a small picture has none.
inline double user_seconds() {
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Cycles per second, from additions that wait for each other, one cycle each.
inline double measured_clock_rate() {
    double best = 0;
    for (int round = 0; round < 5; ++round) {
        constexpr std::uint64_t additions = 20'000'000;
        std::uint64_t x = 1;
        const double begin = user_seconds();
        for (std::uint64_t i = 0; i < additions; i += 8) {
            // Written out, so that nothing hangs on how the loop is compiled.
            const auto add = [&] {
                x += i;
                __asm__ volatile("" : "+r"(x));
            };
            add(), add(), add(), add(), add(), add(), add(), add();
        }
        best = std::max(best, static_cast<double>(additions) / (user_seconds() - begin));
    }
    return best;
}

/// The processor's counter of user-mode cycles, where the machine has one.
class CycleCounter {
public:
    /// Of this thread. Without a counter, `clock_rate` is taken for what it is, 0: to be measured.
    explicit CycleCounter(double clock_rate = 0) : clock_rate_(clock_rate) {
        perf_event_attr attr{};
        attr.type = PERF_TYPE_HARDWARE;
        attr.size = sizeof attr;
        attr.config = PERF_COUNT_HW_CPU_CYCLES;
        attr.exclude_kernel = attr.exclude_hv = 1;
        fd_ = static_cast<int>(syscall(SYS_perf_event_open, &attr, 0, -1, -1, 0));
        if (fd_ < 0 && clock_rate_ == 0)
            clock_rate_ = measured_clock_rate();
    }
    ~CycleCounter() {
        if (fd_ >= 0)
            close(fd_);
    }
    CycleCounter(const CycleCounter&) = delete;
    CycleCounter& operator=(const CycleCounter&) = delete;

    [[nodiscard]] bool counts() const { return fd_ >= 0; }
    [[nodiscard]] double clock_rate() const { return clock_rate_; }
    [[nodiscard]] double now() const {
        if (fd_ < 0)
            return user_seconds() * clock_rate_;
        std::uint64_t cycles = 0;
        if (read(fd_, &cycles, sizeof cycles) != sizeof cycles)
            fail("cannot read the cycle counter");
        return static_cast<double>(cycles);
    }

private:
    int fd_ = -1;
    double clock_rate_ = 0;
};

} // namespace fraja
