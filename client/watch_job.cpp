#include "client/watch_job.hpp"

#include "client/farm_names.hpp"
#include "client/json.hpp"
#include "client/live_preview.hpp"
#include "client/notices.hpp"
#include "client/outlet.hpp"
#include "client/picture.hpp"
#include "client/progress_report.hpp"
#include "client/shell.hpp"
#include "client/table.hpp"
#include "client/tev/feed.hpp"
#include "common/net/clock.hpp"

#include <algorithm>
#include <fmt/core.h>
#include <memory>
#include <optional>
#include <unistd.h>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration tev_patience = 2s; // in the end, for what it has not taken yet

bool lines_on_terminal() {
    return isatty(STDOUT_FILENO) == 1;
}

/// By itself a picture comes where lines would; but lines that a program reads stay lines.
PreviewMode preview_mode(const WatchOptions& options, const Console& console) {
    const bool to_be_read = options.shared.json || options.until.once;
    if (lines_on_terminal() ? to_be_read : options.preview == PreviewMode::automatic)
        return PreviewMode::none;
    return LivePreview::chosen(options.preview, console);
}

/// The tiles' lines are progress enough, but where they are not shown, or go elsewhere than the
/// user looks.
ProgressMode progress_mode(ProgressMode mode, const Console& console, bool picture) {
    if (mode != ProgressMode::automatic)
        return mode;
    return console.is_terminal() && (picture || !lines_on_terminal()) ? ProgressMode::bar
                                                                      : ProgressMode::none;
}

class JobListener final : public Listener {
public:
    JobListener(const WatchOptions& options, Console& console, std::unique_ptr<tev::Feed> tev)
        : options_(options), console_(console), preview_(console, preview_mode(options, console)),
          progress_(console, progress_mode(options.shared.progress, console, preview_.is_on()),
                    net::now()),
          mode_(ProgressReport::chosen(options.shared.progress, console)), wait_(console, mode_),
          copies_(console, mode_), tev_(std::move(tev)),
          shows_lines_(!lines_on_terminal() || !preview_.is_on()),
          keys_(lines_on_terminal() ? RawKeys::take() : std::nullopt) {}

    void hear(Instant, const News& news) override {
        std::visit([this](const auto& n) { take(n); }, news);
    }
    Instant tick(Instant now) override {
        left_ = keys_ && keys_->has_left();
        outlet_.pump();
        const Instant waited = std::min(wait_.tick(now), copies_.tick(now));
        if (auto notice = tev_ ? tev_->take_notice() : std::nullopt)
            notice->good ? console_.info(notice->text) : console_.warning(notice->text);
        const Instant next = std::min(waited, progress_.tick(now));
        if (!picture_ || failure_)
            return next;
        const Instant redraw = preview_.tick(now, picture_->film());
        const auto rewrite = file_.tick(now, *picture_);
        if (!rewrite)
            fail(rewrite.error());
        return std::min({next, redraw, rewrite.value_or(Instant::never())});
    }
    void wait_also(std::vector<net::Waitable>& all) const override {
        if (!outlet_.is_empty())
            all.push_back(net::Waitable::writable(outlet_.fd()));
        if (keys_)
            all.emplace_back(STDIN_FILENO);
    }
    std::optional<Outcome> wants_to_leave() override {
        return left_ && !failure_ ? std::optional(Outcome{}) : failure_;
    }

    Outcome finish(Instant now, Outcome outcome, const net::SignalWatch* signals) {
        keys_.reset();
        copies_.end();
        if (picture_)
            preview_.finish(picture_->film());
        progress_.finish(now);
        console_.end_redraw();
        if (picture_ && !failure_) {
            if (const auto written = file_.finish(*picture_); !written)
                fail(written.error());
            else if (!options_.output.empty() && picture_->pixels_placed() > 0)
                tell(console_, mode_, "wrote", "wrote " + options_.output);
        }
        if (failure_)
            return *failure_;
        if (outcome.code == ExitCode::interrupted || outcome.code == ExitCode::terminated)
            return outcome;
        if (tev_)
            tev_->finish(tev_patience);
        if (const auto signal = outlet_.drain(signals))
            return outcome_of(*signal);
        return outcome;
    }
    [[nodiscard]] bool has_lost_output() const { return outlet_.has_failed(); }

private:
    void take(const Accepted& news) {
        if (!options_.output.empty() || preview_.is_on() || tev_)
            picture_.emplace(news.state.settings);
        if (!options_.output.empty())
            file_.begin(news.state, options_.output, options_.encoding);
        if (tev_)
            tev_->begin(fmt::format("{} #{}", news.state.job_name, news.state.number),
                        picture_->film());
        update(news.state);
        show_phase(news.state);
    }
    void take(const TileArrived& news) {
        if (shows_lines_)
            print(options_.shared.json ? tile_json(news.tile) : tile_line(news.tile));
        if (!picture_)
            return;
        picture_->place(news.tile, news.cell_count);
        preview_.note_change();
        if (!options_.output.empty())
            file_.note_change();
        if (tev_)
            tev_->update(news.tile.rect, picture_->film());
    }
    void take(const TilesWithdrawn& news) {
        distrust_.update(news);
        if (!picture_)
            return;
        for (const PixelRect& rect : news.rects) {
            picture_->withdraw(rect);
            if (tev_)
                tev_->update(rect, picture_->film());
        }
        preview_.note_change();
        if (!options_.output.empty())
            file_.note_change();
    }
    void take(const StateChanged& news) {
        file_.update(news.state);
        update(news.state);
        if (news.state.phase != phase_)
            show_phase(news.state);
    }
    void take(const ConnectionChanged& news) {
        loss_.update(news);
        broker_ = news.broker;
        progress_.set_connected(news.connected);
    }
    void take(const FarmChanged&) {}
    void take(const Finished&) {}

    void update(const protocol::JobState& state) {
        progress_.update(state);
        distrust_.update(state);
        wait_.update(net::now(), state, worker_cure(broker_));
        copies_.update(net::now(), state);
    }
    void print(const std::string& line) { outlet_.put(line + "\n"); }
    void show_phase(const protocol::JobState& state) {
        phase_ = state.phase;
        if (options_.shared.json)
            print(job_json(state));
        else
            console_.info(fmt::format(
                "{} #{} {}{}{}", state.job_name, state.number,
                state.phase == protocol::JobPhase::failed ? "" : "is ", to_string(state.phase),
                is_over(state.phase) && !state.reason.empty() ? ": " + state.reason : ""));
    }
    void fail(const Error& error) {
        console_.error(error.message);
        failure_ = Outcome{ExitCode::usage, error.message};
    }

    const WatchOptions& options_;
    Console& console_;
    DistrustNotice distrust_{console_};
    LivePreview preview_;
    ProgressReport progress_;
    const ProgressMode mode_;
    WaitNotice wait_;
    CopiesNotice copies_;
    std::unique_ptr<tev::Feed> tev_;
    bool shows_lines_;
    std::optional<RawKeys> keys_; ///< not in a pipe: there they are its reader's
    bool left_ = false;           ///< by a key
    Outlet outlet_;
    std::optional<Picture> picture_; ///< where somebody wants to see it
    PictureFile file_;
    std::optional<protocol::JobPhase> phase_;
    std::optional<Outcome> failure_;
    std::string broker_;
    LossNotice loss_{console_};
};

/// Asking for a name may take a while.
Result<std::unique_ptr<tev::Feed>> tev_feed(const WatchOptions& options,
                                            const net::SignalWatch* signals) {
    if (!options.tev)
        return std::unique_ptr<tev::Feed>();
    const auto address = [&] {
        const net::Unwatched interruptible(signals);
        return tev::find_address(*options.tev);
    }();
    if (!address)
        return Error{address.error().code, "--tev " + address.error().message};
    return std::make_unique<tev::Feed>(*address);
}

} // namespace

int watch_job(const WatchOptions& options, Console& console, const net::SignalWatch* signals) {
    const auto refuse = [&](const Error& error) {
        console.error(error.message);
        return static_cast<int>(ExitCode::usage);
    };
    if (!options.output.empty())
        if (const auto writable = check_writable(options.output); !writable)
            return refuse(writable.error());
    auto tev = tev_feed(options, signals);
    if (!tev)
        return refuse(tev.error());
    JobListener listener(options, console, *std::move(tev));
    SearchingListener searching(listener,
                                {console, ProgressReport::chosen(options.shared.progress, console),
                                 options.shared.brokers, net::now()});
    const net::Context context(options.shared.keys);
    JobWatching watching({*options.job, session_options(options.shared), options.until},
                         fresh_rng());
    const Outcome outcome =
        listener.finish(net::now(), converse(context, watching, searching, signals), signals);
    const bool of_job = outcome.code == ExitCode::job_failed || outcome.code == ExitCode::cancelled;
    const bool said = outcome.code == ExitCode::interrupted ||
                      outcome.code == ExitCode::terminated ||
                      (of_job && !options.shared.json); // with its state
    const bool unknown = outcome.code == ExitCode::no_such_job && !watching.follower();
    if (outcome.code != ExitCode::done && !said)
        console.error(outcome.reason +
                      (unknown ? meant_in_farm(options.shared, "JOB", *options.job) : ""));
    return static_cast<int>(console.checked(outcome.code, listener.has_lost_output()));
}

} // namespace fraja::client
