// Heat map: what each cell of a job's picture has cost, and who rendered it.
#pragma once

#include "common/base/pixel_rect.hpp"
#include "common/image_io/picture_file.hpp"
#include "common/protocol/cells.hpp"
#include "common/protocol/messages.hpp"

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace fraja::client {

/// Workers that are told apart in one job's map; whoever comes later counts as one of them.
inline constexpr std::size_t map_workers_max = 256;

using Srgb8 = std::array<std::uint8_t, 3>;

/// The colour of a cost, from 0 (the least) to 1 (the most): dark blue over green to yellow, and
/// lighter all the way. Beyond is as the ends.
[[nodiscard]] Srgb8 cost_colour(double share);
/// Neighbours in number differ well.
[[nodiscard]] Srgb8 worker_colour(std::size_t index);

class HeatMap {
public:
    /// The crop must not be empty, nor `cell_side` 0.
    HeatMap(const PixelRect& crop, std::uint32_t cell_side);

    /// The tile consists of whole cells (asserted), as Follower's do. Passes add up.
    void add(const protocol::TileDone& tile);
    /// Whole cells likewise, as if nobody had rendered them.
    void withdraw(const PixelRect& rect);

    /// One pixel for each cell; cells that nobody has rendered yet are black. Costs are seen on a
    /// logarithmic scale from the least to the most, at most a factor of ten thousand.
    [[nodiscard]] LevelsPicture costs() const;
    [[nodiscard]] LevelsPicture workers() const;

    /// The pixels of the picture that the cells cover: they may reach beyond the crop.
    [[nodiscard]] PixelRect covered() const;

    struct Costs {
        double least = 0, most = 0; ///< seconds per pixel; the scale's ends
    };
    [[nodiscard]] Costs scale() const;

    struct Worker {
        std::string name; ///< of those beyond the limit "others"
        std::uint64_t tiles = 0;
    };
    /// In the order of their colours' numbers.
    [[nodiscard]] const std::vector<Worker>& shares() const { return shares_; }

private:
    struct Cell {
        float cost = 0; ///< seconds per pixel; 0: not rendered yet
        std::uint16_t worker = 0;
    };
    [[nodiscard]] std::size_t number_of(const std::string& worker);
    template <class ColourOf>
    [[nodiscard]] LevelsPicture painted(ColourOf colour_of) const;

    PixelRect crop_;
    protocol::CellGrid grid_;
    std::vector<Cell> cells_;
    std::vector<Worker> shares_;
    std::map<std::string, std::size_t> numbers_;
};

} // namespace fraja::client
