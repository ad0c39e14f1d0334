#include "client/page/viewer_lines.hpp"

#include <chrono>
#include <utility>

namespace fraja::client {
namespace {

constexpr Duration beat_pause = std::chrono::seconds(3);

void add_if_new(std::string& lines, const Shown& shown, std::uint64_t& seen) {
    if (shown.version == std::exchange(seen, shown.version))
        return;
    lines += *shown.text;
    lines += '\n';
}

} // namespace

ViewerLines::ViewerLines(FarmBoard& board, std::shared_ptr<Viewer> viewer)
    : board_(board), viewer_(std::move(viewer)) {}

std::string ViewerLines::next(Instant now) {
    std::string lines;
    add_if_new(lines, board_.shown(), farm_seen_);
    if (viewer_)
        add_if_new(lines, viewer_->view().shown(), job_seen_);
    if (lines.empty() && now >= beat_due_)
        lines = "{}\n";
    if (!lines.empty())
        beat_due_ = now + beat_pause;
    return lines;
}

} // namespace fraja::client
