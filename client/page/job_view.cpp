#include "client/page/job_view.hpp"

#include "client/page/page_json.hpp"
#include "common/net/clock.hpp"

#include <algorithm>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration snapshot_pause = 300ms; // at least, and four times what the last one took
constexpr Duration leave_pause = 250ms;    // until it is seen that nobody looks any more

Error nothing_yet() {
    return {ErrorCode::not_found, "There is nothing of this picture yet."};
}

} // namespace

bool has_brought_all(const Outcome& outcome) {
    return outcome.code == ExitCode::done || outcome.code == ExitCode::job_failed ||
           outcome.code == ExitCode::cancelled;
}

JobView::JobView(JobId job, std::uint64_t earlier, std::function<bool(std::uint64_t)> admits)
    : job_(job), admits_(std::move(admits)), revision_(earlier) {}

void JobView::hear(Instant, const News& news) {
    if (const auto* accepted = std::get_if<Accepted>(&news)) {
        pixels_ = accepted->state.settings.crop.pixel_count();
        refused_ = !admits_(pixels_);
        if (refused_) {
            pixels_ = 0;
            return;
        }
    }
    if (refused_)
        return;
    const std::scoped_lock lock(mutex_);
    std::visit([this](const auto& n) { take(n); }, news);
    text_.change();
}

void JobView::take(const Accepted& news) {
    state_ = news.state;
    meter_ = {};
    meter_.update(news.state);
    map_.reset();
    picture_.emplace(news.state.settings);
    snapshot_.reset();
    snapshot_due_ = {};
    connected_ = true;
}

void JobView::take(const TileArrived& news) {
    if (!map_)
        map_.emplace(state_->settings.crop, state_->cell_side);
    picture_->place(news.tile, news.cell_count);
    map_->add(news.tile);
    changed_ = true;
}

void JobView::take(const TilesWithdrawn& news) {
    for (const PixelRect& rect : news.rects) {
        picture_->withdraw(rect);
        map_->withdraw(rect);
    }
    changed_ = true;
}

void JobView::take(const StateChanged& news) {
    state_ = news.state;
    meter_.update(news.state);
}

void JobView::take(const ConnectionChanged& news) {
    connected_ = news.connected;
}

Instant JobView::tick(Instant now) {
    const std::scoped_lock lock(mutex_);
    if (!changed_ || viewers == 0)
        return now + leave_pause;
    if (now >= snapshot_due_) {
        const Instant begin = net::now();
        make_snapshot();
        const Duration took = net::now() - begin;
        snapshot_due_ = now + took + std::max<Duration>(snapshot_pause, 4 * took);
    }
    return std::min(now + leave_pause, snapshot_due_);
}

void JobView::make_snapshot() {
    const Film& film = picture_->film();
    scale_ = map_->scale();
    snapshot_.reset(new Snapshot{++revision_,
                                 {overview_of(film, overview_scale(film.region())), "jpg"},
                                 {map_->costs(), "png"},
                                 {map_->workers(), "png"}});
    changed_ = false;
    text_.change();
}

std::optional<Outcome> JobView::wants_to_leave() {
    if (refused_)
        return Outcome{ExitCode::refused,
                       "This page holds as many pixels as it may: close other pictures first."};
    return leaving_ ? std::optional(Outcome{}) : std::nullopt;
}

void JobView::end(const Outcome& outcome) {
    const std::scoped_lock lock(mutex_);
    if (changed_)
        make_snapshot();
    ended_ = outcome;
    text_.change();
}

void JobView::begin_again() {
    refused_ = false;
    const std::scoped_lock lock(mutex_);
    ended_.reset();
    text_.change();
}

std::optional<Outcome> JobView::ended() const {
    const std::scoped_lock lock(mutex_);
    return ended_;
}

Shown JobView::shown() {
    const std::scoped_lock lock(mutex_);
    return text_.look([this] { return described(); });
}

std::string JobView::described() const {
    JobPage page{.job = job_,
                 .trouble = {},
                 .state = state_,
                 .progress = meter_.view(),
                 .connected = connected_,
                 .costs = scale_};
    page.complete = ended_ && has_brought_all(*ended_);
    if (ended_ && !page.complete)
        page.trouble = ended_->reason;
    if (snapshot_)
        page.revision = snapshot_->revision;
    if (state_)
        page.scale = overview_scale(state_->settings.crop);
    if (map_)
        page.map = &*map_;
    return job_line(page);
}

Result<JobView::LayerPicture> JobView::layer(Layer layer, std::uint64_t revision) {
    std::shared_ptr<Snapshot> snapshot;
    {
        const std::scoped_lock lock(mutex_);
        if (!snapshot_)
            return nothing_yet();
        snapshot = snapshot_;
        if (layer == Layer::pixels && !snapshot->pixels)
            snapshot->pixels.emplace(cut_out(picture_->film(), picture_->film().region()), "png");
    }
    EncodedOnce& picture = layer == Layer::overview  ? snapshot->overview
                           : layer == Layer::costs   ? snapshot->costs
                           : layer == Layer::workers ? snapshot->workers
                                                     : *snapshot->pixels;
    auto bytes = picture.bytes();
    if (!bytes)
        return bytes.error();
    return LayerPicture{*std::move(bytes), snapshot->revision == revision};
}

Result<http::Body> JobView::part(const PixelRect& part) {
    LevelsPicture levels;
    {
        const std::scoped_lock lock(mutex_);
        if (!snapshot_)
            return nothing_yet();
        if (part.empty() || !part.inside(picture_->film().region()) ||
            std::max(part.width, part.height) > overview_side_max)
            return Error{ErrorCode::invalid_argument,
                         "This part does not lie in the picture, or is wider or higher than " +
                             std::to_string(overview_side_max) + " pixels."};
        levels = cut_out(picture_->film(), part);
    }
    return encode_levels(levels, "jpg");
}

} // namespace fraja::client
