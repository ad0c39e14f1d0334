// JobViews: the jobs that somebody looks at. Each has one conversation with the broker, however
// many look: a hundred browsers cost the broker one subscriber for each job.
#pragma once

#include "client/page/job_view.hpp"

#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace fraja::client {

struct JobViewLimits {
    std::size_t views_max = 16;                        ///< jobs at a time
    std::uint64_t pixels_max = std::uint64_t{1} << 27; ///< of all together, but one job always
    Duration idle_max = std::chrono::seconds(30);      ///< that a job is kept when nobody looks
};

/// Somebody looks as long as this lives.
class Viewer {
public:
    explicit Viewer(std::shared_ptr<JobView> view) : view_(std::move(view)) { ++view_->viewers; }
    ~Viewer() { --view_->viewers; }
    Viewer(const Viewer&) = delete;
    Viewer& operator=(const Viewer&) = delete;
    [[nodiscard]] JobView& view() const { return *view_; }

private:
    std::shared_ptr<JobView> view_;
};

class JobViews {
public:
    /// Watches the view's job until that is over or the view wants to leave. Runs in a thread of
    /// its own for each; whatever it throws becomes the view's trouble.
    using Conversation = std::function<Outcome(JobView&)>;

    JobViews(JobViewLimits limits, Conversation conversation);
    /// Lets all conversations end.
    ~JobViews();

    // Any thread.
    /// Begins to watch the job if nobody else looks. Errors: limit_exceeded.
    [[nodiscard]] Result<std::shared_ptr<Viewer>> look_at(const JobId& job);
    /// Null: nobody looks, and nobody has lately.
    [[nodiscard]] std::shared_ptr<JobView> find(const JobId& job) const;

    // The owner's thread, from time to time.
    /// Drops what nobody has looked at for a while.
    void tidy(Instant now);
    /// Begins again what had ended too soon: a job that is tried again, or was not to be had.
    void farm_changed(const protocol::FarmState& farm);

private:
    struct Entry {
        std::shared_ptr<JobView> view;
        Instant unseen_since = Instant::never();
        std::jthread thread;
    };
    void start(Entry& entry);
    [[nodiscard]] bool admits(const JobId& job, std::uint64_t pixels) const;
    [[nodiscard]] bool has_room();

    const JobViewLimits limits_;
    const Conversation conversation_;
    mutable std::mutex mutex_; // guards the entries
    std::vector<std::unique_ptr<Entry>> entries_;
};

} // namespace fraja::client
