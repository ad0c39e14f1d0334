// CostMap: what is thought of how much work the parts of a picture are: first nothing, then what a
// probe has found, then ever more what the tiles that are done have cost.
#pragma once

#include "common/protocol/cells.hpp"
#include "common/protocol/settings.hpp"

#include <cstdint>
#include <vector>

namespace fraja::broker {

/// So many at least has each pixel of such a picture, or of a pass of it.
[[nodiscard]] double camera_rays_min(const protocol::PictureSettings& settings);

/// Tiles that are being drawn, together.
struct TilesBegun {
    double work = 0;     ///< that has been done of them
    double thought = 0;  ///< that they were thought to be
    double expected = 0; ///< that they are thought to be now that they have taken so long
    double per_s = 0;    ///< done of them in a second
};

/// Work is told in rays, as they are on the average: one that takes twice as long counts twice.
/// What the average is may change, as rays of some parts of pictures take longer than those of
/// others: so work is kept in rays of a time when one was worth 1 (set_worth). A picture is looked
/// at in spots, squares of cells of about 16 pixels; and cut at first in blocks, squares of spots
/// of about 64 pixels. A probe tells spots from one another, but not all that they cost: by which
/// factor it is wrong is learnt for each block, and where little of it is done, from the four that
/// it is one of, and from the sixteen, and so on.
class CostMap {
public:
    /// `camera_rays`: of a pixel, as long as nothing is done.
    explicit CostMap(const protocol::CellGrid& grid, double camera_rays = 1);

    [[nodiscard]] std::uint32_t block_side() const { return block_side_; } ///< in cells
    [[nodiscard]] std::uint32_t block_columns() const { return block_columns_; }
    [[nodiscard]] std::uint32_t block_rows() const { return block_rows_; }
    /// The one that they begin in.
    [[nodiscard]] std::size_t block_of(const protocol::CellRect& cells) const {
        return std::size_t{cells.row / block_side_} * block_columns_ + cells.column / block_side_;
    }
    /// Of the grid of squares of so many blocks a side the one with that block, as far as there is
    /// picture.
    [[nodiscard]] protocol::CellRect blocks(std::size_t block, std::uint32_t side) const;
    /// Those that begin in the cells.
    [[nodiscard]] std::vector<std::size_t> blocks_in(const protocol::CellRect& cells) const;
    [[nodiscard]] std::size_t spot_count() const { return spots_.size(); }
    [[nodiscard]] protocol::CellRect spot(std::size_t index) const;
    /// Of the picture at most are spots that are scattered.
    static constexpr double scattered_share = 0.05;
    /// Some, a small part of the picture, each in another block and far from one another: what they
    /// cost tells of all. Few of a small picture: none.
    [[nodiscard]] std::vector<std::size_t> scattered_spots() const;

    /// Machines now trace so many rays where they traced one.
    void set_worth(double rays) { worth_ = rays; }
    /// A probe has found so many rays for each camera ray, on the average of each spot. Call once
    /// at most. What is not finite, or below 0, counts as 1.
    void take_probe(const std::vector<double>& rays);
    /// Cells are done, for the first time, and were so much work.
    void learn(const protocol::CellRect& cells, double work);
    /// Cells that were done are not: what they cost is still as it was found.
    void undo(const protocol::CellRect& cells);

    /// Nothing is known but how many pixels there are.
    [[nodiscard]] bool is_blank() const { return !probed_ && done_pixels_ == 0; }
    /// What cells are thought to be, done or not.
    [[nodiscard]] double work(const protocol::CellRect& cells) const;
    /// What they may be, if bad comes to worse: where nothing of a spot is done, it may be as its
    /// neighbours are, in part.
    [[nodiscard]] double risk(const protocol::CellRect& cells) const;
    /// What all that is not done is thought to be.
    [[nodiscard]] double left() const;
    [[nodiscard]] double done() const { return worth_ * levels_.back().areas[0].done_work; }
    /// 0 to 1.
    [[nodiscard]] double share_done(const TilesBegun& begun = {}) const;
    /// So much more of it in a second.
    [[nodiscard]] double share_per_s(const TilesBegun& begun) const;

private:
    struct Spot {
        double prior = 1; ///< work of a pixel, times an unknown factor
        double done_work = 0, done_pixels = 0, left_pixels = 0;
    };
    /// A block, or four areas.
    struct Area {
        double done_work = 0, done_prior = 0; ///< of what is done: what it was, what the prior said
        double left_known = 0, left_prior = 0; ///< what is left is known + prior * the factor
    };
    struct Level {
        std::uint32_t columns = 0, rows = 0;
        std::vector<Area> areas; ///< row by row
    };
    /// Work of a pixel, spot by spot: looks a block's factor up once for all that follow one
    /// another.
    class Densities;

    [[nodiscard]] double trust() const;
    [[nodiscard]] double factor_of_all() const;
    [[nodiscard]] double factor_of(std::size_t level, std::uint32_t column,
                                   std::uint32_t row) const;
    [[nodiscard]] double density_at_risk(std::size_t spot, Densities& density) const;
    [[nodiscard]] double all(const TilesBegun& begun) const;
    void sum_up_block(std::size_t block);
    void sum_up_area(std::size_t level, std::uint32_t column, std::uint32_t row);
    void sum_up(const protocol::CellRect& cells);
    /// Calls `visit(spot's index, pixels of it among the cells)`.
    template <class Visit>
    void for_each_spot(const protocol::CellRect& cells, Visit visit) const;

    protocol::CellGrid grid_;
    double camera_rays_ = 1;
    double worth_ = 1;
    std::uint32_t spot_side_ = 1, spot_columns_ = 0; ///< the side in cells
    std::uint32_t block_side_ = 1, block_columns_ = 0, block_rows_ = 0;
    std::vector<Spot> spots_;
    bool probed_ = false;
    // Work in here, and in spots and areas, is what it is worth 1.
    double done_pixels_ = 0;
    double mean_prior_ = 1;     ///< of all pixels
    std::vector<Level> levels_; ///< blocks first, the whole last
};

} // namespace fraja::broker
