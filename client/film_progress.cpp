#include "client/film_progress.hpp"

#include "client/json.hpp"
#include "common/base/text.hpp"

#include <algorithm>
#include <fmt/core.h>
#include <utility>

namespace fraja::client {

unsigned FilmView::percent() const {
    return std::min(ProgressView::percent_of(share), is_over() ? 100u : 99u);
}

std::string film_line(const FilmView& v) {
    std::string line = fmt::format("{}  {} of {}", printable(v.film_name), v.moment.written,
                                   counted(v.moment.frame_count, "frame"));
    if (v.moment.at_hand > 0)
        line += fmt::format(", {} at hand", v.moment.at_hand);
    line += fmt::format("  {}%", v.percent());
    if (v.moment.worker_count > 0)
        line += "  " + counted(v.moment.worker_count, "worker");
    return line + format_pace(v.rays_per_s, v.elapsed, v.remaining);
}

FilmProgress::FilmProgress(Console& console, ProgressMode mode, std::string film_name, FilmId film,
                           Instant now)
    : console_(console), mode_(mode), begin_(now), pace_(now) {
    FRAJA_ASSERT(mode != ProgressMode::automatic);
    view_.film_name = std::move(film_name);
    view_.film = film;
}

void FilmProgress::update(Instant now, const FilmMoment& moment) {
    const auto frames = static_cast<double>(std::max<std::size_t>(moment.frame_count, 1));
    const auto ended = static_cast<double>(moment.written + moment.given_up);
    view_.moment = moment;
    view_.elapsed = now - begin_;
    view_.share = std::clamp((ended + moment.share_at_hand) / frames, 0.0, 1.0);
    if (!rate_.goes_on(view_.elapsed, moment.rays))
        rate_ = {}; // a broker without a memory
    rate_.update(view_.elapsed, moment.rays);
    remaining_.update(view_.elapsed, view_.share, moment.share_per_s / frames);
    view_.rays_per_s = view_.is_over() ? rate_.mean_rays_per_s() : rate_.rays_per_s();
    view_.remaining = view_.is_over() ? std::nullopt : remaining_.left();
    show(now);
}

void FilmProgress::show(Instant now) {
    const std::string line = film_line(view_);
    if (mode_ == ProgressMode::bar)
        console_.redraw(line);
    else if (mode_ == ProgressMode::plain && pace_.is_due(now, view_.percent()))
        console_.line(line);
    else if (mode_ == ProgressMode::json && (line != shown_ || view_.is_over()))
        console_.line(film_progress_json(view_));
    shown_ = line;
}

} // namespace fraja::client
