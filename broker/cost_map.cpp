#include "broker/cost_map.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <cmath>

namespace fraja::broker {
namespace {

constexpr std::uint32_t block_pixels = 64; // along a block's side, about

// So many pixels of a block weigh as much as what is known of the whole picture.
constexpr double prior_pixels = 64;

} // namespace

CostMap::CostMap(const protocol::CellGrid& grid)
    : grid_(grid), block_side_(std::max(1u, block_pixels / grid.side())) {
    const auto blocks = [this](std::uint32_t cells) {
        return (cells + block_side_ - 1) / block_side_;
    };
    columns_ = blocks(grid.all().width);
    rows_ = blocks(grid.all().height);
    blocks_.resize(std::size_t{columns_} * rows_);
    for (std::size_t i = 0; i < blocks_.size(); ++i) {
        blocks_[i].left_pixels = static_cast<double>(grid_.pixels(block(i)).pixel_count());
        left_prior_ += blocks_[i].left_pixels;
    }
}

protocol::CellRect CostMap::block(std::size_t index) const {
    const auto column = static_cast<std::uint32_t>(index % columns_) * block_side_;
    const auto row = static_cast<std::uint32_t>(index / columns_) * block_side_;
    const protocol::CellRect all = grid_.all();
    return {column, row, std::min(block_side_, all.width - column),
            std::min(block_side_, all.height - row)};
}

void CostMap::take_probe(const std::vector<double>& rays) {
    FRAJA_ASSERT(!probed_ && rays.size() == blocks_.size());
    probed_ = true;
    left_prior_ = done_prior_ = 0;
    for (std::size_t i = 0; i < blocks_.size(); ++i) {
        Block& block = blocks_[i];
        block.prior = std::isfinite(rays[i]) && rays[i] > 0 ? rays[i] : 1;
        done_prior_ += block.prior * block.done_pixels;
        if (block.done_pixels == 0)
            left_prior_ += block.prior * block.left_pixels;
    }
}

double CostMap::scale() const {
    return done_prior_ > 0 ? done_work_ / done_prior_ : 1;
}

double CostMap::density(const Block& block) const {
    return (block.done_work + prior_pixels * block.prior * scale()) /
           (block.done_pixels + prior_pixels);
}

void CostMap::learn(const protocol::CellRect& cells, double work) {
    Block& block = blocks_[block_of(cells)];
    const auto pixels = static_cast<double>(grid_.pixels(cells).pixel_count());
    if (block.done_pixels > 0)
        left_known_ -= block.left_work;
    else
        left_prior_ -= block.prior * block.left_pixels;
    done_work_ += work;
    done_pixels_ += pixels;
    done_prior_ += block.prior * pixels;
    block.done_work += work;
    block.done_pixels += pixels;
    block.left_pixels = std::max(0.0, block.left_pixels - pixels);
    block.left_work = density(block) * block.left_pixels;
    left_known_ += block.left_work;
}

double CostMap::work(const protocol::CellRect& cells) const {
    return density(blocks_[block_of(cells)]) *
           static_cast<double>(grid_.pixels(cells).pixel_count());
}

double CostMap::left() const {
    return std::max(0.0, left_known_) + std::max(0.0, left_prior_) * scale();
}

double CostMap::share_done() const {
    const double all = done_work_ + left();
    return all > 0 ? std::clamp(done_work_ / all, 0.0, 1.0) : 0;
}

} // namespace fraja::broker
