#include "client/ctl.hpp"

#include "client/asking.hpp"
#include "client/doctor.hpp"
#include "client/farm_catcher.hpp"
#include "client/farm_names.hpp"
#include "client/json.hpp"
#include "client/notices.hpp"
#include "client/picture.hpp"
#include "client/progress_report.hpp"
#include "client/roll_call.hpp"
#include "client/shell.hpp"
#include "client/table.hpp"
#include "client/watching.hpp"
#include "common/base/text.hpp"
#include "common/discovery/source.hpp"
#include "common/net/clock.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <fmt/core.h>
#include <iostream>
#include <poll.h>
#include <string>
#include <unistd.h>
#include <utility>
#include <vector>

namespace fraja::client {
namespace {

class JobCatcher final : public Listener {
public:
    void hear(Instant, const News& news) override {
        if (const auto* changed = std::get_if<StateChanged>(&news))
            job = changed->state;
    }
    std::optional<protocol::JobState> job;
};

class PictureCatcher final : public Listener {
public:
    void hear(Instant, const News& news) override {
        if (const auto* accepted = std::get_if<Accepted>(&news))
            job = accepted->state, picture.emplace(accepted->state.settings);
        else if (const auto* changed = std::get_if<StateChanged>(&news))
            job = changed->state;
        else if (const auto* tile = std::get_if<TileArrived>(&news))
            picture->place(tile->tile, tile->cell_count);
        else if (const auto* withdrawn = std::get_if<TilesWithdrawn>(&news))
            for (const PixelRect& rect : withdrawn->rects)
                picture->withdraw(rect);
    }
    std::optional<protocol::JobState> job;
    std::optional<Picture> picture;
};

class CtlProgram {
public:
    CtlProgram(const CtlOptions& options, const net::SignalWatch* signals)
        : options_(options), signals_(signals), console_(options.shared.console) {}

    int run() {
        const Outcome outcome =
            std::visit([this](const auto& command) { return perform(command); }, options_.command);
        if (outcome.code != ExitCode::done && !outcome.reason.empty())
            console_.error(outcome.reason);
        return static_cast<int>(console_.checked(outcome.code));
    }

private:
    Outcome perform(const ListJobs&) {
        FarmCatcher catcher;
        const Outcome outcome = catch_farm(catcher);
        if (outcome.code == ExitCode::done && options_.shared.json)
            for (const auto& job : catcher.farm->jobs)
                fmt::print("{}\n", job_json(job));
        else if (outcome.code == ExitCode::done)
            fmt::print("{}", jobs_table(catcher.farm->jobs));
        return outcome;
    }

    Outcome perform(const ListWorkers&) {
        FarmCatcher catcher;
        const Outcome outcome = catch_farm(catcher);
        if (outcome.code == ExitCode::done && options_.shared.json)
            for (const auto& worker : catcher.farm->workers)
                fmt::print("{}\n", worker_json(worker));
        else if (outcome.code == ExitCode::done)
            fmt::print("{}", workers_table(catcher.farm->workers));
        return outcome;
    }

    /// Each for itself, and those that they tell of: done where at least one answers.
    Outcome perform(const ListBrokers&) {
        const net::Context context(options_.shared.keys);
        const std::vector<std::string> named = named_brokers();
        RollCall call(context, named, session_options(options_.shared),
                      {console_, ProgressReport::chosen(options_.shared.progress, console_), named,
                       net::now()});
        const Outcome outcome = call.hold(signals_);
        if (outcome.code == ExitCode::interrupted || outcome.code == ExitCode::terminated)
            return outcome;
        const std::vector<AskedBroker> brokers = call.brokers();
        if (options_.shared.json)
            for (const AskedBroker& broker : brokers)
                fmt::print("{}\n", broker_json(broker));
        else
            fmt::print("{}", brokers_table(brokers));
        std::fflush(stdout); // to let go of names that are being looked up may take a while
        return outcome;
    }

    /// With those that a source has now in its place; where it has none, it is asked as it stands.
    [[nodiscard]] std::vector<std::string> named_brokers() const {
        std::vector<std::string> brokers;
        for (const std::string& broker : options_.shared.brokers) {
            std::vector<std::string> found;
            if (discovery::is_source(broker))
                found = find_brokers(broker, options_.shared).endpoints;
            if (found.empty())
                found = {broker};
            for (std::string& endpoint : found)
                if (std::ranges::find(brokers, endpoint) == brokers.end())
                    brokers.push_back(std::move(endpoint));
        }
        return brokers;
    }

    Outcome perform(const ShowStats&) {
        FarmCatcher catcher;
        const Outcome outcome = catch_farm(catcher);
        if (outcome.code == ExitCode::done && options_.shared.json)
            fmt::print("{}\n", stats_json(*catcher.farm));
        else if (outcome.code == ExitCode::done)
            fmt::print("{}", stats_page(*catcher.farm));
        return outcome;
    }

    Outcome perform(const MakeKey& command) {
        const auto key = service::make_key_file(command.output, options_.broker_key);
        if (!key)
            return {ExitCode::usage, key.error().message};
        if (options_.shared.json)
            fmt::print("{}\n", key_json(command.output, key->text));
        else
            fmt::print("{}\n", key->text);
        console_.info("wrote " + command.output +
                      ": keep it secret. What is printed is the public key: a line 'ROLE KEY NAME' "
                      "in the allow-list of fraja-broker lets it in" +
                      // One that names a farm's key is none.
                      (options_.broker_key.empty()
                           ? ", as the key of a farm it is what --broker-key names"
                           : ""));
        return {};
    }

    /// The worst that was found: no broker, one that cannot be used, then what is wrong here.
    Outcome perform(const Examine& command) {
        const auto here = examine_machine(command.refused_over);
        const auto [there, ended] = examine_brokers(options_.shared, signals_);
        if (ended.code != ExitCode::done)
            return ended;
        if (options_.shared.json)
            for (const auto& findings : {here, there})
                for (const Finding& finding : findings)
                    fmt::print("{}\n", finding_json(finding));
        else
            fmt::print("{}", findings_page(here, there));
        const auto any_bad = [](const std::vector<Finding>& findings) {
            return std::ranges::count(findings, Finding::Grade::bad, &Finding::grade) > 0;
        };
        const bool reached = std::ranges::count(there, true, &Finding::no_broker) == 0;
        return {!reached         ? ExitCode::unreachable
                : any_bad(there) ? ExitCode::job_failed
                : any_bad(here)  ? ExitCode::usage
                                 : ExitCode::done,
                {}};
    }

    Outcome perform(const ShowJob& command) {
        JobCatcher catcher;
        const Outcome outcome = ask(JobQuestion{command.job}, catcher);
        if (outcome.code == ExitCode::done)
            fmt::print("{}", options_.shared.json ? job_json(*catcher.job) + "\n"
                                                  : job_page(*catcher.job));
        return outcome;
    }

    Outcome perform(const ControlJob& command) {
        JobCatcher catcher;
        if (const Outcome found = ask(JobQuestion{command.job}, catcher);
            found.code != ExitCode::done)
            return found;
        const std::string name = fmt::format("{} #{}", catcher.job->job_name, catcher.job->number);
        const bool cancels = command.deed == protocol::JobDeed::cancel;
        if (!cancels || !is_over(catcher.job->phase)) {
            if (cancels && !command.yes)
                if (const auto refused = refusal("cancel " + printable(name)))
                    return *refused;
            // By its id: a name may mean another job by now.
            const JobQuestion question{fraja::to_string(catcher.job->job), command.deed,
                                       command.priority};
            if (const Outcome outcome = ask(question, catcher); outcome.code != ExitCode::done)
                return outcome;
        }
        if (options_.shared.json)
            fmt::print("{}\n", job_json(*catcher.job));
        if (command.deed == protocol::JobDeed::set_priority)
            console_.info(fmt::format("{} has priority {}", name, catcher.job->priority));
        else
            console_.info(fmt::format("{} is {}", name, to_string(catcher.job->phase)));
        return {};
    }

    Outcome perform(const ControlWorker& command) {
        const bool kicks = command.deed == protocol::WorkerDeed::kick;
        if (kicks && !command.yes)
            if (const auto refused = refusal("kick " + printable(command.worker)))
                return *refused;
        FarmCatcher catcher;
        if (const Outcome outcome = ask(WorkerQuestion{command.worker, command.deed}, catcher);
            outcome.code != ExitCode::done)
            return outcome;
        for (const auto& worker : catcher.farm->workers) {
            if (options_.shared.json)
                fmt::print("{}\n", worker_json(worker));
            console_.info(fmt::format("{} {}", worker.worker_name,
                                      kicks ? "was told to leave"
                                      : command.deed == protocol::WorkerDeed::drain
                                          ? "gets no more tiles"
                                          : "gets tiles"));
        }
        return {};
    }

    Outcome perform(const GetPicture& command) {
        if (const auto writable = check_writable(command.output); !writable)
            return {ExitCode::usage, writable.error().message};
        const net::Context context(options_.shared.keys);
        PictureCatcher catcher;
        JobWatching watching(
            {command.job, session_options(options_.shared), {.share = 1, .once = true}},
            fresh_rng());
        const Outcome outcome = converse(context, watching, catcher, options_.shared);
        const bool has_picture = outcome.code == ExitCode::done ||
                                 outcome.code == ExitCode::job_failed ||
                                 outcome.code == ExitCode::cancelled;
        if (!has_picture || !catcher.picture)
            return with_cure(outcome, "JOB", command.job);
        const protocol::JobState& job = *catcher.job;
        if (const auto written = catcher.picture->write(command.output, job, command.encoding);
            !written)
            return {ExitCode::usage, written.error().message};
        if (options_.shared.json)
            fmt::print("{}\n", job_json(job));
        const ProgressMode mode = ProgressReport::chosen(options_.shared.progress, console_);
        if (job.phase == protocol::JobPhase::done)
            tell(console_, mode, "wrote", "wrote " + command.output);
        else
            console_.info(
                fmt::format("{} #{} is {}: {} holds {}% of its pixels", job.job_name, job.number,
                            to_string(job.phase), command.output,
                            100 * std::uint64_t{job.done_count} / std::max(1u, job.cell_count)));
        return {};
    }

    Outcome catch_farm(FarmCatcher& catcher) {
        const net::Context context(options_.shared.keys);
        FarmWatching watching(session_options(options_.shared));
        return converse(context, watching, catcher, options_.shared);
    }

    Outcome ask(Question question, Listener& catcher) {
        const net::Context context(options_.shared.keys);
        const auto* const worker = std::get_if<WorkerQuestion>(&question);
        const std::string name = worker ? worker->worker : std::get<JobQuestion>(question).job;
        const char* const what = worker ? "WORKER" : "JOB";
        Asking asking(std::move(question), session_options(options_.shared));
        return with_cure(converse(context, asking, catcher, options_.shared), what, name);
    }

    /// Where nothing has that name: what may have been meant.
    Outcome with_cure(Outcome outcome, std::string_view what, const std::string& name) {
        if (outcome.code == ExitCode::no_such_job)
            outcome.reason += meant_in_farm(options_.shared, what, name);
        return outcome;
    }

    /// Says that a broker is looked for, where that takes long.
    Outcome converse(const net::Context& context, Core& core, Listener& listener,
                     const SharedOptions& shared) {
        SearchingListener searching(listener,
                                    {console_, ProgressReport::chosen(shared.progress, console_),
                                     shared.brokers, net::now()});
        return client::converse(context, core, searching, signals_);
    }

    /// Asks on a terminal, where the deed may be refused; elsewhere nobody answers. It has been
    /// said then.
    std::optional<Outcome> refusal(const std::string& deed) {
        if (isatty(STDIN_FILENO) == 0 || !console_.is_terminal()) {
            console_.error("off a terminal, say --yes to " + deed);
            return Outcome{ExitCode::usage, {}};
        }
        fmt::print(stderr, "{}? [y/N] ", deed);
        std::array<pollfd, 2> heard{{{STDIN_FILENO, POLLIN, 0}, {-1, POLLIN, 0}}};
        if (signals_)
            heard[1].fd = signals_->fd();
        poll(heard.data(), heard.size(), -1);
        if (const auto signal = signals_ ? signals_->receive() : std::nullopt) {
            fmt::print(stderr, "\n");
            return outcome_of(*signal);
        }
        std::string answer;
        if (std::getline(std::cin, answer) && (answer == "y" || answer == "yes"))
            return std::nullopt;
        console_.error("nothing was done");
        return Outcome{ExitCode::usage, {}};
    }

    const CtlOptions& options_;
    const net::SignalWatch* signals_;
    Console console_;
};

} // namespace

int run_ctl(const CtlOptions& options, const net::SignalWatch* signals) {
    return CtlProgram(options, signals).run();
}

} // namespace fraja::client
