#include "client/progress.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <array>
#include <fmt/core.h>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration rate_window = 5s;
constexpr Duration plain_silence_max = 30s;

} // namespace

std::string format_rate(double rays_per_s) {
    constexpr std::array<const char*, 5> prefixes = {"", "k", "M", "G", "T"};
    std::size_t power = 0;
    while (rays_per_s >= 999.5 && power + 1 < prefixes.size()) {
        rays_per_s /= 1000;
        ++power;
    }
    const int decimals = power == 0 || rays_per_s >= 99.95 ? 0 : rays_per_s >= 9.995 ? 1 : 2;
    return fmt::format("{:.{}f} {}ray/s", rays_per_s, decimals, prefixes[power]);
}

std::string format_pace(double rays_per_s, Duration elapsed, std::optional<Duration> remaining) {
    return (rays_per_s > 0 ? "  " + format_rate(rays_per_s) : "") + "  " +
           format_duration(elapsed) + (remaining ? " < " + format_duration(*remaining) : "");
}

double share_done(const protocol::JobState& s) {
    if (!s.settings.limited_in_time())
        return std::clamp(s.share_done, 0.0, 1.0);
    const double tiles = s.cell_count > 0 ? static_cast<double>(s.done_count) / s.cell_count : 0;
    if (s.phase == protocol::JobPhase::done)
        return 1;
    if (s.done_count == 0 && s.in_flight_count == 0)
        return 0; // its time passes, and nobody is at it
    // The last moments are the first pass's, if it takes longer than there was time.
    return std::clamp(seconds(s.elapsed) / seconds(s.settings.time_limit), tiles, 0.99);
}

double share_per_s(const protocol::JobState& s) {
    if (!s.settings.limited_in_time())
        return std::max(0.0, s.share_per_s);
    return s.phase == protocol::JobPhase::running ? 1 / seconds(s.settings.time_limit) : 0;
}

std::string progress_line(const ProgressView& v) {
    std::string line = fmt::format("{} #{}  {}%", v.job_name, v.number, v.percent());
    if (!v.connected)
        line += "  broker lost, looking for it";
    else if (v.phase == protocol::JobPhase::waiting_for_scene)
        line += "  waiting for its scene";
    else if (v.worker_count == 0 && !is_over(v.phase))
        line += "  waiting for workers";
    else if (v.worker_count > 0)
        line += "  " + counted(v.worker_count, "worker");
    return line + format_pace(v.rays_per_s, v.elapsed, v.remaining);
}

void RateMeter::update(Duration elapsed, std::uint64_t rays) {
    samples_.push_back({elapsed, rays});
    while (samples_.size() > 2 && samples_[1].elapsed <= elapsed - rate_window)
        samples_.pop_front();
}

bool RateMeter::goes_on(Duration elapsed, std::uint64_t rays) const {
    return samples_.empty() || (elapsed >= samples_.back().elapsed && rays >= samples_.back().rays);
}

double RateMeter::since(const Sample& first) const {
    if (samples_.empty())
        return 0;
    const double span = seconds(samples_.back().elapsed - first.elapsed);
    return span > 0.01 ? static_cast<double>(samples_.back().rays - first.rays) / span : 0;
}

double RateMeter::rays_per_s() const {
    return samples_.empty() ? 0 : since(samples_.front());
}

double RateMeter::mean_rays_per_s() const {
    return since({});
}

void ProgressMeter::update(const protocol::JobState& s) {
    view_.job = s.job;
    view_.job_name = s.job_name;
    view_.number = s.number;
    view_.phase = s.phase;
    view_.done_count = s.done_count;
    view_.cell_count = s.cell_count;
    view_.share = share_done(s);
    view_.worker_count = s.worker_count;
    view_.elapsed = s.elapsed;

    if (!rate_.goes_on(s.elapsed, s.rays.total()))
        rate_ = {}, remaining_ = Remaining(); // another broker, or one without a memory
    rate_.update(s.elapsed, s.rays.total());
    remaining_.update(s.elapsed, view_.share, share_per_s(s));
    view_.rays_per_s = is_over(s.phase) ? rate_.mean_rays_per_s() : rate_.rays_per_s();
    view_.remaining = is_over(s.phase) ? std::nullopt : remaining_.left();
}

bool PlainPace::is_due(Instant now, unsigned percent) {
    if (percent / 10 <= tens_ && now < next_deadline())
        return false;
    tens_ = percent / 10;
    said_ = now;
    return true;
}

Instant PlainPace::next_deadline() const {
    return said_ + plain_silence_max;
}

} // namespace fraja::client
