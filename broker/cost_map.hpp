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
/// A picture is looked at in spots, squares of cells of about 16 pixels; and cut at first in
/// blocks, squares of spots of about 64 pixels.
class CostMap {
public:
    CostMap() = default;
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

    /// A probe has found so many rays for each camera ray, on the average of each spot. Call once
    /// at most. What is not finite, or below 0, counts as 1.
    void take_probe(const std::vector<double>& rays);
    /// Cells are done, for the first time, and were so much work.
    void learn(const protocol::CellRect& cells, double work);

    /// Nothing is known but how many pixels there are.
    [[nodiscard]] bool is_blank() const { return !probed_ && done_pixels_ == 0; }
    /// What cells are thought to be, done or not.
    [[nodiscard]] double work(const protocol::CellRect& cells) const;
    /// What they may be, if bad comes to worse: where nothing of a spot is done, it may be as its
    /// neighbours are, in part.
    [[nodiscard]] double risk(const protocol::CellRect& cells) const;
    /// What all that is not done is thought to be.
    [[nodiscard]] double left() const;
    [[nodiscard]] double done() const { return done_work_; }
    /// 0 to 1.
    [[nodiscard]] double share_done(const TilesBegun& begun = {}) const;
    /// So much more of it in a second.
    [[nodiscard]] double share_per_s(const TilesBegun& begun) const;

private:
    struct Spot {
        double prior = 1; ///< work of a pixel, times an unknown factor
        double done_work = 0, done_pixels = 0, left_pixels = 0;
        double left_work = 0; ///< as it counts in left_known_
    };
    [[nodiscard]] double scale() const;
    [[nodiscard]] double all(const TilesBegun& begun) const;
    [[nodiscard]] double density(const Spot& spot) const;
    [[nodiscard]] double density_at_risk(std::size_t spot) const;
    void learn(Spot& spot, double pixels, double work);
    /// Calls `visit(spot's index, pixels of it among the cells)`.
    template <class Visit>
    void for_each_spot(const protocol::CellRect& cells, Visit visit) const;

    protocol::CellGrid grid_;
    double camera_rays_ = 1;
    std::uint32_t spot_side_ = 1, spot_columns_ = 0; ///< the side in cells
    std::uint32_t block_side_ = 1, block_columns_ = 0, block_rows_ = 0;
    std::vector<Spot> spots_;
    bool probed_ = false;
    double done_work_ = 0, done_pixels_ = 0;
    double done_prior_ = 0; ///< what the prior said of what is done
    // Of what is not done: where something of the spot is, by its own density; elsewhere the prior.
    double left_known_ = 0, left_prior_ = 0;
};

} // namespace fraja::broker
