// FilmProgress: how far a film is, and when it is to be said.
#pragma once

#include "client/console.hpp"
#include "client/options.hpp"
#include "client/progress.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

namespace fraja::client {

/// Sums over the frames that are to be drawn.
struct FilmMoment {
    std::size_t frame_count = 0;
    std::size_t written = 0, given_up = 0, at_hand = 0;
    double share_at_hand = 0, share_per_s = 0; ///< of those at hand, each 1 when it is drawn
    std::uint32_t worker_count = 0;
    std::uint64_t rays = 0;
};

struct FilmView {
    std::string film_name;
    FilmId film;
    FilmMoment moment;
    double share = 0;      ///< of all, 0 to 1
    double rays_per_s = 0; ///< 0: not known
    Duration elapsed{};
    std::optional<Duration> remaining;

    [[nodiscard]] bool is_over() const {
        return moment.written + moment.given_up == moment.frame_count;
    }
    /// 100 at the end alone: a frame whose tiles are here has still to be written.
    [[nodiscard]] unsigned percent() const;
};

/// `cone  3 of 24 frames, 4 at hand  17%  6 workers  38.1 Mray/s  0:42 < 3:25`
[[nodiscard]] std::string film_line(const FilmView& view);

class FilmProgress {
public:
    /// `mode` must not be automatic. The console must outlive this.
    FilmProgress(Console& console, ProgressMode mode, std::string film_name, FilmId film,
                 Instant now);

    /// Takes note of it, and says what is due.
    void update(Instant now, const FilmMoment& moment);

    [[nodiscard]] const FilmView& view() const { return view_; }

private:
    void show(Instant now);

    Console& console_;
    const ProgressMode mode_;
    const Instant begin_;
    PlainPace pace_;
    FilmView view_;
    RateMeter rate_;
    Remaining remaining_{Remaining::Of::film};
    std::string shown_;
};

} // namespace fraja::client
