// CostMap: what is thought of how much work the parts of a picture are: first nothing, then what a
// probe has found, then ever more what the tiles that are done have cost.
#pragma once

#include "common/protocol/cells.hpp"

#include <cstdint>
#include <vector>

namespace fraja::broker {

/// Work is told in rays, as they are on the average: one that takes twice as long counts twice.
/// A picture is looked at in blocks, squares of `block_side()` x `block_side()` cells.
class CostMap {
public:
    CostMap() = default;
    explicit CostMap(const protocol::CellGrid& grid);

    [[nodiscard]] std::uint32_t block_side() const { return block_side_; } ///< in cells
    [[nodiscard]] std::uint32_t columns() const { return columns_; }       ///< of blocks
    [[nodiscard]] std::uint32_t rows() const { return rows_; }
    [[nodiscard]] std::size_t block_of(const protocol::CellRect& cells) const {
        return std::size_t{cells.row / block_side_} * columns_ + cells.column / block_side_;
    }
    [[nodiscard]] protocol::CellRect block(std::size_t index) const;

    /// A probe has found so many rays for each camera ray, on the average of each block. Call once
    /// at most. What is not finite, or below 0, counts as 1.
    void take_probe(const std::vector<double>& rays);
    [[nodiscard]] bool is_probed() const { return probed_; }
    /// Cells of one block are done, for the first time, and were so much work.
    void learn(const protocol::CellRect& cells, double work);

    /// Nothing is known but how many pixels there are.
    [[nodiscard]] bool is_blank() const { return !probed_ && done_pixels_ == 0; }
    /// What cells of one block are thought to be, done or not.
    [[nodiscard]] double work(const protocol::CellRect& cells) const;
    /// What all that is not done is thought to be.
    [[nodiscard]] double left() const;
    [[nodiscard]] double done() const { return done_work_; }
    /// 0 to 1.
    [[nodiscard]] double share_done() const;

private:
    struct Block {
        double prior = 1; ///< work of a pixel, times an unknown factor
        double done_work = 0, done_pixels = 0, left_pixels = 0;
        double left_work = 0; ///< as it counts in left_known_
    };
    [[nodiscard]] double scale() const;
    [[nodiscard]] double density(const Block& block) const;

    protocol::CellGrid grid_;
    std::uint32_t block_side_ = 1, columns_ = 0, rows_ = 0;
    std::vector<Block> blocks_;
    bool probed_ = false;
    double done_work_ = 0, done_pixels_ = 0;
    double done_prior_ = 0; ///< what the prior said of what is done
    // Of what is not done: where something of the block is, by its own density; elsewhere the
    // prior.
    double left_known_ = 0, left_prior_ = 0;
};

} // namespace fraja::broker
