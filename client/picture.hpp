// Picture: a job's tiles on a film, and the file that is made of them.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/result.hpp"
#include "common/image/film.hpp"
#include "common/image/pass_film.hpp"
#include "common/image_io/picture_file.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fraja::client {

/// What is thought of a picture that is adaptive or has a time limit.
struct Estimate {
    double samples = 0;   ///< per pixel
    double rms_error = 0; ///< over its pixels and colours, in units of the radiance
    /// Pixels that have as many samples as may be and are still worse than was asked for.
    std::uint64_t pixels_at_ceiling = 0;
};

class Picture {
public:
    /// `settings` must be valid. Allocates the film.
    explicit Picture(const protocol::PictureSettings& settings);

    /// The tile must have been checked against the job, as Follower does.
    /// `cell_count`: the job's.
    void place(const protocol::TileDone& tile, std::uint32_t cell_count);
    /// What was placed there is black until it is placed anew. Not of a picture with a time limit.
    void withdraw(const PixelRect& rect);
    /// Of the region's pixels, those that there is anything of.
    [[nodiscard]] std::uint64_t pixels_placed() const { return pixels_placed_; }
    [[nodiscard]] const Film& film() const { return passes_ ? passes_->film() : film_; }

    /// Nothing where the settings do not ask for it, or pixels are missing.
    [[nodiscard]] std::optional<Estimate> estimate() const;

    /// Writes what is there of `job`, which the picture is of; `more_options` make it again beside
    /// the job's settings. Errors: as write_picture().
    [[nodiscard]] Result<void> write(const std::filesystem::path& path,
                                     const protocol::JobState& job,
                                     const PictureEncoding& encoding = {},
                                     const std::string& more_options = {}) const;

private:
    protocol::PictureSettings settings_;
    Film film_;
    std::optional<PassFilm> passes_; ///< instead of it, from the first tile of a pass on
    std::uint64_t pixels_placed_ = 0;
};

/// A file that is kept as current as its writing allows: at most twice a second, and never more
/// than a fifth of the time.
class PictureFile {
public:
    /// Call when the job is known; again, when another is: it starts anew.
    void begin(const protocol::JobState& job, std::filesystem::path path,
               const PictureEncoding& encoding = {});
    /// What is written down beside the pixels.
    void update(const protocol::JobState& job) { job_ = job; }
    /// There is more of the picture.
    void note_change() { changed_ = true; }
    /// Writes if that is due. Returns when it next is.
    [[nodiscard]] Result<Instant> tick(Instant now, const Picture& picture);
    /// Writes what is there, if anything is that was not written.
    [[nodiscard]] Result<void> finish(const Picture& picture);

private:
    std::filesystem::path path_;
    protocol::JobState job_;
    PictureEncoding encoding_;
    bool changed_ = false;
    Instant due_{};
};

} // namespace fraja::client
