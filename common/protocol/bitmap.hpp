// One bit per tile: what a watcher has.
#pragma once

#include "common/base/bytes.hpp"

#include <cstddef>
#include <cstdint>

namespace fraja::protocol {

/// Bit i is bit i % 8 (from the least significant) of byte i / 8. Bits beyond the end read as 0.
class Bitmap {
public:
    Bitmap() = default;
    explicit Bitmap(std::size_t bit_count) : bytes_((bit_count + 7) / 8) {}
    explicit Bitmap(Bytes bytes) : bytes_(std::move(bytes)) {}

    [[nodiscard]] bool test(std::size_t i) const {
        return i / 8 < bytes_.size() && (std::to_integer<unsigned>(bytes_[i / 8]) >> (i % 8) & 1u);
    }
    /// `i` must be below the bit count.
    void set(std::size_t i) { bytes_.at(i / 8) |= std::byte(1u << (i % 8)); }
    void reset(std::size_t i) { bytes_.at(i / 8) &= std::byte(~(1u << (i % 8)) & 0xffu); }
    [[nodiscard]] const Bytes& bytes() const { return bytes_; }

private:
    Bytes bytes_;
};

} // namespace fraja::protocol
