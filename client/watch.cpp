#include "client/watch.hpp"

#include "client/json.hpp"
#include "client/picture.hpp"
#include "client/progress_report.hpp"
#include "client/shell.hpp"
#include "client/table.hpp"
#include "common/net/clock.hpp"

#include <cstdio>
#include <fmt/core.h>
#include <unistd.h>
#include <utility>

namespace fraja::client {
namespace {

/// The tiles' lines are progress enough, but where they go elsewhere than the user looks.
ProgressMode progress_beside_lines(ProgressMode mode, const Console& console) {
    if (mode != ProgressMode::automatic)
        return mode;
    return console.is_terminal() && isatty(STDOUT_FILENO) == 0 ? ProgressMode::bar
                                                               : ProgressMode::none;
}

class JobListener final : public Listener {
public:
    JobListener(const WatchOptions& options, Console& console)
        : options_(options), console_(console),
          progress_(console, progress_beside_lines(options.shared.progress, console), net::now()) {}

    void hear(Instant, const News& news) override {
        std::visit([this](const auto& n) { take(n); }, news);
    }
    Instant tick(Instant now) override {
        std::fflush(stdout);
        Instant next = progress_.tick(now);
        if (options_.output.empty() || failure_)
            return next;
        const auto written = picture_.tick(now);
        if (!written) {
            fail(written.error());
            return next;
        }
        return std::min(next, *written);
    }
    std::optional<Outcome> wants_to_leave() override { return failure_; }

    Outcome finish(Instant now, Outcome outcome) {
        progress_.finish(now);
        if (!options_.output.empty() && !failure_)
            if (const auto written = picture_.finish(); !written) {
                fail(written.error());
                return *failure_;
            }
        return outcome;
    }

private:
    void take(const Accepted& news) {
        if (!options_.output.empty())
            picture_.begin(news.state, options_.output, options_.encoding);
        progress_.update(news.state);
        show_phase(news.state);
    }
    void take(const TileArrived& news) {
        fmt::print("{}\n", options_.shared.json ? tile_json(news.tile) : tile_line(news.tile));
        if (!options_.output.empty())
            picture_.place(news.tile, news.cell_count);
    }
    void take(const StateChanged& news) {
        picture_.update(news.state);
        progress_.update(news.state);
        if (news.state.phase != phase_)
            show_phase(news.state);
    }
    void take(const ConnectionChanged& news) {
        if (!news.connected)
            console_.warning("lost the broker at " + news.broker + "; looking for it");
        else if (lost_)
            console_.info("found the broker at " + news.broker + " again");
        lost_ = !news.connected;
        progress_.set_connected(news.connected);
    }
    void take(const FarmChanged&) {}
    void take(const Finished&) {}

    void show_phase(const protocol::JobState& state) {
        phase_ = state.phase;
        if (options_.shared.json)
            fmt::print("{}\n", job_json(state));
        else
            console_.info(fmt::format("{} #{} is {}{}{}", state.job_name, state.number,
                                      to_string(state.phase), state.reason.empty() ? "" : ": ",
                                      state.reason));
    }
    void fail(const Error& error) {
        console_.error(error.message);
        failure_ = Outcome{ExitCode::usage, error.message};
    }

    const WatchOptions& options_;
    Console& console_;
    ProgressReport progress_;
    LivePicture picture_;
    std::optional<protocol::JobPhase> phase_;
    std::optional<Outcome> failure_;
    bool lost_ = false;
};

class FarmListener final : public Listener {
public:
    FarmListener(const WatchOptions& options, Console& console)
        : options_(options), console_(console),
          redraws_(isatty(STDOUT_FILENO) == 1 && !options.shared.json && !options.until.once) {}

    void hear(Instant, const News& news) override {
        if (const auto* farm = std::get_if<FarmChanged>(&news))
            show(farm->farm);
        else if (const auto* connection = std::get_if<ConnectionChanged>(&news))
            if (!connection->connected)
                console_.warning("lost the broker at " + connection->broker + "; looking for it");
    }
    std::optional<Outcome> wants_to_leave() override {
        return options_.until.once && !shown_.empty() ? std::optional(Outcome{}) : std::nullopt;
    }

private:
    void show(const protocol::FarmState& farm) {
        const std::string text = options_.shared.json
                                     ? farm_json(farm) + "\n"
                                     : jobs_table(farm.jobs) + "\n" + workers_table(farm.workers);
        if (text == shown_)
            return;
        if (redraws_)
            fmt::print("\x1b[H\x1b[2J{}", text);
        else
            fmt::print("{}{}", shown_.empty() || options_.shared.json ? "" : "\n", text);
        std::fflush(stdout);
        shown_ = text;
    }

    const WatchOptions& options_;
    Console& console_;
    bool redraws_;
    std::string shown_;
};

int watch_job(const WatchOptions& options, Console& console, const net::SignalWatch* signals) {
    if (!options.output.empty())
        if (const auto writable = check_writable(options.output); !writable) {
            console.error(writable.error().message);
            return static_cast<int>(ExitCode::usage);
        }
    JobListener listener(options, console);
    const net::Context context;
    JobWatching watching({*options.job, session_options(options.shared), options.until},
                         fresh_rng());
    const Outcome outcome =
        listener.finish(net::now(), converse(context, watching, listener, signals));
    const bool said = outcome.code == ExitCode::interrupted || outcome.code == ExitCode::terminated;
    if (outcome.code != ExitCode::done && !said)
        console.error(outcome.reason);
    return static_cast<int>(console.checked(outcome.code));
}

int watch_farm(const WatchOptions& options, Console& console, const net::SignalWatch* signals) {
    FarmListener listener(options, console);
    const net::Context context;
    FarmWatching watching(session_options(options.shared));
    const Outcome outcome = converse(context, watching, listener, signals);
    if (outcome.code == ExitCode::unreachable || outcome.code == ExitCode::refused)
        console.error(outcome.reason);
    return static_cast<int>(console.checked(outcome.code));
}

} // namespace

int run_watch(const WatchOptions& options, const net::SignalWatch* signals) {
    Console console(options.shared.console);
    return options.job ? watch_job(options, console, signals)
                       : watch_farm(options, console, signals);
}

} // namespace fraja::client
