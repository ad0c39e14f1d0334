#include "broker/cost_map.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace fraja::broker {

using protocol::CellRect;

namespace {

// Along a side, about.
constexpr std::uint32_t spot_pixels = 16, block_pixels = 64;

// Of all spots.
constexpr std::size_t scattered_min = 8, scattered_max = 128;

// So many pixels of a spot weigh as much as what was thought of it before.
constexpr double prior_pixels = 16;

// So many pixels of an area weigh as much as what is known of the larger one around it.
constexpr double trusted_pixels = 2 * spot_pixels * spot_pixels;

// Of a spot of which nothing is done, that part may be as its dearest neighbour.
constexpr double risk_share = 0.5;

} // namespace

double camera_rays_min(const protocol::PictureSettings& s) {
    if (s.error > 0)
        return protocol::samples_min;
    if (s.spp > 0)
        return s.spp;
    return std::max(1.0, static_cast<double>(s.aa) * s.aa);
}

CostMap::CostMap(const protocol::CellGrid& grid, double camera_rays)
    : grid_(grid), camera_rays_(camera_rays), spot_side_(std::max(1u, spot_pixels / grid.side())),
      block_side_(std::max(1u, block_pixels / grid.side() / spot_side_) * spot_side_) {
    const CellRect all = grid.all();
    const auto count = [](std::uint32_t cells, std::uint32_t side) {
        return (cells + side - 1) / side;
    };
    block_columns_ = count(all.width, block_side_);
    block_rows_ = count(all.height, block_side_);
    spot_columns_ = count(all.width, spot_side_);
    spots_.resize(std::size_t{spot_columns_} * count(all.height, spot_side_));
    for (std::size_t i = 0; i < spots_.size(); ++i)
        spots_[i].left_pixels = static_cast<double>(grid_.pixels(spot(i)).pixel_count());

    levels_.push_back({block_columns_, block_rows_, {}});
    while (levels_.back().columns * levels_.back().rows > 1)
        levels_.push_back({count(levels_.back().columns, 2), count(levels_.back().rows, 2), {}});
    for (Level& level : levels_)
        level.areas.resize(std::size_t{level.columns} * level.rows);
    sum_up(grid_.all());
}

CellRect CostMap::spot(std::size_t index) const {
    const auto column = static_cast<std::uint32_t>(index % spot_columns_) * spot_side_;
    const auto row = static_cast<std::uint32_t>(index / spot_columns_) * spot_side_;
    const CellRect all = grid_.all();
    return {column, row, std::min(spot_side_, all.width - column),
            std::min(spot_side_, all.height - row)};
}

CellRect CostMap::blocks(std::size_t block, std::uint32_t side) const {
    const std::uint32_t cells = side * block_side_;
    const auto begin = [&](std::size_t index) {
        return static_cast<std::uint32_t>(index) / side * cells;
    };
    const std::uint32_t column = begin(block % block_columns_), row = begin(block / block_columns_);
    const CellRect all = grid_.all();
    return {column, row, std::min(cells, all.width - column), std::min(cells, all.height - row)};
}

std::vector<std::size_t> CostMap::blocks_in(const CellRect& cells) const {
    std::vector<std::size_t> blocks;
    for (std::uint32_t row = cells.row; row < cells.row + cells.height; row += block_side_)
        for (std::uint32_t column = cells.column; column < cells.column + cells.width;
             column += block_side_)
            blocks.push_back(block_of({column, row, 1, 1}));
    return blocks;
}

/// By the plastic number's sequence, which leaves no gap: Martin Roberts, "The Unreasonable
/// Effectiveness of Quasirandom Sequences".
std::vector<std::size_t> CostMap::scattered_spots() const {
    const auto wanted =
        std::min(scattered_max,
                 static_cast<std::size_t>(scattered_share * static_cast<double>(spots_.size())));
    if (wanted < scattered_min)
        return {};
    const auto at = [](std::size_t i, double step, std::size_t count) {
        const double place = 0.5 + step * static_cast<double>(i);
        return static_cast<std::size_t>((place - std::floor(place)) * static_cast<double>(count));
    };
    std::vector<std::size_t> spots;
    std::vector<bool> block_has(levels_[0].areas.size());
    for (std::size_t i = 1; i <= 2 * wanted && spots.size() < wanted; ++i) {
        const std::size_t index =
            at(i, 0.5698402909980532, spots_.size() / spot_columns_) * spot_columns_ +
            at(i, 0.7548776662466927, spot_columns_);
        const std::size_t block = block_of(spot(index));
        if (!block_has[block])
            spots.push_back(index);
        block_has[block] = true;
    }
    return spots;
}

template <class Visit>
void CostMap::for_each_spot(const CellRect& cells, Visit visit) const {
    const auto next = [this](std::uint32_t at, std::uint32_t end) {
        return std::min(end, (at / spot_side_ + 1) * spot_side_);
    };
    const std::uint32_t right = cells.column + cells.width, bottom = cells.row + cells.height;
    for (std::uint32_t row = cells.row; row < bottom; row = next(row, bottom))
        for (std::uint32_t column = cells.column; column < right; column = next(column, right)) {
            const CellRect part{column, row, next(column, right) - column, next(row, bottom) - row};
            visit(std::size_t{row / spot_side_} * spot_columns_ + column / spot_side_,
                  static_cast<double>(grid_.pixels(part).pixel_count()));
        }
}

void CostMap::take_probe(const std::vector<double>& rays) {
    FRAJA_ASSERT(!probed_ && rays.size() == spots_.size());
    probed_ = true;
    double sum = 0, pixels = 0;
    for (std::size_t i = 0; i < spots_.size(); ++i) {
        Spot& spot = spots_[i];
        spot.prior = std::isfinite(rays[i]) && rays[i] > 0 ? rays[i] : 1;
        sum += spot.prior * (spot.done_pixels + spot.left_pixels);
        pixels += spot.done_pixels + spot.left_pixels;
    }
    mean_prior_ = sum / pixels;
    sum_up(grid_.all());
}

// ----------------------------------------------------------------------------------------- factors

/// What the prior says of so many pixels: as much as that counts what is known of an area's
/// surroundings.
double CostMap::trust() const {
    return trusted_pixels * mean_prior_;
}

/// Of the whole picture, going by what is done.
double CostMap::factor_of_all() const {
    const Area& all = levels_.back().areas[0];
    return all.done_prior > 0 ? all.done_work / all.done_prior : camera_rays_ / worth_;
}

double CostMap::factor_of(std::size_t level, std::uint32_t column, std::uint32_t row) const {
    if (level + 1 == levels_.size())
        return factor_of_all();
    const double around = factor_of(level + 1, column / 2, row / 2);
    const Area& area = levels_[level].areas[std::size_t{row} * levels_[level].columns + column];
    return (area.done_work + trust() * around) / (area.done_prior + trust());
}

class CostMap::Densities {
public:
    explicit Densities(const CostMap& map) : map_(map) {}

    double operator()(std::size_t index) {
        const std::size_t block = map_.block_of(map_.spot(index));
        if (block != block_) {
            block_ = block;
            factor_ = map_.factor_of(0, static_cast<std::uint32_t>(block % map_.block_columns_),
                                     static_cast<std::uint32_t>(block / map_.block_columns_));
        }
        const Spot& spot = map_.spots_[index];
        return (spot.done_work + prior_pixels * spot.prior * factor_) /
               (spot.done_pixels + prior_pixels);
    }

private:
    const CostMap& map_;
    std::size_t block_ = static_cast<std::size_t>(-1);
    double factor_ = 1;
};

void CostMap::sum_up_block(std::size_t block) {
    Area sum;
    for_each_spot(blocks(block, 1), [&](std::size_t index, double) {
        const Spot& spot = spots_[index];
        sum.done_work += spot.done_work;
        sum.done_prior += spot.prior * spot.done_pixels;
        const double weight = spot.left_pixels / (spot.done_pixels + prior_pixels);
        sum.left_known += weight * spot.done_work; // Densities of its pixels
        sum.left_prior += weight * prior_pixels * spot.prior;
    });
    levels_[0].areas[block] = sum;
}

/// What is left of each of the four, by the factor of all of them.
void CostMap::sum_up_area(std::size_t level, std::uint32_t column, std::uint32_t row) {
    const Level& below = levels_[level - 1];
    Area sum;
    for (std::uint32_t y = 2 * row; y < std::min(below.rows, 2 * row + 2); ++y)
        for (std::uint32_t x = 2 * column; x < std::min(below.columns, 2 * column + 2); ++x) {
            const Area& part = below.areas[std::size_t{y} * below.columns + x];
            sum.done_work += part.done_work;
            sum.done_prior += part.done_prior;
            const double weight = 1 / (part.done_prior + trust());
            sum.left_known += part.left_known + part.left_prior * part.done_work * weight;
            sum.left_prior += part.left_prior * trust() * weight;
        }
    levels_[level].areas[std::size_t{row} * levels_[level].columns + column] = sum;
}

/// The blocks that have some of these cells, and all areas that have these.
void CostMap::sum_up(const CellRect& cells) {
    std::uint32_t left = cells.column / block_side_, top = cells.row / block_side_;
    std::uint32_t right = (cells.column + cells.width - 1) / block_side_;
    std::uint32_t bottom = (cells.row + cells.height - 1) / block_side_;
    for (std::uint32_t row = top; row <= bottom; ++row)
        for (std::uint32_t column = left; column <= right; ++column)
            sum_up_block(std::size_t{row} * block_columns_ + column);
    for (std::size_t level = 1; level < levels_.size(); ++level) {
        left /= 2, top /= 2, right /= 2, bottom /= 2;
        for (std::uint32_t row = top; row <= bottom; ++row)
            for (std::uint32_t column = left; column <= right; ++column)
                sum_up_area(level, column, row);
    }
}

/// Nobody knows where in the cells the work was: as much as was thought, it was in each spot.
void CostMap::learn(const CellRect& cells, double work) {
    Densities density(*this);
    std::vector<double> thoughts; // of each spot
    for_each_spot(cells, [&](std::size_t spot, double pixels) {
        thoughts.push_back(density(spot) * pixels);
    });
    const double thought = std::accumulate(thoughts.begin(), thoughts.end(), 0.0);
    const double by = thought > 0 ? work / worth_ / thought : 0;
    auto part = thoughts.begin();
    for_each_spot(cells, [&](std::size_t index, double pixels) {
        Spot& spot = spots_[index];
        spot.done_work += *part++ * by;
        spot.done_pixels += pixels;
        spot.left_pixels = std::max(0.0, spot.left_pixels - pixels);
        done_pixels_ += pixels;
    });
    sum_up(cells);
}

/// In the spots' own proportions, so that what a pixel of them costs stays.
void CostMap::undo(const CellRect& cells) {
    for_each_spot(cells, [&](std::size_t index, double pixels) {
        Spot& spot = spots_[index];
        const double undone = std::min(pixels, spot.done_pixels);
        if (undone <= 0)
            return;
        spot.done_work *= (spot.done_pixels - undone) / spot.done_pixels;
        spot.done_pixels -= undone;
        spot.left_pixels += undone;
        done_pixels_ -= undone;
    });
    sum_up(cells);
}

// -------------------------------------------------------------------------------------------- work

double CostMap::work(const CellRect& cells) const {
    double work = 0;
    Densities density(*this);
    for_each_spot(cells, [&](std::size_t spot, double pixels) { work += density(spot) * pixels; });
    return worth_ * work;
}

double CostMap::density_at_risk(std::size_t spot, Densities& density) const {
    double most = density(spot);
    if (spots_[spot].done_pixels > 0)
        return most;
    const auto columns = static_cast<std::ptrdiff_t>(spot_columns_);
    const auto rows = static_cast<std::ptrdiff_t>(spots_.size()) / columns;
    const auto column = static_cast<std::ptrdiff_t>(spot) % columns;
    const auto row = static_cast<std::ptrdiff_t>(spot) / columns;
    for (std::ptrdiff_t y = std::max<std::ptrdiff_t>(0, row - 1); y <= std::min(rows - 1, row + 1);
         ++y)
        for (std::ptrdiff_t x = std::max<std::ptrdiff_t>(0, column - 1);
             x <= std::min(columns - 1, column + 1); ++x)
            most = std::max(most, risk_share * density(static_cast<std::size_t>(y * columns + x)));
    return most;
}

double CostMap::risk(const CellRect& cells) const {
    double work = 0;
    Densities density(*this);
    for_each_spot(cells, [&](std::size_t spot, double pixels) {
        work += density_at_risk(spot, density) * pixels;
    });
    return worth_ * work;
}

double CostMap::left() const {
    const Area& all = levels_.back().areas[0];
    return worth_ * (all.left_known + all.left_prior * factor_of_all());
}

/// What takes longer than was thought tells that the rest will, too.
double CostMap::all(const TilesBegun& begun) const {
    const double thought = done() + begun.thought;
    const double longer = thought > 0 ? (done() + begun.expected) / thought : 1;
    return done() + longer * left();
}

double CostMap::share_per_s(const TilesBegun& begun) const {
    const double all = this->all(begun);
    return all > 0 ? begun.per_s / all : 0;
}

double CostMap::share_done(const TilesBegun& begun) const {
    const double all = this->all(begun);
    return all > 0 ? std::clamp((done() + begun.work) / all, 0.0, 1.0) : 0;
}

} // namespace fraja::broker
