// Input: a fuzzer's bytes, read as choices and numbers.
#pragma once

#include "common/base/bytes.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace fraja::fuzz {

/// Reads from the front; behind the end there are zeros. Same bytes, same choices: what a fuzzer
/// finds happens again, and a change of one byte changes little.
class Input {
public:
    Input(const std::uint8_t* data, std::size_t size) : rest_(data, size) {}

    [[nodiscard]] bool empty() const { return rest_.empty(); }

    std::uint8_t byte() {
        if (rest_.empty())
            return 0;
        const std::uint8_t first = rest_[0];
        rest_ = rest_.subspan(1);
        return first;
    }
    /// 0..bound-1, by one byte up to 256 and by four beyond. `bound` must not be 0.
    std::uint32_t below(std::uint32_t bound) {
        return (bound <= 256 ? byte() : static_cast<std::uint32_t>(number(4))) % bound;
    }
    /// Once in `n` times: never where the bytes are used up.
    bool once_in(std::uint32_t n) { return below(n) == n - 1; }
    /// Of so many bytes, the least significant first.
    std::uint64_t number(unsigned byte_count) {
        std::uint64_t value = 0;
        for (unsigned i = 0; i < byte_count; ++i)
            value |= std::uint64_t{byte()} << (8 * i);
        return value;
    }
    /// Small ones mostly, but all there are.
    std::uint64_t any_number() {
        const std::uint8_t kind = byte();
        if (kind < 200)
            return kind % 20;
        if (kind < 240)
            return number(1 + kind % 8);
        return edges[kind % edges.size()];
    }
    /// At most so many as there are.
    std::span<const std::uint8_t> take(std::size_t byte_count) {
        const auto taken = rest_.first(std::min(byte_count, rest_.size()));
        rest_ = rest_.subspan(taken.size());
        return taken;
    }
    std::span<const std::uint8_t> take_all() { return take(rest_.size()); }
    Bytes bytes(std::size_t byte_count) {
        const auto taken = std::as_bytes(take(byte_count));
        return {taken.begin(), taken.end()};
    }
    std::string text(std::size_t byte_count) {
        const auto taken = take(byte_count);
        return {taken.begin(), taken.end()};
    }

private:
    static constexpr std::array<std::uint64_t, 16> edges = {
        0x7f,       0x80,           0xff,       0x100,
        0xffff,     0x10000,        0x7fffffff, 0x80000000,
        0xffffffff, 0x100000000,    INT64_MAX,  std::uint64_t{1} << 63,
        UINT64_MAX, UINT64_MAX - 1, 4096,       std::uint64_t{1} << 53};

    std::span<const std::uint8_t> rest_;
};

} // namespace fraja::fuzz
