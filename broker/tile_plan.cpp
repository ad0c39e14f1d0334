#include "broker/tile_plan.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <tuple>
#include <utility>

namespace fraja::broker {
namespace {

/// Columns and rows of the grid of tiles.
struct Cell {
    std::uint32_t column, row;
};

struct Grid {
    std::uint32_t columns, rows;
};

std::vector<Cell> scan(Grid grid) {
    std::vector<Cell> cells;
    cells.reserve(std::size_t{grid.columns} * grid.rows);
    for (std::uint32_t row = 0; row < grid.rows; ++row)
        for (std::uint32_t column = 0; column < grid.columns; ++column)
            cells.push_back({column, row});
    return cells;
}

/// From the middle outwards, ring by ring, each ring clockwise from the right.
std::vector<Cell> spiral(Grid grid) {
    std::vector<Cell> cells = scan(grid);
    const auto key = [grid](Cell c) { // twice the distance to the middle, so that it stays whole
        const std::int64_t x = 2 * std::int64_t{c.column} + 1 - grid.columns;
        const std::int64_t y = 2 * std::int64_t{c.row} + 1 - grid.rows;
        const std::int64_t ring = std::max(std::abs(x), std::abs(y));
        const int side = x == ring ? 0 : y == ring ? 1 : x == -ring ? 2 : 3;
        const std::int64_t along = side == 0 ? y : side == 1 ? -x : side == 2 ? -y : x;
        return std::tuple(ring, side, along);
    };
    std::ranges::sort(cells, {}, key);
    return cells;
}

/// 0 and last first, then always halfway between neighbours: generation by generation.
std::vector<std::vector<std::uint32_t>> halvings(std::uint32_t count) {
    std::vector<std::vector<std::uint32_t>> generations{{0}};
    if (count > 1)
        generations[0].push_back(count - 1);
    std::vector<std::uint32_t> known = generations[0];
    for (;;) {
        std::vector<std::uint32_t> fresh;
        for (std::size_t i = 0; i + 1 < known.size(); ++i)
            if (known[i + 1] - known[i] > 1)
                fresh.push_back(known[i] + (known[i + 1] - known[i]) / 2);
        if (fresh.empty())
            return generations;
        known.insert(known.end(), fresh.begin(), fresh.end());
        std::ranges::sort(known);
        generations.push_back(std::move(fresh));
    }
}

/// Raja's DiadicSampler, on tiles: corners, then (new, new), (old, new), (new, old) of every
/// generation.
std::vector<Cell> diadic(Grid grid) {
    const auto columns = halvings(grid.columns), rows = halvings(grid.rows);
    std::vector<std::uint32_t> old_columns, old_rows;
    std::vector<Cell> cells;
    const auto visit = [&](const std::vector<std::uint32_t>& cs,
                           const std::vector<std::uint32_t>& rs) {
        for (const std::uint32_t column : cs)
            for (const std::uint32_t row : rs)
                cells.push_back({column, row});
    };
    for (std::size_t i = 0; i < std::max(columns.size(), rows.size()); ++i) {
        static const std::vector<std::uint32_t> none;
        const auto& new_columns = i < columns.size() ? columns[i] : none;
        const auto& new_rows = i < rows.size() ? rows[i] : none;
        visit(new_columns, new_rows);
        visit(old_columns, new_rows);
        visit(new_columns, old_rows);
        old_columns.insert(old_columns.end(), new_columns.begin(), new_columns.end());
        old_rows.insert(old_rows.end(), new_rows.begin(), new_rows.end());
    }
    return cells;
}

std::vector<Cell> ordered(Grid grid, protocol::TileOrder order) {
    switch (order) {
    case protocol::TileOrder::automatic:
    case protocol::TileOrder::scan:
        return scan(grid);
    case protocol::TileOrder::spiral:
        return spiral(grid);
    case protocol::TileOrder::diadic:
        return diadic(grid);
    }
    return scan(grid);
}

} // namespace

std::uint32_t automatic_tile_side(const protocol::PictureSettings& settings) {
    const double even = std::sqrt(static_cast<double>(settings.crop.pixel_count()) / 256);
    const std::uint32_t side = std::clamp(static_cast<std::uint32_t>(even) / 8 * 8, 8u, 64u);
    if (settings.error > 0 || settings.limited_in_time())
        return side == 64 ? 64 : 32;
    return side;
}

std::uint64_t tile_count(PixelRect crop, std::uint32_t side) {
    return cells_of(crop, side).pixel_count();
}

std::vector<PixelRect> plan_tiles(PixelRect crop, std::uint32_t side, protocol::TileOrder order) {
    FRAJA_ASSERT(side > 0 && !crop.empty());
    const PixelRect cells = cells_of(crop, side);
    std::vector<PixelRect> tiles;
    for (const Cell cell : ordered({cells.width, cells.height}, order)) {
        // 64 bits: the last cell may reach beyond what a coordinate holds.
        const auto along = [side](std::uint64_t index, std::uint32_t from, std::uint32_t length) {
            const std::uint64_t begin = std::max<std::uint64_t>(index * side, from);
            const std::uint64_t end = std::min((index + 1) * side, std::uint64_t{from} + length);
            return std::pair(static_cast<std::uint32_t>(begin),
                             static_cast<std::uint32_t>(end - begin));
        };
        const auto [x, width] = along(std::uint64_t{cells.x} + cell.column, crop.x, crop.width);
        const auto [y, height] = along(std::uint64_t{cells.y} + cell.row, crop.y, crop.height);
        tiles.push_back({x, y, width, height});
    }
    return tiles;
}

} // namespace fraja::broker
