// PassFilm: a picture that is drawn over and over, each time with other samples.
#pragma once

#include "common/image/film.hpp"

#include <cstdint>
#include <vector>

namespace fraja {

/// Adds whole passes up, in their order, so that the same passes give the same bits, whenever their
/// tiles come. What lies beyond the last whole pass waits, and is left out in the end: a picture
/// of even quality. Only of the first pass each tile is seen at once.
class PassFilm {
public:
    /// `samples`: of each pass. A pass consists of `tiles` tiles that cover the region.
    PassFilm(Extent size, PixelRect region, std::vector<std::uint32_t> samples, std::size_t tiles);

    /// Each tile of each pass once, in any order, with its variance and cut. `rgb` are the means of
    /// the pass's samples.
    void place(std::uint32_t pass, Tile tile);

    /// With each pixel's samples and error.
    [[nodiscard]] const Film& film() const { return film_; }
    [[nodiscard]] std::uint32_t passes_done() const { return passes_done_; }

private:
    struct Pixel {
        double rgb[3] = {}, cut = 0; ///< sums over the samples
        double squares = 0;          ///< of the samples' distances from their mean, likewise
        double variance_of_mean = 0; ///< from how far it moved with each pass
    };
    void add(const Tile& tile);
    [[nodiscard]] Tile seen_first(const Tile& tile) const;

    PixelRect region_;
    std::vector<std::uint32_t> samples_;
    std::size_t tiles_;
    std::vector<Pixel> pixels_;
    std::vector<std::vector<Tile>> waiting_; ///< by pass
    std::uint32_t passes_done_ = 0, samples_done_ = 0;
    Film film_;
};

} // namespace fraja
