#include "client/page/job_views.hpp"

#include "common/base/guarded.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

namespace fraja::client {
namespace {

/// Of the wall clock: so many revisions no earlier view has had, nor one of an earlier process.
std::uint64_t microseconds_now() {
    const auto since_1970 = std::chrono::system_clock::now().time_since_epoch();
    return static_cast<std::uint64_t>(
        std::chrono::duration_cast<std::chrono::microseconds>(since_1970).count());
}

} // namespace

JobViews::JobViews(JobViewLimits limits, Conversation conversation)
    : limits_(limits), conversation_(std::move(conversation)) {}

JobViews::~JobViews() {
    std::vector<std::unique_ptr<Entry>> all;
    {
        const std::scoped_lock lock(mutex_);
        all.swap(entries_);
    }
    for (const auto& entry : all)
        entry->view->leave();
}

Result<std::shared_ptr<Viewer>> JobViews::look_at(const JobId& job) {
    const std::scoped_lock lock(mutex_);
    for (const auto& entry : entries_)
        if (entry->view->job() == job && !entry->view->is_leaving())
            return std::make_shared<Viewer>(entry->view);
    if (!has_room())
        return Error{ErrorCode::limit_exceeded,
                     "This page shows " + std::to_string(limits_.views_max) +
                         " jobs at a time, and all are being looked at: close one, or wait."};
    auto entry = std::make_unique<Entry>();
    entry->view = std::make_shared<JobView>(
        job, microseconds_now(), [this, job](std::uint64_t pixels) { return admits(job, pixels); });
    auto viewer = std::make_shared<Viewer>(entry->view);
    start(*entry);
    entries_.push_back(std::move(entry));
    return viewer;
}

void JobViews::start(Entry& entry) {
    entry.thread = std::jthread([this, view = entry.view] {
        const auto outcome = guarded([&]() -> Result<Outcome> { return conversation_(*view); });
        view->end(outcome ? *outcome : Outcome{ExitCode::refused, outcome.error().message});
    });
}

/// Where there is none, what nobody has looked at for the longest time goes.
bool JobViews::has_room() {
    const auto goes_on = [](const auto& entry) { return !entry->view->is_leaving(); };
    if (std::cmp_less(std::ranges::count_if(entries_, goes_on), limits_.views_max))
        return true;
    Entry* idle = nullptr;
    for (const auto& entry : entries_)
        if (goes_on(entry) && entry->view->viewers == 0 &&
            (!idle || entry->unseen_since < idle->unseen_since))
            idle = entry.get();
    if (idle)
        idle->view->leave();
    return idle != nullptr;
}

bool JobViews::admits(const JobId& job, std::uint64_t pixels) const {
    const std::scoped_lock lock(mutex_);
    std::uint64_t others = 0;
    for (const auto& entry : entries_)
        if (entry->view->job() != job && !entry->view->is_leaving())
            others += entry->view->pixels();
    return others == 0 || others + pixels <= limits_.pixels_max;
}

std::shared_ptr<JobView> JobViews::find(const JobId& job) const {
    const std::scoped_lock lock(mutex_);
    for (const auto& entry : entries_)
        if (entry->view->job() == job && !entry->view->is_leaving())
            return entry->view;
    return nullptr;
}

void JobViews::tidy(Instant now) {
    const std::scoped_lock lock(mutex_);
    for (const auto& entry : entries_) {
        if (entry->view->viewers > 0)
            entry->unseen_since = Instant::never();
        else if (entry->unseen_since == Instant::never())
            entry->unseen_since = now;
        else if (now - entry->unseen_since >= limits_.idle_max)
            entry->view->leave();
    }
    std::erase_if(entries_, [](const auto& entry) {
        return entry->view->is_leaving() && entry->view->ended().has_value();
    });
}

void JobViews::farm_changed(const protocol::FarmState& farm) {
    const std::scoped_lock lock(mutex_);
    for (const auto& entry : entries_) {
        JobView& view = *entry->view;
        const auto ended = view.ended();
        if (!ended || view.is_leaving() || view.viewers == 0)
            continue;
        const auto job = std::ranges::find(farm.jobs, view.job(), &protocol::JobState::job);
        if (job == farm.jobs.end() || (is_over(job->phase) && has_brought_all(*ended)))
            continue;
        entry->thread.join(); // it has ended
        view.begin_again();
        start(*entry);
    }
}

} // namespace fraja::client
