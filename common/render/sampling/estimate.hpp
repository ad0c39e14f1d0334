// How far a pixel's value may be from what ever more samples would make of it.
//
// An Owen-scrambled Sobol sequence of N samples, a power of two, is four sequences of N/4, each
// evenly spread: how far their means lie apart tells how good the mean of all is. That is noisy for
// one pixel, so what was told of fewer samples counts, too. What no sample has met is guessed from
// the contrast of the samples around.
#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace fraja {

/// Samples that every pixel gets.
inline constexpr std::uint32_t base_samples = 4;

/// What a pixel's first samples say to those beside it.
struct BaseSamples {
    std::array<float, 3> low{}, high{}; ///< of their radiance
    std::uint64_t path = 0;             ///< what they met
    bool one_path = true;               ///< all the same
    void add(std::span<const double> rgb, std::span<const std::uint64_t> paths, bool first);
    /// What these and others say together.
    void join(const BaseSamples& other);
    /// How much they differ, in what can be seen: root of the mean square over the colours.
    [[nodiscard]] double contrast() const;
};

/// A pixel's samples so far.
class PixelSamples {
public:
    explicit PixelSamples(std::uint32_t expected = base_samples) : expected_(expected) {}

    /// The next of the samples expected. `cut`: the light that rays below the cut level may have
    /// been; may be empty.
    void add(std::span<const double> rgb, std::span<const double> cut);
    /// As many again are expected.
    void double_expected();
    /// All those expected are here, at least 4.
    void judge();

    [[nodiscard]] std::uint32_t count() const { return count_; }
    [[nodiscard]] std::array<double, 3> mean() const;
    /// What the error is thought to be at most: root of the mean square over the colours, of what
    /// can be seen. `around`: of the pixel and its eight neighbours.
    [[nodiscard]] double bound(const BaseSamples& around) const;
    /// What it is thought to be.
    [[nodiscard]] double error(const BaseSamples& around) const;
    /// The samples' standard deviation, of what can be seen.
    [[nodiscard]] double spread() const;
    /// The light that rays below the cut level are thought to have been.
    [[nodiscard]] double cut() const;

private:
    [[nodiscard]] double variance_between_quarters(std::size_t c) const;
    [[nodiscard]] double visible_mean(const std::array<double, 3>& variances) const;

    std::array<std::array<double, 3>, 4> quarters_{}; ///< sums
    std::array<double, 3> squares_{};
    double cut_ = 0;
    std::array<double, 3> variance_of_mean_{}; ///< after the last judge()
    bool judged_ = false;
    std::uint32_t count_ = 0, expected_;
};

} // namespace fraja
