#include "client/farm_screen.hpp"

#include "client/columns.hpp"
#include "client/table.hpp"
#include "common/base/assert.hpp"
#include "common/base/text.hpp"

#include <algorithm>
#include <fmt/core.h>
#include <numeric>
#include <utility>

namespace fraja::client {
namespace {

using Lines = std::vector<std::string>;

Lines lines_of(std::string_view text) {
    Lines lines;
    while (!text.empty()) {
        const std::size_t end = std::min(text.find('\n'), text.size() - 1);
        lines.emplace_back(text.substr(0, end));
        text.remove_prefix(end + 1);
    }
    return lines;
}

/// How many of `count` entries are shown in `room` lines, below a heading, and above a line that
/// counts the others where there are any.
std::size_t shown_count(std::size_t count, std::size_t room) {
    if (count + 1 <= room)
        return count;
    return room > 2 ? room - 2 : 0;
}

void append_more(Lines& lines, std::size_t more, std::string_view what) {
    if (more > 0)
        lines.push_back("and " + counted(more, "more " + std::string(what)));
}

Lines jobs_part(std::vector<protocol::JobState> jobs, std::size_t room) {
    std::ranges::sort(jobs, [](const auto& a, const auto& b) {
        return std::pair(is_over(b.phase), a.number) > std::pair(is_over(a.phase), b.number);
    });
    const std::size_t count = jobs.size(), shown = shown_count(count, room);
    jobs.resize(shown);
    Lines lines = shown > 0 || count == 0 ? lines_of(jobs_table(jobs)) : Lines{};
    append_more(lines, count - shown, "job");
    return lines;
}

Lines workers_part(std::vector<protocol::WorkerState> workers, std::size_t room) {
    std::ranges::stable_sort(workers, {}, &protocol::WorkerState::worker_name);
    const std::size_t count = workers.size(), shown = shown_count(count, room);
    workers.resize(shown);
    Lines lines = shown > 0 || count == 0 ? lines_of(workers_table(workers)) : Lines{};
    append_more(lines, count - shown, "worker");
    return lines;
}

std::string title(const FarmView& view) {
    const auto& jobs = view.farm.jobs;
    const auto& workers = view.farm.workers;
    const auto open = std::ranges::count_if(jobs, [](const auto& j) { return !is_over(j.phase); });
    const auto threads =
        std::transform_reduce(workers.begin(), workers.end(), std::uint64_t{0}, std::plus<>(),
                              [](const auto& w) { return w.threads; });
    return fmt::format("{}, {} not over; {}, {}    (q leaves)", counted(jobs.size(), "job"), open,
                       counted(workers.size(), "worker"), counted(threads, "thread"));
}

std::string broker_table(const FarmView& view) {
    return brokers_table({{view.broker, view.known ? std::optional(view.farm) : std::nullopt,
                           view.connected ? "" : "looking for it"}});
}

} // namespace

std::string farm_page(const FarmView& view) {
    FRAJA_ASSERT(view.known);
    return broker_table(view) + "\n" + jobs_table(view.farm.jobs) + "\n" +
           workers_table(view.farm.workers);
}

std::vector<std::string> farm_screen(const FarmView& view, const Window& window) {
    Lines lines;
    const auto add = [&lines](const Lines& more) {
        lines.insert(lines.end(), more.begin(), more.end());
    };
    add({title(view)});
    add(lines_of(broker_table(view)));
    if (view.known) {
        const std::size_t taken = lines.size() + 2; // with the lines between the parts
        const std::size_t room = window.rows > taken ? window.rows - taken : 0;
        const std::size_t jobs = view.farm.jobs.size() + 1, workers = view.farm.workers.size() + 1;
        const std::size_t for_jobs =
            std::min(jobs, std::max(room / 2, room > workers ? room - workers : 0));
        add({""});
        add(jobs_part(view.farm.jobs, for_jobs));
        add({""});
        add(workers_part(view.farm.workers, room - for_jobs));
    }
    if (lines.size() > window.rows)
        lines.resize(window.rows);
    for (std::string& line : lines)
        line = first_columns(line, window.columns);
    return lines;
}

} // namespace fraja::client
