#include "broker/tile_plan.hpp"

#include <algorithm>
#include <cstdlib>
#include <tuple>

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

std::uint32_t automatic_cell_side(const protocol::PictureSettings& settings) {
    constexpr std::uint64_t large_picture = 256 * 64 * 64;
    if (settings.limited_in_time())
        return settings.crop.pixel_count() >= large_picture ? 64 : 32;
    std::uint32_t side = settings.error > 0 ? 8 : 2;
    while (cells_of(settings.crop, side).pixel_count() > automatic_cells_max)
        side *= 2;
    return side;
}

std::vector<std::uint32_t> ordered_cells(std::uint32_t columns, std::uint32_t rows,
                                         protocol::TileOrder order) {
    std::vector<std::uint32_t> numbers;
    numbers.reserve(std::size_t{columns} * rows);
    for (const Cell cell : ordered({columns, rows}, order))
        numbers.push_back(cell.row * columns + cell.column);
    return numbers;
}

} // namespace fraja::broker
