#include "client/submit.hpp"

#include "client/json.hpp"
#include "client/live_preview.hpp"
#include "client/local/local_farm.hpp"
#include "client/notices.hpp"
#include "client/picture.hpp"
#include "client/progress_report.hpp"
#include "client/scene_file.hpp"
#include "client/settings_text.hpp"
#include "client/shell.hpp"
#include "client/submit_film.hpp"
#include "client/table.hpp"
#include "common/base/text.hpp"
#include "common/image/quantise.hpp"
#include "common/net/clock.hpp"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fmt/core.h>
#include <set>
#include <utility>

namespace fraja::client {
namespace {

constexpr Duration farm_look_pause = std::chrono::seconds(1); // what has become of our own

/// Keeps the picture, the progress and the sums while a submission runs.
class SubmitListener final : public Listener {
public:
    SubmitListener(const SubmitOptions& options, Console& console)
        : options_(options), console_(console),
          preview_(console, options.preview == PreviewMode::none
                                ? PreviewMode::none
                                : LivePreview::chosen(options.preview, console)),
          mode_(ProgressReport::chosen(options.shared.progress, console)),
          progress_(console, mode_, net::now()), wait_(console, mode_), copies_(console, mode_),
          answer_(console, options.direct, net::now()), distrust_(console),
          give_up_at_(net::now() + options.shared.connect_timeout) {}

    void hear(Instant now, const News& news) override {
        std::visit([&](const auto& n) { take(now, n); }, news);
    }
    Instant tick(Instant now) override {
        const Instant redraw =
            std::min({wait_.tick(now), copies_.tick(now), progress_.tick(now), answer_.tick(now),
                      picture_ ? preview_.tick(now, picture_->film()) : Instant::never()});
        gave_up_ = waits_for_workers() && now >= give_up_at_;
        return std::min({redraw, waits_for_workers() ? give_up_at_ : Instant::never(),
                         farm_ ? now + farm_look_pause : Instant::never()});
    }
    std::optional<Outcome> wants_to_leave() override {
        if (auto fault = farm_ ? farm_->fault() : std::nullopt)
            return Outcome{ExitCode::job_failed, *std::move(fault)};
        if (!gave_up_)
            return std::nullopt;
        return Outcome{ExitCode::unreachable, why_no_worker(options_)};
    }
    void finish(Instant now) {
        copies_.end();
        if (picture_)
            preview_.finish(picture_->film());
        progress_.finish(now);
        console_.end_redraw();
    }
    /// Its own, which outlives the conversation.
    void set_farm(const LocalFarm& farm) { farm_ = &farm; }
    /// The id of what is submitted: a job that is taken over has another.
    void set_submitted(JobId job) { submitted_ = job; }

    [[nodiscard]] const std::optional<protocol::JobState>& job() const { return job_; }
    [[nodiscard]] const std::optional<Picture>& picture() const { return picture_; }
    [[nodiscard]] std::size_t worker_count() const { return workers_.size(); }
    [[nodiscard]] const std::string& broker() const { return broker_; }

private:
    void take(Instant now, const Accepted& news) {
        if (job_)
            console_.warning("the broker had lost the job: submitted again");
        else if (!options_.own_farm() && !options_.detach)
            tell(console_, mode_, "accepted",
                 fmt::format("{} #{}: job {} at {}", news.state.job_name, news.state.number,
                             fraja::to_string(news.state.job), broker_));
        if (options_.resume && !job_)
            tell_resumed(console_, mode_, news.state, submitted_);
        job_ = news.state;
        if (options_.detach)
            return copies_.update(now, news.state);
        picture_.emplace(news.state.settings); // all its tiles come, again where it had been lost
        update(now, news.state);
    }
    void take(Instant, const TileArrived& news) {
        picture_->place(news.tile, news.cell_count);
        preview_.note_change();
        worker_seen_ = true;
        workers_.insert(news.tile.worker_name);
    }
    void take(Instant, const TilesWithdrawn& news) {
        for (const PixelRect& rect : news.rects)
            picture_->withdraw(rect);
        preview_.note_change();
        distrust_.update(news);
    }
    void take(Instant now, const StateChanged& news) {
        job_ = news.state;
        worker_seen_ = worker_seen_ || news.state.worker_count > 0;
        update(now, news.state);
    }
    void take(Instant, const ConnectionChanged& news) {
        loss_.update(news);
        broker_ = news.broker;
        progress_.set_connected(news.connected);
    }
    void take(Instant, const FarmChanged&) {}
    void take(Instant, const Finished&) {}

    void update(Instant now, const protocol::JobState& state) {
        progress_.update(state);
        distrust_.update(state);
        if (!options_.local) // whose worker is on its way
            wait_.update(now, state, worker_cure(options_, broker_));
        copies_.update(now, state);
    }
    /// Of those that --direct names, none has been given a tile yet.
    [[nodiscard]] bool waits_for_workers() const {
        return !options_.direct.empty() && !worker_seen_;
    }

    const SubmitOptions& options_;
    Console& console_;
    LivePreview preview_;
    ProgressMode mode_;
    ProgressReport progress_;
    WaitNotice wait_;
    CopiesNotice copies_;
    AnswerNotice answer_;
    DistrustNotice distrust_;
    LossNotice loss_{console_};
    Instant give_up_at_;
    bool worker_seen_ = false, gave_up_ = false;
    const LocalFarm* farm_ = nullptr;
    JobId submitted_;
    std::optional<protocol::JobState> job_;
    std::optional<Picture> picture_;
    std::set<std::string> workers_;
    std::string broker_;
};

class SubmitProgram {
public:
    SubmitProgram(const SubmitOptions& options, const net::SignalWatch* signals)
        : options_(options), signals_(signals), console_(options.shared.console),
          mode_(ProgressReport::chosen(options.shared.progress, console_)) {
        report_.started = std::chrono::system_clock::now();
        started_ = net::now();
        report_.job_name = options.job_name;
        report_.scene_file = options.scene_file;
        report_.settings = options.settings;
    }

    int run() {
        std::error_code ignored;
        if (options_.skip_existing && std::filesystem::exists(options_.output, ignored)) {
            console_.info(options_.output + " exists: nothing to do");
            return end("skipped", {});
        }
        if (auto reason = find_fault())
            return end("not_submitted", {ExitCode::usage, *std::move(reason)});
        if (options_.dry_run) {
            if (!options_.shared.json)
                print_plan();
            report_.output = options_.output;
            report_.broker = options_.brokers_asked();
            return end("dry_run", {});
        }
        processor_time_before_ = net::processor_time();
        SubmitListener listener(options_, console_);
        const Outcome outcome = render(listener);
        listener.finish(net::now());
        return conclude(listener, outcome);
    }

private:
    /// Everything that can be found wrong before anything is submitted; what was found has been
    /// said.
    std::optional<std::string> find_fault() {
        auto scene = read_scene();
        if (!scene) {
            // It opens with file, line and column: nothing before that.
            console_.located_error(scene.error().message);
            return scene.error().message;
        }
        for (const std::string& warning : scene->warnings)
            console_.located_warning(warning);
        scene_ = *std::move(scene);
        report_.scene = scene_.hash;
        if (options_.detach)
            return std::nullopt;
        if (const auto apart = check_apart(options_.output, options_.scene_file); !apart) {
            console_.error(apart.error().message);
            return apart.error().message;
        }
        if (const auto writable = check_writable(
                options_.output, {options_.settings.crop.width, options_.settings.crop.height});
            !writable) {
            console_.error(writable.error().message);
            return writable.error().message;
        }
        return std::nullopt;
    }

    /// A pipe may keep it waiting.
    [[nodiscard]] Result<SceneFile> read_scene() const {
        const net::Unwatched interruptible(signals_);
        return read_scene_file(options_.scene_file);
    }

    void print_plan() const {
        const protocol::PictureSettings& s = options_.settings;
        fmt::print("scene     {} ({}, {})\n", options_.scene_file,
                   counted(scene_.text.size(), "byte"), fraja::to_string(scene_.hash));
        fmt::print("picture   {}\nsettings  {}\n", extent_text(s), settings_text(s));
        if (!options_.output.empty())
            fmt::print("output    {}\n", options_.output);
        fmt::print("broker    {}\n", broker_text(options_));
    }

    Outcome render(SubmitListener& listener) {
        const net::Context context(options_.shared.keys);
        std::unique_ptr<LocalFarm> farm;
        SubmissionRequest request{
            .job = new_job(options_, options_.job_name, scene_.hash, scene_.text.size()),
            .scene_text = scene_.text,
            .session = session_options(options_.shared),
            .detach = options_.detach,
            .timeout = options_.timeout};
        if (const protocol::PictureSettings& s = options_.settings; s.limited_in_time())
            request.ends_at = started_ + s.time_limit;
        if (options_.own_farm()) {
            auto started = options_.local ? LocalFarm::start(context, options_.local_threads)
                                          : LocalFarm::call(context, options_.direct);
            if (!started)
                return {ExitCode::usage, started.error().message};
            farm = *std::move(started);
            request.session.brokers = {farm->endpoint()};
            request.session.connect_timeout = LocalFarm::answers_within;
            request.session.is_in_process = true;
            listener.set_farm(*farm);
        }
        listener.set_submitted(request.job.job);
        if (options_.own_farm())
            return run_submission(context, std::move(request), listener, signals_);
        SearchingListener searching(listener,
                                    {console_, mode_, options_.shared.brokers, net::now()});
        return run_submission(context, std::move(request), searching, signals_);
    }

    int conclude(const SubmitListener& listener, Outcome outcome) {
        if (listener.job()) {
            report_.job = *listener.job();
            report_.job.settings.time_limit =
                options_.settings.time_limit; // not what was left of it
        }
        report_.workers = listener.worker_count();
        if (listener.picture())
            report_.estimate = listener.picture()->estimate();
        const bool left = outcome.code == ExitCode::interrupted ||
                          outcome.code == ExitCode::terminated ||
                          outcome.code == ExitCode::timed_out;
        if (outcome.code == ExitCode::done && options_.detach)
            return end_detached();
        if (outcome.code == ExitCode::done)
            outcome = write(listener);
        else if (left && options_.own_farm())
            save_unfinished(listener);
        else if (left)
            explain_leaving(listener, outcome);
        else
            console_.error(outcome.reason);
        report_.processor_time = net::processor_time() - processor_time_before_;
        if (options_.stats && !options_.shared.json && listener.job())
            print_stats();
        return end(listener.job() ? std::string(to_string(report_.job.phase)) : "not_submitted",
                   outcome);
    }

    Outcome write(const SubmitListener& listener) {
        if (const auto written =
                listener.picture()->write(options_.output, report_.job, options_.encoding);
            !written) {
            const std::string cure =
                options_.own_farm() ? ""
                                    : "; the job is done: fraja-ctl -b " + listener.broker() +
                                          " get " + fraja::to_string(report_.job.job) + " -o FILE";
            console_.error(written.error().message + cure);
            return {ExitCode::job_failed, written.error().message};
        }
        report_.output = options_.output;
        tell(console_, mode_, "wrote", "wrote " + options_.output);
        say_what_ended_it();
        if (const std::string words = unchecked_words(report_.job.checks); !words.empty())
            console_.warning(words);
        if (const auto& e = report_.estimate; e && e->pixels_at_ceiling > 0)
            console_.warning(
                fmt::format("--error {} is not reached in {} of {}: they have --max-samples",
                            options_.settings.error, e->pixels_at_ceiling,
                            counted(options_.settings.crop.pixel_count(), "pixel")));
        return {};
    }

    /// A time limit that was not used up.
    void say_what_ended_it() {
        const protocol::JobState& job = report_.job;
        const Duration limit = options_.settings.time_limit;
        if (!options_.settings.limited_in_time() || job.done_count < job.cell_count ||
            job.elapsed >= limit || !report_.estimate)
            return;
        tell(console_, mode_, "ended_early",
             fmt::format("ended after {:.1f} of {:.1f} s: each pixel has its {:.0f} samples, and "
                         "--max-samples {} lets it have no more",
                         seconds(job.elapsed), seconds(limit), report_.estimate->samples,
                         options_.settings.max_samples));
    }

    void save_unfinished(const SubmitListener& listener) {
        const auto& picture = listener.picture();
        if (!picture || picture->pixels_placed() == 0)
            return console_.warning("stopped before there was anything to save");
        const std::string output = unfinished_output();
        if (const auto written = picture->write(output, report_.job, options_.encoding); !written)
            return console_.error(written.error().message);
        report_.output = output;
        const double share = static_cast<double>(picture->pixels_placed()) /
                             static_cast<double>(options_.settings.crop.pixel_count());
        console_.warning(fmt::format("stopped: {} holds the {:.0f}% that were done; only a whole "
                                     "picture becomes {}",
                                     output, std::floor(100 * share), options_.output));
    }

    /// What bears the picture's own name is whole: --skip-existing believes that.
    [[nodiscard]] std::string unfinished_output() const {
        std::filesystem::path beside = options_.output;
        beside.replace_extension(".unfinished" + beside.extension().string());
        return beside.string();
    }

    void explain_leaving(const SubmitListener& listener, const Outcome& outcome) {
        const std::string why =
            outcome.code == ExitCode::timed_out ? "the time is up" : outcome.reason;
        if (!listener.job())
            return console_.warning(why + ": no broker has acknowledged the job; if one took it "
                                          "all the same, fraja-watch shows it");
        const std::string id = fraja::to_string(report_.job.job);
        tell_parting(console_, mode_,
                     fmt::format("{}; {} #{} goes on\n"
                                 "  watch it:   fraja-watch -b {} {}\n"
                                 "  get it:     fraja-ctl -b {} get {} -o {}\n"
                                 "  cancel it:  fraja-ctl -b {} cancel --yes {}",
                                 why, printable(report_.job.job_name), report_.job.number,
                                 listener.broker(), id, listener.broker(), id,
                                 printable(options_.output), listener.broker(), id));
    }

    int end_detached() {
        if (!options_.shared.json)
            fmt::print("{}\n", fraja::to_string(report_.job.job));
        return end("accepted", {});
    }

    void print_stats() const {
        const double elapsed = seconds(report_.job.elapsed);
        const double wall = seconds(since_start());
        fmt::print("{}", counts_page(report_.job));
        if (const auto& e = report_.estimate)
            fmt::print("samples           {:.2f} per pixel\n"
                       "error             {:.3f} levels, RMS over the picture, estimated\n",
                       e->samples, levels_per_unit * e->rms_error);
        fmt::print("time wall         {:.3f} s\n"
                   "time job          {:.3f} s\n"
                   "time render       {:.3f} s (summed over render threads)\n"
                   "time processor    {:.3f} s (of this process, from the submission on)\n",
                   wall, elapsed, seconds(report_.job.render_time),
                   seconds(report_.processor_time));
        if (elapsed > 0)
            fmt::print("speed             {}\n",
                       format_rate(static_cast<double>(report_.job.rays.total()) / elapsed));
        fmt::print("cells             {}\n"
                   "workers           {}\n",
                   report_.job.done_count, report_.workers);
    }

    [[nodiscard]] Duration since_start() const { return net::now() - started_; }

    int end(std::string state, Outcome outcome) {
        report_.state = std::move(state);
        report_.outcome = std::move(outcome);
        report_.finished = std::chrono::system_clock::now();
        if (options_.shared.json)
            fmt::print("{}\n", submit_json(report_));
        return static_cast<int>(console_.checked(report_.outcome.code));
    }

    const SubmitOptions& options_;
    const net::SignalWatch* signals_;
    Console console_;
    ProgressMode mode_;
    SceneFile scene_;
    SubmissionReport report_;
    Instant started_{}; // by a clock that nobody sets
    Duration processor_time_before_{};
};

} // namespace

int run_submit(const SubmitOptions& options, const net::SignalWatch* signals) {
    if (!options.travel_file.empty())
        return run_submit_film(options, signals);
    return SubmitProgram(options, signals).run();
}

} // namespace fraja::client
