#include "client/ctl_options.hpp"

#include "client/farm_names.hpp"
#include "common/protocol/limits.hpp"

#include <CLI/CLI.hpp>
#include <array>
#include <filesystem>
#include <utility>

namespace fraja::client {
namespace {

constexpr const char* ctl_name = "fraja-ctl";
const std::vector<std::string> programs = {"fraja-broker", "fraja-worker", "fraja-submit",
                                           "fraja-watch", ctl_name};
constexpr const char* ctl_examples = R"(Examples:
  fraja-ctl jobs                         all jobs, the newest first
  fraja-ctl get '#17' -o now.png         the picture as far as it is
  fraja-ctl cancel cone                  asks, then cancels the newest job of that name
  fraja-ctl drain ada:4711               that worker gets no more tiles
  fraja-ctl keygen -o my.key             a key pair; prints the public key, for an allow-list
  fraja-ctl -b farm.example doctor       why does nothing happen?
  . <(fraja-ctl completion bash)         TAB completes options, jobs and workers in this shell

A JOB is an id, the beginning of one, a name (its newest job) or #N. A WORKER is an id, the
beginning of one, or a name.
)";

constexpr const char* brokers_words = R"(STATE is
  alone          the broker has no others (no --peer)
  leads          it deals out the tiles
  stands by      it has all that the others have, and goes on when the one that leads is gone
  fetches what the others have
                 it has started, or was away, and stands by soon
  ..., misses N other brokers
                 it does not hear so many that it knows of: gone, or not reached
  gone: WHY      it does not answer here, and none of the others hears it
  not reached from here: WHY
                 others hear it
  does not answer
                 who listens there is slow, hangs, or is no broker
or what is wrong with it: a full disk, or why it does not let us in.

All are asked at the same time; once one has answered, the others are given 1.5 s. Exit code: 0
where at least one answers, 4 where none lets us in, 3 where none is reached.
)";

Parsed<CtlOptions> read_command_line(std::vector<std::string> arguments,
                                     const std::vector<std::filesystem::path>& settings) {
    SharedArguments shared;
    EncodingArguments encoding;
    std::string job, worker, output;
    std::int32_t priority = 0;
    bool yes = false;
    CLI::App app(ctl_examples, ctl_name);
    shared.add_to(app, ctl_name);
    app.require_subcommand(1);
    app.fallthrough(); // the shared options may stand behind the command as well
    const auto command = [&](const char* name, const char* what) {
        return app.add_subcommand(name, what);
    };
    const auto takes_job = [&](CLI::App* sub) {
        sub->add_option("job", job, "Job")->required()->type_name("JOB");
    };
    const CLI::App* jobs = command("jobs", "All jobs");
    const CLI::App* workers = command("workers", "All workers");
    CLI::App* brokers =
        command("brokers", "All brokers that -b names, and those that stand for them");
    brokers->footer(brokers_words);
    const CLI::App* stats = command("stats", "What the farm has done since its broker started");
    const CLI::App* doctor = command("doctor", "Look what is wrong between here and the farm");
    CLI::App* show = command("show", "All about one job");
    takes_job(show);
    using enum protocol::JobDeed;
    using enum protocol::WorkerDeed;
    const std::array deeds = {
        std::pair(cancel, command("cancel", "Cancel a job")),
        std::pair(pause, command("pause", "Hand out no more of a job's tiles")),
        std::pair(resume, command("resume", "Go on with a paused job")),
        std::pair(retry, command("retry", "Go on with a job that failed or was cancelled")),
        std::pair(set_priority, command("prio", "Change a job's priority"))};
    for (const auto& [deed, sub] : deeds) {
        takes_job(sub);
        if (deed == set_priority)
            sub->add_option("priority", priority, "Higher goes first")
                ->required()
                ->check(CLI::Range(INT32_MIN, INT32_MAX))
                ->type_name("N");
        if (deed == cancel)
            sub->add_flag("--yes", yes, "Do not ask");
    }
    const std::array worker_deeds = {
        std::pair(drain, command("drain", "Give a worker no more tiles")),
        std::pair(undrain, command("undrain", "Give it tiles again, also out of quarantine")),
        std::pair(kick, command("kick", "Tell a worker to leave; others get its tiles"))};
    for (const auto& [deed, sub] : worker_deeds) {
        sub->add_option("worker", worker, "Worker")->required()->type_name("WORKER");
        if (deed == kick)
            sub->add_flag("--yes", yes, "Do not ask");
    }
    CLI::App* get = command("get", "Write the picture as far as it is");
    takes_job(get);
    get->add_option("-o,--output", output, "Picture file")->required()->type_name("FILE");
    encoding.add_to(*get);
    CLI::App* keygen = command("keygen", "Make a key pair, and print its public key");
    keygen
        ->add_option("-o,--output", output,
                     "Key file: for its owner alone, and never overwritten; with --broker-key it "
                     "names the broker, too")
        ->required()
        ->type_name("FILE");
    std::string shell;
    cli::Origins origins;
    CLI::App* completion = command("completion", "Print the script that completes our programs");
    completion->add_option("shell", shell, "Shell")
        ->required()
        ->check(CLI::IsMember({"bash", "zsh", "fish"}))
        ->type_name("SHELL");
    if (auto early =
            cli::parse(app, std::move(arguments), origins, farm_name_source(shared), settings))
        return *early;
    if (completion->parsed())
        return EarlyExit{0, *cli::completion_script(shell, programs)};

    CtlOptions options;
    auto read = shared.read(!keygen->parsed());
    if (!read)
        return cli::usage_error(ctl_name, origins.blame(read.error().message));
    options.shared = *std::move(read);
    if (const CLI::App* const sub = app.get_subcommands().front();
        (job.empty() && sub->get_option_no_throw("job")) ||
        (worker.empty() && sub->get_option_no_throw("worker")))
        return cli::usage_error(ctl_name, sub->get_name() + " '': empty, and a name is needed; "
                                                            "is a variable not set?");
    if (job.size() > protocol::string_bytes_max)
        return cli::usage_error(ctl_name, "that is no JOB: it is too long");
    if (worker.size() > protocol::string_bytes_max)
        return cli::usage_error(ctl_name, "that is no WORKER: it is too long");
    if (keygen->parsed()) {
        options.broker_key = shared.broker_key();
        options.command = MakeKey{output};
        return options;
    }
    if (const auto good = check_one_picture(output); !good)
        return cli::usage_error(ctl_name, good.error().message);
    const auto how = encoding.read(output, origins);
    if (!how)
        return cli::usage_error(ctl_name, origins.blame(how.error().message));
    if (jobs->parsed())
        options.command = ListJobs{};
    else if (workers->parsed())
        options.command = ListWorkers{};
    else if (brokers->parsed())
        options.command = ListBrokers{};
    else if (stats->parsed())
        options.command = ShowStats{};
    else if (doctor->parsed())
        options.command = Examine{};
    else if (show->parsed())
        options.command = ShowJob{job};
    else if (get->parsed())
        options.command = GetPicture{job, output, *how};
    for (const auto& [deed, sub] : deeds)
        if (sub->parsed())
            options.command = ControlJob{job, deed, priority, yes};
    for (const auto& [deed, sub] : worker_deeds)
        if (sub->parsed())
            options.command = ControlWorker{worker, deed, yes};
    return options;
}

} // namespace

Parsed<CtlOptions> parse_ctl_options(std::vector<std::string> arguments) {
    const auto whole = read_command_line(arguments, cli::settings_files());
    const auto* const early = std::get_if<EarlyExit>(&whole);
    if (!early || early->code == 0)
        return whole;
    // A doctor is needed most where settings files keep everything else from working.
    auto typed = read_command_line(std::move(arguments), {});
    if (auto* const options = std::get_if<CtlOptions>(&typed))
        if (auto* const doctor = std::get_if<Examine>(&options->command)) {
            doctor->refused_over = early->text.substr(0, early->text.find('\n'));
            return typed;
        }
    return whole;
}

} // namespace fraja::client
