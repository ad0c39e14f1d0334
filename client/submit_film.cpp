#include "client/submit_film.hpp"

#include "client/film_progress.hpp"
#include "client/film_scenes.hpp"
#include "client/frames.hpp"
#include "client/json.hpp"
#include "client/local/local_farm.hpp"
#include "client/notices.hpp"
#include "client/picture.hpp"
#include "client/progress.hpp"
#include "client/progress_report.hpp"
#include "client/scene_file.hpp"
#include "client/settings_text.hpp"
#include "client/shell.hpp"
#include "common/base/guarded.hpp"
#include "common/base/text.hpp"
#include "common/net/clock.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <fmt/core.h>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration look_around = 100ms; // for signals, and for who is to leave
constexpr Duration for_ever = Duration::max() / 2;

/// What the threads of frames and the film's own have in common.
struct Shared {
    std::mutex mutex;
    std::condition_variable changed;
    std::atomic<bool> leaving = false;
};

/// One frame on its way: its thread writes, the film's looks.
struct FrameState {
    std::uint32_t number = 0;
    std::string output;
    bool told_resumed = false;
    // guarded by Shared::mutex
    JobId submitted; ///< a job that is taken over has another id
    std::optional<protocol::JobState> job, accepted;
    std::uint64_t rays_before = 0; ///< of a job that is taken over: traced for somebody else
    std::string broker;
    bool is_unproven = false;       ///< that broker, by ConnectionChanged
    bool connected = true;          ///< not known to be without the broker
    bool unwritten = false;         ///< its file cannot be written
    std::optional<Outcome> outcome; ///< it is over

    /// Of a job, since it was submitted or taken over.
    [[nodiscard]] std::uint64_t rays_traced() const {
        const std::uint64_t rays = job->rays.total();
        return rays - std::min(rays, rays_before);
    }
};

class FrameListener final : public Listener {
public:
    FrameListener(Shared& shared, FrameState& state) : shared_(shared), state_(state) {}

    void hear(Instant, const News& news) override {
        std::visit([&](const auto& n) { take(n); }, news);
    }
    Instant tick(Instant now) override { return now + look_around; }
    std::optional<Outcome> wants_to_leave() override {
        if (!shared_.leaving)
            return std::nullopt;
        return Outcome{ExitCode::interrupted, "interrupted"};
    }
    [[nodiscard]] const std::optional<Picture>& picture() const { return picture_; }

private:
    void take(const Accepted& news) {
        picture_.emplace(news.state.settings); // all its tiles come, again where it had been lost
        {
            const std::lock_guard lock(shared_.mutex);
            state_.job = state_.accepted = news.state;
            state_.rays_before = news.state.job == state_.submitted ? 0 : news.state.rays.total();
        }
        shared_.changed.notify_one();
    }
    void take(const TileArrived& news) { picture_->place(news.tile, news.cell_count); }
    void take(const TilesWithdrawn& news) {
        for (const PixelRect& rect : news.rects)
            picture_->withdraw(rect);
    }
    void take(const StateChanged& news) { note(news.state); }
    void take(const ConnectionChanged& news) {
        const std::lock_guard lock(shared_.mutex);
        state_.connected = news.connected;
        state_.broker = news.broker;
        state_.is_unproven = state_.is_unproven || news.is_unproven;
    }
    void take(const FarmChanged&) {}
    void take(const Finished&) {}
    void note(const protocol::JobState& job) {
        const std::lock_guard lock(shared_.mutex);
        state_.job = job;
    }

    Shared& shared_;
    FrameState& state_;
    std::optional<Picture> picture_;
};

class FilmProgram {
public:
    FilmProgram(const SubmitOptions& options, const net::SignalWatch* signals)
        : options_(options), signals_(signals), console_(options.shared.console),
          mode_(ProgressReport::chosen(options.shared.progress, console_)),
          progress_(console_, mode_, options.job_name, film_, net::now()), wait_(console_, mode_),
          copies_(console_, mode_), context_(options.shared.keys) {
        report_.started = std::chrono::system_clock::now();
        report_.film = film_;
        report_.job_name = options.job_name;
        report_.scene_file = options.scene_file;
        report_.travel_file = options.travel_file;
        report_.settings = options.settings;
    }

    /// Whatever ends it, the frames' threads have left before what they use goes.
    ~FilmProgram() { shared_.leaving = true; }
    FilmProgram(const FilmProgram&) = delete;
    FilmProgram& operator=(const FilmProgram&) = delete;

    int run() {
        if (auto fault = find_fault())
            return end({ExitCode::usage, *std::move(fault)});
        if (options_.dry_run) {
            if (!options_.shared.json)
                print_plan();
            for (const std::size_t index : waiting_)
                report_.frames[index].output =
                    frame_file(options_.output, report_.frames[index].number);
            report_.broker = options_.brokers_asked();
            return end({});
        }
        if (waiting_.empty()) {
            console_.info("every frame's file exists: nothing to do");
            return end({});
        }
        Outcome outcome = render();
        console_.end_redraw();
        return end(std::move(outcome));
    }

private:
    std::optional<std::string> find_fault() {
        std::vector<std::string> warnings;
        auto scenes = read_scenes(warnings);
        for (const std::string& warning : warnings)
            console_.located_warning(warning);
        if (!scenes) { // it opens with file, line and column: nothing before that
            console_.located_error(scenes.error().message);
            return scenes.error().message;
        }
        scenes_ = *std::move(scenes);
        const FrameRange range = options_.frames.value_or(FrameRange{1, scenes_->frame_count(), 1});
        if (range.last > scenes_->frame_count())
            return said(fmt::format("--frames: {} has {}, so there is no frame {}",
                                    options_.travel_file, counted(scenes_->frame_count(), "camera"),
                                    range.last));
        for (std::uint64_t n = range.first; n <= range.last; n += range.step) {
            const auto number = static_cast<std::uint32_t>(n);
            FilmReport::Frame& frame = report_.frames.emplace_back();
            frame.number = number;
            std::error_code ignored;
            if (options_.skip_existing &&
                std::filesystem::exists(frame_file(options_.output, number), ignored))
                frame.state = "skipped";
            else
                waiting_.push_back(report_.frames.size() - 1);
        }
        for (const std::size_t index : waiting_)
            for (const std::string& input : {options_.scene_file, options_.travel_file})
                if (const auto apart = check_apart(
                        frame_file(options_.output, report_.frames[index].number), input);
                    !apart)
                    return said(apart.error().message);
        if (!waiting_.empty())
            if (const auto writable = check(report_.frames[waiting_.front()].number); !writable)
                return said(writable.error().message);
        return std::nullopt;
    }

    /// A pipe may keep it waiting.
    Result<FilmScenes> read_scenes(std::vector<std::string>& warnings) const {
        const net::Unwatched interruptible(signals_);
        return FilmScenes::read(options_.scene_file, options_.travel_file, warnings);
    }

    std::string said(std::string fault) {
        console_.error(fault);
        return fault;
    }

    [[nodiscard]] Result<void> check(std::uint32_t frame) const {
        return check_writable(frame_file(options_.output, frame),
                              {options_.settings.crop.width, options_.settings.crop.height});
    }

    void print_plan() const {
        fmt::print("scene     {}\ntravel    {} ({})\n", options_.scene_file, options_.travel_file,
                   counted(scenes_->frame_count(), "camera"));
        fmt::print("frames    {} to render, {} skipped\n", waiting_.size(),
                   report_.frames.size() - waiting_.size());
        fmt::print("picture   {}\nsettings  {}\n", extent_text(options_.settings),
                   settings_text(options_.settings));
        if (!waiting_.empty())
            fmt::print("output    {} ... {}\n",
                       frame_file(options_.output, report_.frames[waiting_.front()].number),
                       frame_file(options_.output, report_.frames[waiting_.back()].number));
        fmt::print("broker    {}\n", broker_text(options_));
    }

    Outcome render() {
        session_ = session_options(options_.shared);
        if (options_.own_farm()) {
            auto started = options_.local ? LocalFarm::start(context_, options_.local_threads)
                                          : LocalFarm::call(context_, options_.direct);
            if (!started)
                return {ExitCode::usage, said(started.error().message)};
            farm_ = *std::move(started);
            session_.brokers = {farm_->endpoint()};
            session_.connect_timeout = LocalFarm::answers_within;
            session_.is_in_process = true;
        }
        search_.emplace(console_, mode_, session_.brokers, net::now());
        AnswerNotice answer(console_, options_.direct, net::now());
        const Instant gives_up_at = options_.direct.empty()
                                        ? Instant::never()
                                        : net::now() + options_.shared.connect_timeout;
        const Instant times_out =
            options_.timeout ? net::now() + *options_.timeout : Instant::never();
        std::optional<Outcome> leaving;
        std::size_t next = 0;
        while (!leaving && (next < waiting_.size() || !running_.empty())) {
            // One alone until it is known that there is a broker which takes them.
            const std::size_t at_a_time = accepted_ ? frames_at_a_time(options_.settings) : 1;
            while (!gives_up_ && next < waiting_.size() && running_.size() < at_a_time)
                begin(waiting_[next++]);
            if (gives_up_ && running_.empty())
                break;
            {
                std::unique_lock lock(shared_.mutex);
                shared_.changed.wait_for(lock, look_around);
            }
            gather();
            if (broker_.empty() && !farm_) {
                search_->tick(net::now());
            } else {
                search_->end();
                show_progress();
            }
            (void)answer.tick(net::now());
            if (const auto signal = signals_ ? signals_->receive() : std::nullopt)
                leaving = outcome_of(*signal);
            else if (net::now() >= times_out)
                leaving = Outcome{ExitCode::timed_out, "the time is up"};
            else if (!worker_seen_ && net::now() >= gives_up_at)
                leaving = Outcome{ExitCode::unreachable, why_no_worker(options_)};
            else if (auto fault = farm_ ? farm_->fault() : std::nullopt)
                leaving = Outcome{ExitCode::job_failed, *std::move(fault)};
        }
        search_->end();
        if (!leaving)
            return summary(next);
        leave(*leaving, next);
        return *leaving;
    }

    /// A thread of its own speaks for it.
    void begin(std::size_t index) {
        Running& one = running_[index];
        one.state = std::make_unique<FrameState>();
        one.state->number = report_.frames[index].number;
        one.state->output = frame_file(options_.output, one.state->number);
        one.state->connected = connected_;
        SessionOptions session = session_;
        if (!broker_.empty() && std::ranges::count(session.brokers, broker_) == 0)
            session.brokers.insert(session.brokers.begin(), broker_); // found by another frame
        if (accepted_) // who has been there once is waited for, as with a single picture
            session.connect_timeout = for_ever;
        one.thread = std::jthread([this, &state = *one.state, session = std::move(session)] {
            Result<Outcome> outcome =
                guarded([&]() -> Result<Outcome> { return render_frame(state, session); });
            {
                const std::lock_guard lock(shared_.mutex);
                state.outcome = outcome ? *std::move(outcome)
                                        : Outcome{ExitCode::job_failed, outcome.error().message};
            }
            shared_.changed.notify_one();
        });
    }

    Outcome render_frame(FrameState& state, const SessionOptions& session) {
        if (const auto writable = check(state.number); !writable)
            return unwritten(state, writable.error());
        const auto scene = scenes_->frame(state.number);
        if (!scene)
            return {ExitCode::job_failed, scene.error().message};
        const std::string number = fmt::format("-{:04}", state.number);
        const std::string name =
            options_.job_name.substr(0, protocol::name_bytes_max - number.size()) + number;
        SubmissionRequest request{.job = new_job(options_, name, scene->hash, scene->text.size()),
                                  .scene_text = scene->text,
                                  .session = session,
                                  .timeout = std::nullopt};
        request.job.wishes.film = report_.film;
        request.job.wishes.frame = state.number;
        {
            const std::lock_guard lock(shared_.mutex);
            state.submitted = request.job.job;
        }
        FrameListener listener(shared_, state);
        Outcome outcome = run_submission(context_, std::move(request), listener, nullptr);
        if (outcome.code != ExitCode::done)
            return outcome;
        if (const auto written = listener.picture()->write(
                state.output, *state.job, options_.encoding,
                fmt::format(" --travel {} --frames {}-{}", options_.travel_file, state.number,
                            state.number));
            !written)
            return unwritten(state, written.error());
        return outcome;
    }

    Outcome unwritten(FrameState& state, const Error& error) {
        const std::lock_guard lock(shared_.mutex);
        state.unwritten = true;
        return {ExitCode::job_failed, error.message};
    }

    /// What has become of those on their way.
    void gather() {
        bool connected = true, any_knows = false; // who is over without a broker has not found it
        std::vector<std::size_t> over;
        {
            const std::lock_guard lock(shared_.mutex);
            if (!running_.empty() && !options_.local) // whose worker is on its way
                if (const auto& job = running_.begin()->second.state->job) {
                    wait_.update(net::now(), *job, worker_cure(options_, broker_));
                    copies_.update(net::now(), *job);
                }
            for (const auto& [index, one] : running_) {
                const bool failed =
                    one.state->outcome && one.state->outcome->code != ExitCode::done;
                connected = connected && (failed || one.state->connected);
                any_knows = any_knows || !failed;
                if (!one.state->broker.empty())
                    broker_ = one.state->broker;
                if (one.state->is_unproven)
                    search_->warn_of(broker_);
                accepted_ = accepted_ || one.state->job;
                if (const auto& job = one.state->job)
                    worker_seen_ = worker_seen_ || job->worker_count > 0 || job->done_count > 0;
                const auto& accepted = one.state->accepted;
                if (accepted && accepted->job != one.state->submitted &&
                    !std::exchange(one.state->told_resumed, true))
                    tell_resumed(console_, mode_, *accepted, one.state->submitted);
                if (one.state->outcome)
                    over.push_back(index);
            }
        }
        if (connected != connected_ && (!connected || any_knows)) {
            connected_ = connected;
            loss_.update({connected, broker_, {}});
        }
        for (const std::size_t index : over)
            end_frame(index);
    }

    void end_frame(std::size_t index) {
        const auto at = running_.find(index);
        at->second.thread.join();
        const FrameState& state = *at->second.state;
        FilmReport::Frame& frame = report_.frames[index];
        if (state.job) {
            frame.job = *state.job;
            rays_ended_ += state.rays_traced();
        }
        frame.state = state.job ? std::string(to_string(state.job->phase)) : "not_submitted";
        const Outcome& outcome = *state.outcome;
        if (outcome.code == ExitCode::done) {
            frame.output = state.output;
            ++done_;
            if (state.job) {
                distrust_.update(*state.job);
                checks_.agreed += state.job->checks.agreed;
                checks_.unchecked += state.job->checks.unchecked;
            }
        } else {
            frame.reason = outcome.reason;
            unwritten_ += state.unwritten ? 1 : 0;
            // A disk that is full has no room for the others either.
            const bool drawn_in_vain = state.unwritten && state.job;
            const bool of_this_frame = !drawn_in_vain && (outcome.code == ExitCode::job_failed ||
                                                          outcome.code == ExitCode::cancelled);
            // What ails all of them is said once.
            if (of_this_frame || !gives_up_)
                console_.error(fmt::format("frame {}: {}{}", state.number, outcome.reason,
                                           drawn_in_vain ? "; no more frames are begun" : ""));
            if (!of_this_frame && !gives_up_)
                gives_up_ = outcome;
            failures_.push_back(outcome);
        }
        running_.erase(at);
    }

    void show_progress() {
        wait_.tick(net::now());
        copies_.tick(net::now());
        FilmMoment moment{.frame_count = waiting_.size(),
                          .written = done_,
                          .given_up = failures_.size(),
                          .at_hand = running_.size(),
                          .rays = rays_ended_};
        {
            const std::lock_guard lock(shared_.mutex);
            for (const auto& [index, one] : running_) {
                if (!one.state->job)
                    continue;
                distrust_.update(*one.state->job);
                moment.share_at_hand += share_done(*one.state->job);
                moment.share_per_s += share_per_s(*one.state->job);
                moment.worker_count =
                    std::max(moment.worker_count, one.state->job->film_worker_count);
                moment.rays += one.state->rays_traced();
            }
        }
        progress_.update(net::now(), moment);
    }

    void say_what_was_written() {
        std::vector<std::string> files;
        for (const FilmReport::Frame& frame : report_.frames)
            files.push_back(frame.output);
        if (done_ == 1)
            tell(console_, mode_, "wrote", "wrote " + runs_of(files));
        else if (done_ > 1)
            tell(console_, mode_, "wrote",
                 fmt::format("wrote {}: {}", counted(done_, "frame"), runs_of(files)));
    }

    /// `begun`: so many frames were.
    Outcome summary(std::size_t begun) {
        copies_.end();
        console_.end_redraw();
        say_what_was_written();
        if (const std::string words = unchecked_words(checks_); !words.empty())
            console_.warning(words);
        if (gives_up_ && gives_up_->code != ExitCode::job_failed)
            return *gives_up_;
        if (failures_.empty())
            return {};
        const std::string frames = counted(waiting_.size(), "frame");
        const std::size_t undrawn = failures_.size() - unwritten_;
        if (unwritten_ > 0)
            return {
                ExitCode::job_failed,
                said(fmt::format("{} of {} could not be written{}{}. Once they can, {}", unwritten_,
                                 frames, undrawn > 0 ? fmt::format(", {} not drawn", undrawn) : "",
                                 begun < waiting_.size()
                                     ? fmt::format(", {} not begun", waiting_.size() - begun)
                                     : "",
                                 way_on()))};
        const bool cancelled = std::ranges::all_of(
            failures_, [](const Outcome& o) { return o.code == ExitCode::cancelled; });
        return {cancelled ? ExitCode::cancelled : ExitCode::job_failed,
                said(fmt::format("{} of {} not drawn", undrawn, frames))};
    }

    [[nodiscard]] std::string way_on() const {
        return std::string("the same command with --skip-existing") +
               (options_.own_farm() ? "" : " --resume") + " goes on";
    }

    /// Jobs go on, where there is a farm; frames that were not submitted yet are not.
    void leave(const Outcome& outcome, std::size_t begun) {
        shared_.leaving = true;
        for (auto& [index, one] : running_)
            one.thread.join();
        copies_.end();
        std::string ids;
        std::size_t going_on = 0;
        for (auto& [index, one] : running_) {
            FilmReport::Frame& frame = report_.frames[index];
            if (one.state->outcome && one.state->outcome->code == ExitCode::done) {
                frame.output = one.state->output;
                ++done_;
            }
            if (!one.state->job)
                continue;
            frame.job = *one.state->job;
            frame.state = std::string(to_string(frame.job.phase));
            if (is_over(frame.job.phase))
                continue;
            ids += " " + fraja::to_string(frame.job.job);
            ++going_on;
        }
        running_.clear();
        console_.end_redraw();
        std::string text = fmt::format("{}; of {} {} written, {} not begun: {}", outcome.reason,
                                       counted(waiting_.size(), "frame"), done_,
                                       waiting_.size() - begun, way_on());
        if (!options_.own_farm() && going_on > 0)
            text += fmt::format("\n  going on:     {}\n"
                                "  watch them:   fraja-watch -b {}\n"
                                "  cancel them:  for job in{}; do fraja-ctl -b {} cancel --yes "
                                "$job; done",
                                counted(going_on, "frame"), broker_, ids, broker_);
        tell_parting(console_, mode_, text);
    }

    int end(Outcome outcome) {
        report_.outcome = std::move(outcome);
        report_.finished = std::chrono::system_clock::now();
        if (options_.shared.json)
            fmt::print("{}\n", film_json(report_));
        return static_cast<int>(console_.checked(report_.outcome.code));
    }

    const SubmitOptions& options_;
    const net::SignalWatch* signals_;
    Console console_;
    const ProgressMode mode_;
    const FilmId film_ = random_id<FilmId>();
    FilmProgress progress_;
    WaitNotice wait_;
    CopiesNotice copies_;
    DistrustNotice distrust_{console_};
    std::optional<SearchNotice> search_; ///< while frames are rendered
    FilmReport report_;
    std::optional<FilmScenes> scenes_;
    SessionOptions session_;
    std::vector<std::size_t> waiting_; ///< frames to be drawn, as report_ counts them
    std::size_t done_ = 0;
    protocol::CheckCounts checks_; ///< of these
    std::uint64_t rays_ended_ = 0; ///< of the frames that are over
    std::vector<Outcome> failures_;
    std::size_t unwritten_ = 0;       ///< of these: their files could not be written
    std::optional<Outcome> gives_up_; ///< why no more frames are submitted
    std::string broker_;
    bool connected_ = true;
    LossNotice loss_{console_};
    bool accepted_ = false;    ///< one frame was, at least
    bool worker_seen_ = false; ///< that draws one

    struct Running {
        std::unique_ptr<FrameState> state;
        std::jthread thread; ///< ends before the state does
    };
    const net::Context context_;
    std::unique_ptr<LocalFarm> farm_;
    Shared shared_;
    std::map<std::size_t, Running> running_;
};

} // namespace

int run_submit_film(const SubmitOptions& options, const net::SignalWatch* signals) {
    return FilmProgram(options, signals).run();
}

} // namespace fraja::client
