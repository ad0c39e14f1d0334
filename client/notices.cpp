#include "client/notices.hpp"

#include "client/json.hpp"
#include "client/progress.hpp"
#include "common/base/assert.hpp"
#include "common/base/text.hpp"
#include "common/protocol/reasons.hpp"

#include <algorithm>
#include <fmt/core.h>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration look_pause = 50ms; // whether it is known what hinders
/// For that the notice waits: so long a connection may take to fail.
constexpr Duration hindrance_wait_max = 1500ms;
constexpr std::size_t unanswered_told_max = 8;

} // namespace

void tell(Console& console, ProgressMode mode, std::string_view event, const std::string& text) {
    if (mode == ProgressMode::json)
        console.line(event_json(event, text));
    else
        console.info(text);
}

SearchNotice::SearchNotice(Console& console, ProgressMode mode, std::vector<std::string> brokers,
                           Instant now)
    : console_(console), mode_(mode), brokers_(std::move(brokers)),
      due_(mode == ProgressMode::none ? Instant::never() : now + unsaid_max) {
    FRAJA_ASSERT(mode != ProgressMode::automatic);
}

Instant SearchNotice::tick(Instant now) {
    if (now < due_)
        return due_;
    if (!reaching_) {
        reaching_ = std::make_unique<Reaching>(brokers_);
        said_by_ = now + hindrance_wait_max;
    }
    const auto hindrances = reaching_->hindrances();
    if (!hindrances && now < said_by_)
        return due_ = std::min(now + look_pause, said_by_);
    due_ = Instant::never();
    say(hindrances.value_or(std::vector<std::string>(brokers_.size())));
    return due_;
}

void SearchNotice::say(const std::vector<std::string>& hindrances) {
    std::string where;
    for (std::size_t i = 0; i < brokers_.size(); ++i)
        where += (i == 0 ? "" : ", ") + brokers_[i] +
                 (hindrances[i].empty() ? "" : " (" + hindrances[i] + ")");
    const std::string text = "looking for a broker at " + where + " ...";
    drawn_ = mode_ == ProgressMode::bar;
    if (drawn_)
        console_.redraw(printable(text));
    else
        tell(console_, mode_, "looking_for_broker", text);
}

void SearchNotice::end() {
    due_ = Instant::never();
    reaching_.reset();
    if (std::exchange(drawn_, false))
        console_.redraw("");
}

void SearchNotice::warn_of(const std::string& broker) {
    if (!std::exchange(warned_, true))
        console_.warning("found the broker at " + broker +
                         " by its announcement; without keys nothing proves whose it is");
}

void LossNotice::update(const ConnectionChanged& news) {
    if (!news.connected) {
        console_.warning("lost the broker at " + news.broker + "; looking for it");
        lost_ = news.broker;
    } else if (const auto lost = std::exchange(lost_, std::nullopt)) {
        console_.info(*lost == news.broker ? "found the broker at " + news.broker + " again"
                                           : "goes on with the broker at " + news.broker);
    }
}

AnswerNotice::AnswerNotice(Console& console, std::vector<std::string> workers, Instant now)
    : console_(console), workers_(std::move(workers)),
      due_(workers_.empty() ? Instant::never() : now + unanswered_max) {}

Instant AnswerNotice::tick(Instant now) {
    if (now < due_)
        return due_;
    if (!reaching_)
        reaching_ = std::make_unique<Reaching>(workers_);
    const auto hindrances = reaching_->hindrances();
    if (!hindrances)
        return due_ = now + look_pause;
    due_ = Instant::never();
    std::string where;
    std::size_t count = 0;
    for (std::size_t i = 0; i < workers_.size(); ++i)
        if (!(*hindrances)[i].empty() && ++count <= unanswered_told_max)
            where += (where.empty() ? "" : ", ") + workers_[i] + " (" + (*hindrances)[i] + ")";
    if (count > unanswered_told_max)
        where += fmt::format(" and {} more", count - unanswered_told_max);
    if (count > 0)
        console_.warning("no answer yet from " + where);
    return due_;
}

void WaitNotice::update(Instant now, const protocol::JobState& job, const std::string& cure) {
    std::string text;
    if (job.phase == protocol::JobPhase::paused)
        text = fmt::format("{0} #{1} is paused (fraja-ctl resume '#{1}' lets it go on)",
                           job.job_name, job.number);
    else if (!is_over(job.phase) && !job.reason.empty())
        text = fmt::format("{} #{} is {}{}", job.job_name, job.number, job.reason,
                           job.reason == protocol::no_worker_reason ? "; " + cure : "");
    if (text == text_)
        return;
    const bool goes_on = std::exchange(said_, false) && text.empty() && !is_over(job.phase);
    if (goes_on)
        tell(console_, mode_, "job_goes_on",
             fmt::format("{}{} #{} goes on", lacks_worker_ ? "a worker is here: " : "",
                         job.job_name, job.number));
    lacks_worker_ = job.reason.starts_with(protocol::no_worker_reasons);
    text_ = std::move(text);
    due_ = text_.empty() || mode_ == ProgressMode::none ? Instant::never() : now + unsaid_max;
}

Instant WaitNotice::tick(Instant now) {
    if (now < due_)
        return due_;
    due_ = Instant::never();
    said_ = true;
    tell(console_, mode_, "job_waits", text_);
    return due_;
}

void DistrustNotice::update(const protocol::JobState& job) {
    for (const protocol::Distrusted& who : job.distrusted)
        if (told_.insert(who.worker).second)
            console_.warning("worker " + printable(who.worker_name) +
                             " answers wrong pixels: what it has drawn is drawn again by others");
}

void DistrustNotice::update(const TilesWithdrawn& withdrawn) {
    if (withdrawn.worker_name.empty())
        console_.warning("another broker goes on with the job: what came before (" +
                         counted(withdrawn.rects.size(), "tile") +
                         ") is asked for once more, as it is to be checked");
}

void CopiesNotice::update(Instant now, const protocol::JobState& job) {
    if (is_over(job.phase) || job.phase == protocol::JobPhase::waiting_for_scene)
        return;
    const Copies copies{job.copies, job.copies_wanted};
    if (copies == now_)
        return;
    now_ = copies;
    due_ = now_ == said_ || (!now_.lack() && !said_.lack()) ? Instant::never() : now + unsaid_max;
}

Instant CopiesNotice::tick(Instant now) {
    if (now < due_)
        return due_;
    due_ = Instant::never();
    said_ = now_;
    if (!now_.lack())
        tell_unless_none("job_copied", fmt::format("all {} brokers keep the job", now_.wanted + 1));
    else if (now_.here > 0)
        tell_unless_none("job_copies_missing", fmt::format("{} of {} brokers keep the job",
                                                           now_.here + 1, now_.wanted + 1));
    else
        console_.warning(fmt::format("a single broker of {} keeps the job: if that one is lost, "
                                     "so is the job",
                                     now_.wanted + 1));
    return due_;
}

void CopiesNotice::end() {
    if (now_.lack() && due_ != Instant::never())
        (void)tick(due_);
}

void CopiesNotice::tell_unless_none(std::string_view event, const std::string& text) {
    if (mode_ != ProgressMode::none)
        tell(console_, mode_, event, text);
}

std::string unchecked_words(const protocol::CheckCounts& checks) {
    if (checks.unchecked == 0)
        return {};
    return "--verify: " + counted(checks.unchecked, "tile") + " of " +
           std::to_string(checks.unchecked + checks.agreed) +
           " could not be checked: there was no second worker (where there are keys: with another "
           "one)";
}

void tell_resumed(Console& console, ProgressMode mode, const protocol::JobState& job,
                  JobId submitted) {
    const std::string name = fmt::format("{} #{}", job.job_name, job.number);
    if (job.job == submitted)
        tell(console, mode, "not_resumed",
             "no job of this scene and these settings to resume: " + name + " is new");
    else
        tell(console, mode, "resumed",
             fmt::format("resumes {}: {}% of it was there", name,
                         ProgressView::percent_of(share_done(job))));
}

void tell_parting(Console& console, ProgressMode mode, const std::string& text) {
    console.line(mode == ProgressMode::json ? event_json("goes_on", text)
                                            : "fraja-submit: " + text);
}

std::string worker_cure(const std::string& broker) {
    return "fraja-worker -b " + broker + " starts one";
}

void SearchingListener::hear(Instant now, const News& news) {
    notice_.end(); // whatever it is: no longer looked for
    if (const auto* connection = std::get_if<ConnectionChanged>(&news);
        connection && connection->is_unproven)
        notice_.warn_of(connection->broker);
    listener_.hear(now, news);
}

Instant SearchingListener::tick(Instant now) {
    return std::min(notice_.tick(now), listener_.tick(now));
}

} // namespace fraja::client
