#include "broker/cost_map.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <cmath>

namespace fraja::broker {

using protocol::CellRect;

namespace {

// Along a side, about.
constexpr std::uint32_t spot_pixels = 16, block_pixels = 64;

// So many pixels of a spot weigh as much as what was thought of it before.
constexpr double prior_pixels = 16;

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
    for (std::size_t i = 0; i < spots_.size(); ++i) {
        spots_[i].left_pixels = static_cast<double>(grid_.pixels(spot(i)).pixel_count());
        left_prior_ += spots_[i].left_pixels;
    }
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
    left_prior_ = done_prior_ = 0;
    for (std::size_t i = 0; i < spots_.size(); ++i) {
        Spot& spot = spots_[i];
        spot.prior = std::isfinite(rays[i]) && rays[i] > 0 ? rays[i] : 1;
        done_prior_ += spot.prior * spot.done_pixels;
        if (spot.done_pixels == 0)
            left_prior_ += spot.prior * spot.left_pixels;
    }
}

double CostMap::scale() const {
    return done_prior_ > 0 ? done_work_ / done_prior_ : camera_rays_;
}

double CostMap::density(const Spot& spot) const {
    return (spot.done_work + prior_pixels * spot.prior * scale()) /
           (spot.done_pixels + prior_pixels);
}

/// Nobody knows where in the cells the work was: as much as was thought, it was in each spot.
void CostMap::learn(const CellRect& cells, double work) {
    const double thought = this->work(cells);
    const double factor = thought > 0 ? work / thought : 0;
    struct Part {
        std::size_t spot;
        double pixels, work;
    };
    std::vector<Part> parts;
    for_each_spot(cells, [&](std::size_t spot, double pixels) {
        parts.push_back({spot, pixels, density(spots_[spot]) * pixels * factor});
    });
    for (const Part& part : parts)
        learn(spots_[part.spot], part.pixels, part.work);
}

void CostMap::learn(Spot& spot, double pixels, double work) {
    if (spot.done_pixels > 0)
        left_known_ -= spot.left_work;
    else
        left_prior_ -= spot.prior * spot.left_pixels;
    done_work_ += work;
    done_pixels_ += pixels;
    done_prior_ += spot.prior * pixels;
    spot.done_work += work;
    spot.done_pixels += pixels;
    spot.left_pixels = std::max(0.0, spot.left_pixels - pixels);
    spot.left_work = density(spot) * spot.left_pixels;
    left_known_ += spot.left_work;
}

double CostMap::work(const CellRect& cells) const {
    double work = 0;
    for_each_spot(cells,
                  [&](std::size_t spot, double pixels) { work += density(spots_[spot]) * pixels; });
    return work;
}

double CostMap::density_at_risk(std::size_t spot) const {
    double density = this->density(spots_[spot]);
    if (spots_[spot].done_pixels > 0)
        return density;
    const auto columns = static_cast<std::ptrdiff_t>(spot_columns_);
    const auto rows = static_cast<std::ptrdiff_t>(spots_.size()) / columns;
    const auto column = static_cast<std::ptrdiff_t>(spot) % columns;
    const auto row = static_cast<std::ptrdiff_t>(spot) / columns;
    for (std::ptrdiff_t y = std::max<std::ptrdiff_t>(0, row - 1); y <= std::min(rows - 1, row + 1);
         ++y)
        for (std::ptrdiff_t x = std::max<std::ptrdiff_t>(0, column - 1);
             x <= std::min(columns - 1, column + 1); ++x)
            density = std::max(
                density,
                risk_share * this->density(spots_[static_cast<std::size_t>(y * columns + x)]));
    return density;
}

double CostMap::risk(const CellRect& cells) const {
    double work = 0;
    for_each_spot(cells,
                  [&](std::size_t spot, double pixels) { work += density_at_risk(spot) * pixels; });
    return work;
}

double CostMap::left() const {
    return std::max(0.0, left_known_) + std::max(0.0, left_prior_) * scale();
}

/// What takes longer than was thought tells that the rest will, too.
double CostMap::all(const TilesBegun& begun) const {
    const double thought = done_work_ + begun.thought;
    const double longer = thought > 0 ? (done_work_ + begun.expected) / thought : 1;
    return done_work_ + longer * left();
}

double CostMap::share_per_s(const TilesBegun& begun) const {
    const double all = this->all(begun);
    return all > 0 ? begun.per_s / all : 0;
}

double CostMap::share_done(const TilesBegun& begun) const {
    const double all = this->all(begun);
    return all > 0 ? std::clamp((done_work_ + begun.work) / all, 0.0, 1.0) : 0;
}

} // namespace fraja::broker
