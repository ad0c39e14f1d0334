#include "client/ctl_options.hpp"

#include "common/image_io/picture_file.hpp"
#include "common/protocol/limits.hpp"

#include <CLI/CLI.hpp>

namespace fraja::client {
namespace {

constexpr const char* program = "fraja-ctl";
constexpr const char* examples = R"(Examples:
  fraja-ctl jobs                         all jobs, the newest first
  fraja-ctl get '#17' -o now.png         the picture as far as it is
  fraja-ctl cancel cone                  asks, then cancels the newest job of that name

A JOB is an id, the beginning of one, a name (its newest job) or #N.
)";

} // namespace

Parsed<CtlOptions> parse_ctl_options(std::vector<std::string> arguments) {
    SharedArguments shared;
    std::string job, output;
    bool yes = false;
    CLI::App app(examples, program);
    shared.add_to(app, program);
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
    CLI::App* show = command("show", "All about one job");
    takes_job(show);
    CLI::App* cancel = command("cancel", "Cancel a job");
    takes_job(cancel);
    cancel->add_flag("--yes", yes, "Do not ask");
    CLI::App* get = command("get", "Write the picture as far as it is");
    takes_job(get);
    get->add_option("-o,--output", output, "Picture file")->required()->type_name("FILE");
    if (auto early = parse(app, std::move(arguments)))
        return *early;

    CtlOptions options;
    auto read = shared.read();
    if (!read)
        return usage_error(program, read.error().message);
    options.shared = *std::move(read);
    if (job.size() > protocol::string_bytes_max)
        return usage_error(program, "that is no JOB: it is too long");
    if (get->parsed())
        if (const auto kind = pixel_kind(output); !kind)
            return usage_error(program, kind.error().message);
    if (jobs->parsed())
        options.command = ListJobs{};
    else if (workers->parsed())
        options.command = ListWorkers{};
    else if (show->parsed())
        options.command = ShowJob{job};
    else if (cancel->parsed())
        options.command = CancelJob{job, yes};
    else
        options.command = GetPicture{job, output};
    return options;
}

} // namespace fraja::client
