// Cells: the small squares that a job's picture consists of. Tiles are rectangles of cells.
#pragma once

#include "common/base/assert.hpp"
#include "common/base/pixel_rect.hpp"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>

namespace fraja::protocol {

/// Columns and rows of cells, from a picture's first ones on.
struct CellRect {
    std::uint32_t column = 0, row = 0, width = 0, height = 0;
    friend bool operator==(const CellRect&, const CellRect&) = default;
    [[nodiscard]] std::uint64_t count() const { return std::uint64_t{width} * height; }
};

[[nodiscard]] inline bool overlap(const CellRect& a, const CellRect& b) {
    return a.column < b.column + b.width && b.column < a.column + a.width &&
           a.row < b.row + b.height && b.row < a.row + a.height;
}

[[nodiscard]] inline bool contains(const CellRect& all, const CellRect& part) {
    return part.column >= all.column && part.column + part.width <= all.column + all.width &&
           part.row >= all.row && part.row + part.height <= all.row + all.height;
}

/// Across the longer side; of an odd number the first is the larger one.
[[nodiscard]] inline std::pair<CellRect, CellRect> halves(CellRect r) {
    CellRect second = r;
    if (r.width >= r.height) {
        r.width = (r.width + 1) / 2;
        second.column += r.width;
        second.width -= r.width;
    } else {
        r.height = (r.height + 1) / 2;
        second.row += r.height;
        second.height -= r.height;
    }
    return {r, second};
}

/// Squares of `side` pixels of the picture's grid, as far as they lie in the crop, counted row by
/// row.
class CellGrid {
public:
    CellGrid() = default;
    /// The crop must not be empty, nor `side` 0; of neither, there are no cells.
    CellGrid(PixelRect crop, std::uint32_t side)
        : crop_(crop), side_(side), cells_(cells_of(crop, side)) {}

    [[nodiscard]] std::uint32_t side() const { return side_; }
    [[nodiscard]] std::uint64_t count() const { return cells_.pixel_count(); }
    [[nodiscard]] CellRect all() const { return {0, 0, cells_.width, cells_.height}; }
    [[nodiscard]] std::uint64_t index(std::uint32_t column, std::uint32_t row) const {
        return std::uint64_t{row} * cells_.width + column;
    }
    /// Of the top left one.
    [[nodiscard]] std::uint64_t index(const CellRect& r) const { return index(r.column, r.row); }
    [[nodiscard]] CellRect at(std::uint64_t index) const {
        return {static_cast<std::uint32_t>(index % cells_.width),
                static_cast<std::uint32_t>(index / cells_.width), 1, 1};
    }

    [[nodiscard]] PixelRect pixels(const CellRect& r) const {
        const Span x = span(cells_.x, r.column, r.width, crop_.x, crop_.width);
        const Span y = span(cells_.y, r.row, r.height, crop_.y, crop_.height);
        return {x.begin, y.begin, x.length, y.length};
    }
    /// The cells that the rectangle consists of, if it consists of whole ones.
    [[nodiscard]] std::optional<CellRect> cells(const PixelRect& r) const {
        if (side_ == 0 || r.empty() || !r.inside(crop_))
            return std::nullopt;
        const PixelRect c = cells_of(r, side_);
        const CellRect cells{c.x - cells_.x, c.y - cells_.y, c.width, c.height};
        return pixels(cells) == r ? std::optional(cells) : std::nullopt;
    }
    /// Calls `visit(index)` for each cell until it says false; whether it never did.
    template <class Visit>
    bool all_of(const CellRect& r, Visit visit) const {
        for (std::uint32_t row = r.row; row < r.row + r.height; ++row)
            for (std::uint32_t column = r.column; column < r.column + r.width; ++column)
                if (!visit(index(column, row)))
                    return false;
        return true;
    }

private:
    struct Span {
        std::uint32_t begin, length;
    };
    /// 64 bits: the last cell may reach beyond what a coordinate holds.
    [[nodiscard]] Span span(std::uint32_t first_cell, std::uint32_t index, std::uint32_t count,
                            std::uint32_t from, std::uint32_t length) const {
        const std::uint64_t first = std::uint64_t{first_cell} + index;
        const std::uint64_t begin = std::max<std::uint64_t>(first * side_, from);
        const std::uint64_t end = std::min((first + count) * side_, std::uint64_t{from} + length);
        FRAJA_DEBUG_ASSERT(begin < end);
        return {static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(end - begin)};
    }

    PixelRect crop_;
    std::uint32_t side_ = 0;
    PixelRect cells_; ///< of the picture's grid
};

} // namespace fraja::protocol
