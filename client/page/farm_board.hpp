// FarmBoard: the farm as every viewer sees it.
#pragma once

#include "client/page/job_views.hpp"
#include "client/page/page_json.hpp"
#include "client/page/shown.hpp"
#include "client/shell.hpp"

#include <mutex>
#include <string>

namespace fraja::client {

/// Hears the one conversation about the farm, and sees to the jobs that are looked at meanwhile.
class FarmBoard final : public Listener {
public:
    /// `page` says what does not change: the broker's endpoint until one is reached, the first job.
    FarmBoard(FarmPage page, JobViews& views);

    void hear(Instant now, const News& news) override;
    Instant tick(Instant now) override;

    /// Any thread.
    [[nodiscard]] Shown shown();

private:
    JobViews& views_;
    std::mutex mutex_; // guards all below
    FarmPage page_;
    ShownText text_;
};

} // namespace fraja::client
