#include "client/progress_report.hpp"

#include "client/json.hpp"

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration bar_pause = 100ms;
constexpr Duration json_pause = 500ms;

} // namespace

ProgressReport::ProgressReport(Console& console, ProgressMode mode, Instant now)
    : console_(console), mode_(mode), pace_(now) {
    FRAJA_ASSERT(mode != ProgressMode::automatic);
}

ProgressMode ProgressReport::chosen(ProgressMode mode, const Console& console) {
    if (mode != ProgressMode::automatic)
        return mode;
    return console.is_terminal() ? ProgressMode::bar : ProgressMode::plain;
}

void ProgressReport::update(const protocol::JobState& state) {
    meter_.update(state);
    known_ = changed_ = true;
}

void ProgressReport::set_connected(bool connected) {
    meter_.set_connected(connected);
    changed_ = true;
}

Instant ProgressReport::tick(Instant now) {
    if (!known_)
        return Instant::never();
    if (mode_ == ProgressMode::plain) {
        if (pace_.is_due(now, view().percent()))
            console_.line(progress_line(view()));
        return pace_.next_deadline();
    }
    if (mode_ == ProgressMode::none || !changed_)
        return Instant::never();
    const Instant due = shown_ + (mode_ == ProgressMode::bar ? bar_pause : json_pause);
    if (now < due)
        return due;
    shown_ = now;
    changed_ = false;
    if (mode_ == ProgressMode::bar)
        console_.redraw(progress_line(view()));
    else
        console_.line(progress_json(view()));
    return Instant::never();
}

void ProgressReport::finish(Instant now) {
    shown_ = Instant{} - 1h;
    (void)tick(now);
    if (mode_ == ProgressMode::bar)
        console_.end_redraw();
}

} // namespace fraja::client
