#include "client/page/farm_board.hpp"

#include <chrono>
#include <utility>

namespace fraja::client {
namespace {

constexpr Duration tidy_pause = std::chrono::seconds(1);

} // namespace

FarmBoard::FarmBoard(FarmPage page, JobViews& views) : views_(views), page_(std::move(page)) {}

void FarmBoard::hear(Instant, const News& news) {
    const auto* farm = std::get_if<FarmChanged>(&news);
    const auto* connection = std::get_if<ConnectionChanged>(&news);
    if (farm)
        views_.farm_changed(farm->farm);
    const std::scoped_lock lock(mutex_);
    if (farm && farm->farm != page_.farm) {
        page_.farm = farm->farm;
        std::map<JobId, ProgressMeter> meters;
        for (const auto& job : page_.farm.jobs) {
            meters[job.job] = std::move(page_.meters[job.job]);
            meters[job.job].update(job);
        }
        page_.meters = std::move(meters);
        text_.change();
    } else if (connection) {
        page_.connected = connection->connected;
        page_.broker = connection->broker;
        text_.change();
    }
}

Instant FarmBoard::tick(Instant now) {
    views_.tidy(now);
    return now + tidy_pause;
}

Shown FarmBoard::shown() {
    const std::scoped_lock lock(mutex_);
    return text_.look([this] { return farm_line(page_); });
}

} // namespace fraja::client
