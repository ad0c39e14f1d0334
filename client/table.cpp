#include "client/table.hpp"

#include "client/columns.hpp"
#include "client/json.hpp"
#include "client/picture.hpp"
#include "client/progress.hpp"
#include "client/settings_text.hpp"
#include "common/base/text.hpp"

#include <algorithm>
#include <array>
#include <fmt/core.h>
#include <vector>

namespace fraja::client {
namespace {

using Row = std::vector<std::string>;

/// Columns as wide as their widest cell; the ones marked '>' are set right. The last cell of a row
/// that is cut short stands across the columns that it does not have.
std::string table_of(const std::vector<Row>& rows, std::string_view alignment) {
    std::vector<std::size_t> widths(alignment.size());
    const auto is_across = [&](const Row& row, std::size_t c) {
        return c + 1 == row.size() && row.size() < alignment.size();
    };
    for (const Row& row : rows)
        for (std::size_t c = 0; c < row.size() && !is_across(row, c); ++c)
            widths[c] = std::max(widths[c], columns_of(row[c]));
    std::string text;
    for (const Row& row : rows) {
        std::string line;
        for (std::size_t c = 0; c < row.size(); ++c) {
            const std::string gap(is_across(row, c) ? 0 : widths[c] - columns_of(row[c]), ' ');
            line += (c == 0 ? "" : "  ") + (alignment[c] == '>' ? gap + row[c] : row[c] + gap);
        }
        line.resize(line.find_last_not_of(' ') + 1);
        text += line + "\n";
    }
    return text;
}

} // namespace

std::string format_count(std::uint64_t count) {
    constexpr std::array<const char*, 7> prefixes = {"", "k", "M", "G", "T", "P", "E"};
    if (count < 1000)
        return std::to_string(count);
    auto value = static_cast<double>(count);
    std::size_t power = 0;
    while (value >= 999.5 && power + 1 < prefixes.size()) {
        value /= 1000;
        ++power;
    }
    return fmt::format("{:.{}f}{}", value,
                       value >= 99.95   ? 0
                       : value >= 9.995 ? 1
                                        : 2,
                       prefixes[power]);
}

std::string jobs_table(const std::vector<protocol::JobState>& jobs) {
    if (jobs.empty())
        return "no jobs\n";
    auto sorted = jobs;
    std::ranges::sort(sorted, std::ranges::greater{}, &protocol::JobState::number);
    std::vector<Row> rows = {
        {"JOB", "NAME", "STATE", "DONE", "IN FLIGHT", "WORKERS", "RAYS", "TIME", "ID"}};
    for (const auto& job : sorted) {
        const unsigned percent = ProgressView::percent_of(share_done(job));
        rows.push_back({"#" + std::to_string(job.number), shortened(job.job_name, 24),
                        std::string(to_string(job.phase)), std::to_string(percent) + "%",
                        std::to_string(job.in_flight_count), std::to_string(job.worker_count),
                        format_count(job.rays.total()), format_duration(job.elapsed),
                        fraja::to_string(job.job)});
    }
    return table_of(rows, "><<>>>>><");
}

namespace {

std::string state_of(const protocol::WorkerState& worker) {
    if (!worker.distrusted.empty())
        return "distrusted: " + shortened(printable(worker.distrusted), 60);
    if (worker.quarantined > Duration::zero())
        return "quarantined for " + format_duration(worker.quarantined);
    return worker.draining ? "draining" : worker.in_flight_count > 0 ? "busy" : "idle";
}

} // namespace

std::string workers_table(const std::vector<protocol::WorkerState>& workers) {
    if (workers.empty())
        return "no workers\n";
    auto sorted = workers;
    std::ranges::stable_sort(sorted, {}, &protocol::WorkerState::worker_name);
    std::vector<Row> rows = {
        {"WORKER", "THREADS", "CREDIT", "IN FLIGHT", "TILES", "RAYS", "STATE", "ID"}};
    for (const auto& worker : sorted)
        rows.push_back({shortened(worker.worker_name, 40), std::to_string(worker.threads),
                        std::to_string(worker.credit), std::to_string(worker.in_flight_count),
                        std::to_string(worker.tiles_done), format_count(worker.rays.total()),
                        state_of(worker), fraja::to_string(worker.worker)});
    return table_of(rows, "<>>>>><<");
}

namespace {

/// Of one that answers.
std::string state_of(const protocol::FarmState& farm) {
    if (!farm.broker.trouble.empty())
        return farm.broker.trouble;
    if (farm.brokers.empty())
        return "alone";
    const protocol::PeerState& own = farm.brokers.front();
    const auto missing = static_cast<std::size_t>(
        std::ranges::count(farm.brokers, false, &protocol::PeerState::is_here));
    return std::string(own.leads       ? "leads"
                       : own.is_synced ? "stands by"
                                       : "fetches what the others have") +
           (missing > 0 ? ", misses " + counted(missing, "other broker") : "");
}

} // namespace

std::string brokers_table(const std::vector<AskedBroker>& brokers) {
    std::vector<Row> rows = {
        {"BROKER", "STATE", "VERSION", "UP", "WORKERS", "THREADS", "CLIENTS", "JOBS", "ID"}};
    for (const auto& [endpoint, farm, trouble, also_at] : brokers) {
        if (!farm) {
            rows.push_back({shortened(endpoint, 60), printable(trouble)});
            continue;
        }
        const protocol::BrokerState& b = farm->broker;
        const std::string state = !trouble.empty() ? trouble : state_of(*farm);
        rows.push_back({shortened(endpoint, 60), printable(state), printable(b.program_version),
                        format_duration(b.uptime), std::to_string(b.workers),
                        std::to_string(b.threads), std::to_string(b.clients),
                        std::to_string(b.jobs), fraja::to_string(b.broker)});
    }
    return table_of(rows, "<<<>>>>><");
}

std::string stats_page(const protocol::FarmState& farm) {
    const protocol::BrokerState& b = farm.broker;
    const double up = std::max(seconds(b.uptime), 1e-9);
    std::string text =
        fmt::format("broker            {}, version {}, up {}\n"
                    "jobs              {} known, {} with tiles to give\n"
                    "jobs over         {} done, {} failed, {} cancelled\n"
                    "workers           {} with {}; {} lost\n"
                    "tiles             {} done, {} in flight\n"
                    "tiles again       {} requeued, {} failed, {} overbooked\n"
                    "tiles checked     {}; {} distrusted\n",
                    fraja::to_string(b.broker), printable(b.program_version),
                    format_duration(b.uptime), b.jobs, b.jobs_ready, b.jobs_done, b.jobs_failed,
                    b.jobs_cancelled, b.workers, counted(b.threads, "thread"), b.workers_lost,
                    b.tiles_done, b.tiles_in_flight, b.tiles_requeued, b.tiles_failed,
                    b.tiles_overbooked, b.tiles_checked, counted(b.workers_distrusted, "worker"));
    text += fmt::format("rays              {} ({} camera, {} reflected, {} refracted, {} shadow)\n"
                        "speed             {}, mean since the broker started\n"
                        "render time       {:.3f} s (summed over render threads)\n",
                        b.rays.total(), b.rays.camera, b.rays.reflected, b.rays.refracted,
                        b.rays.shadow, format_rate(static_cast<double>(b.rays.total()) / up),
                        seconds(b.render_time));
    if (!b.trouble.empty())
        text += "store             " + printable(b.trouble) + "\n";
    return text;
}

std::string tile_line(const protocol::TileDone& tile) {
    return fmt::format("{:>11}  {:<9}  {:<16}  {:>9.3f} s  {:>10} rays",
                       fmt::format("{},{}", tile.rect.x, tile.rect.y),
                       fmt::format("{}x{}", tile.rect.width, tile.rect.height),
                       printable(tile.worker_name), seconds(tile.elapsed), tile.rays.total());
}

namespace {

/// Where tiles are to be checked, and nothing has come of that: chance has picked none.
std::string none_picked(const protocol::JobState& s) {
    if (s.verify == 0 || s.checks != protocol::CheckCounts{})
        return {};
    return fmt::format(" (--verify {}: none {})", s.verify,
                       is_over(s.phase) ? "was picked" : "so far");
}

} // namespace

std::string job_page(const protocol::JobState& s) {
    std::string text =
        fmt::format("job       #{} {}\nid        {}\nstate     {}\n", s.number,
                    printable(s.job_name), fraja::to_string(s.job), to_string(s.phase));
    if (s.film != FilmId{})
        text += fmt::format("film      {}, frame {}\n", fraja::to_string(s.film), s.frame);
    if (!s.reason.empty())
        text += fmt::format("reason    {}\n", printable(s.reason));
    const auto& p = s.settings;
    text += fmt::format("scene     {}\npicture   {}x{}", fraja::to_string(s.scene), p.size.width,
                        p.size.height);
    if (p.crop.pixel_count() != p.size.pixel_count())
        text += fmt::format(", of it {},{},{},{}", p.crop.x, p.crop.y, p.crop.width, p.crop.height);
    text += fmt::format("\nsettings  {}\n", settings_text(p));
    text += fmt::format("priority  {}\n", s.priority);
    text += fmt::format("done      {} of {} of {}x{} pixels, {:.1f}% of the work; {} in "
                        "flight at {}\n",
                        s.done_count, counted(s.cell_count, "cell"), s.cell_side, s.cell_side,
                        100 * s.share_done, counted(s.in_flight_count, "tile"),
                        counted(s.worker_count, "worker"));
    if (s.copies_wanted > 0)
        text += fmt::format("kept by   {} of {} brokers\n", s.copies + 1, s.copies_wanted + 1);
    if (s.verify > 0 || s.checks != protocol::CheckCounts{})
        text += fmt::format("checked   {}{}{}\n", counted(s.checks.agreed, "tile"), none_picked(s),
                            s.checks.unchecked == 0
                                ? ""
                                : fmt::format("; {} had no second worker", s.checks.unchecked));
    for (const protocol::Distrusted& who : s.distrusted)
        text += fmt::format("distrusts {} {} ({})\n", printable(who.worker_name),
                            fraja::to_string(who.worker), printable(who.reason));
    text += fmt::format("rays      {} ({} camera, {} reflected, {} refracted, {} shadow)\n",
                        s.rays.total(), s.rays.camera, s.rays.reflected, s.rays.refracted,
                        s.rays.shadow);
    if (p.kernel == protocol::KernelChoice::fast)
        text += fmt::format("tests     {} against boxes, {} against surfaces\n"
                            "shaded    {} hits\n"
                            "pixels    {} skipped, {} truncated\n",
                            s.rays.box_tests, s.rays.form_tests, s.rays.shaded,
                            s.rays.skipped_pixels, s.rays.truncated_pixels);
    return text + fmt::format("time      {:.3f} s, of rendering {:.3f} s\n", seconds(s.elapsed),
                              seconds(s.render_time));
}

namespace {

std::string checks_page(const protocol::JobState& s) {
    if (s.verify == 0 && s.checks == protocol::CheckCounts{} && s.distrusted.empty())
        return {};
    const std::string none = none_picked(s);
    std::string text = fmt::format(
        "tiles checked     {}{}\n"
        "tiles unchecked   {}{}\n",
        s.checks.agreed, none.empty() ? " (drawn by two workers, the same)" : none,
        s.checks.unchecked, s.checks.unchecked == 0 ? "" : " (there was no second worker)");
    for (const protocol::Distrusted& who : s.distrusted)
        text += "distrusted        " + printable(who.worker_name) + "\n";
    return text;
}

} // namespace

std::string counts_page(const protocol::JobState& s) {
    const protocol::Rays& r = s.rays;
    std::string text = checks_page(s);
    text += fmt::format("rays camera       {}\n"
                        "rays reflected    {}\n"
                        "rays refracted    {}\n"
                        "rays traced       {}\n"
                        "rays shadow       {}\n"
                        "rays total        {}\n",
                        r.camera, r.reflected, r.refracted, r.traced(), r.shadow, r.total());
    if (s.settings.kernel == protocol::KernelChoice::reference)
        return text;
    text +=
        fmt::format("tests box         {} (rays tested against a box)\n"
                    "tests form        {} (rays tested against a surface)\n"
                    "hits shaded       {}\n"
                    "pixels skipped    {} (of background or one plane, known without a search)\n"
                    "pixels truncated  {}\n",
                    r.box_tests, r.form_tests, r.shaded, r.skipped_pixels, r.truncated_pixels);
    if (r.truncated_pixels > 0)
        text += fmt::format("In {} a sample ran out of its budget of rays, and what was "
                            "left of it stayed black; a lower --depth avoids that.\n",
                            counted(r.truncated_pixels, "pixel"));
    return text;
}

} // namespace fraja::client
