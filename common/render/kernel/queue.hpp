// Rays waiting to be traced, as columns of numbers.
#pragma once

#include "common/render/kernel/packet.hpp"
#include "common/render/kernel/roots.hpp"
#include "common/render/kernel/tables.hpp"
#include "common/render/kernel/wide.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace fraja::kernel {
namespace {

enum Column : std::size_t {
    origin_x,
    origin_y,
    origin_z,
    dir_x,
    dir_y,
    dir_z,
    red,
    green,
    blue,
    column_count
};

/// Rays of the same depth. Each column has room for a last, partly used packet.
class RayQueue {
public:
    explicit RayQueue(std::uint32_t surface_words) : words_(surface_words) {}

    [[nodiscard]] std::size_t size() const { return size_; }
    void clear() { size_ = 0; }
    /// Loses what it holds.
    void reserve(std::size_t count) {
        size_ = 0;
        if (count + packet_rays <= capacity_)
            return;
        capacity_ = (count + 2 * packet_rays - 1) / packet_rays * packet_rays;
        reals_.assign(column_count * capacity_, 0.0);
        owners_.assign(capacity_, none);
        fillers_.assign(capacity_, none);
        samples_.assign(capacity_, 0);
        inside_.assign(words_ * capacity_, 0);
    }

    double* reals(Column c) { return reals_.data() + c * capacity_; }
    std::int64_t* owners() { return owners_.data(); }
    /// The leaf that fills the space a ray starts in; none; unresolved.
    std::int64_t* fillers() { return fillers_.data(); }
    std::uint32_t* samples() { return samples_.data(); }
    /// The surfaces the rays are inside of: word w of ray i.
    std::int64_t* inside(std::uint32_t w) { return inside_.data() + w * capacity_; }
    std::uint32_t words() const { return words_; }

    /// One more ray, to be filled in; there must be room.
    std::size_t add() { return size_++; }
    /// To be filled in, all of them; there must be room.
    void resize(std::size_t count) { size_ = count; }
    /// One more, a copy.
    void add(RayQueue& from, std::size_t i) { put(add(), from, i); }
    void put(std::size_t to, RayQueue& from, std::size_t i) {
        for (std::size_t c = 0; c < column_count; ++c)
            reals(static_cast<Column>(c))[to] = from.reals(static_cast<Column>(c))[i];
        owners()[to] = from.owners()[i];
        fillers()[to] = from.fillers()[i];
        samples()[to] = from.samples()[i];
        for (std::uint32_t w = 0; w < words_; ++w)
            inside(w)[to] = from.inside(w)[i];
    }
    /// Fills the last packet up with copies of the last ray. Not empty.
    void pad() {
        for (std::size_t n = size_; n % packet_rays != 0; ++n) {
            for (std::size_t c = 0; c < column_count; ++c)
                reals(static_cast<Column>(c))[n] = reals(static_cast<Column>(c))[size_ - 1];
            owners()[n] = owners()[size_ - 1];
            fillers()[n] = fillers()[size_ - 1];
            for (std::uint32_t w = 0; w < words_; ++w)
                inside(w)[n] = inside(w)[size_ - 1];
        }
    }

    WideRays rays_at(std::size_t i) {
        return {{load(reals(origin_x) + i), load(reals(origin_y) + i), load(reals(origin_z) + i)},
                {load(reals(dir_x) + i), load(reals(dir_y) + i), load(reals(dir_z) + i)},
                load(owners() + i)};
    }

private:
    std::uint32_t words_;
    std::size_t size_ = 0, capacity_ = 0;
    std::vector<double> reals_;
    std::vector<std::int64_t> owners_, fillers_, inside_;
    std::vector<std::uint32_t> samples_;
};

} // namespace
} // namespace fraja::kernel
