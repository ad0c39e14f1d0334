#include "client/watch_options.hpp"

#include "client/farm_names.hpp"
#include "common/base/text.hpp"
#include "common/image_io/picture_file.hpp"
#include "common/protocol/limits.hpp"

#include <CLI/CLI.hpp>

namespace fraja::client {
namespace {

constexpr const char* watch_name = "fraja-watch";
constexpr const char* watch_examples = R"(Examples:
  fraja-watch                      the table of jobs and workers, live
  fraja-watch '#17'                the tiles of job 17, one line each, as they finish
  fraja-watch cone -o now.png      also keep a picture current
  fraja-watch --json cone          the same as JSON lines, for scripts

A JOB is an id, the beginning of one, a name (its newest job) or #N; '' is the newest. It may be
joined at any time: every tile is shown exactly once. The exit code is the job's.
)";

} // namespace

std::optional<double> parse_until(std::string_view text) {
    if (text == "done")
        return 1.0;
    if (text == "first")
        return 0.0;
    if (!text.ends_with('%'))
        return std::nullopt;
    const auto percent = parse_count(text.substr(0, text.size() - 1));
    if (!percent || *percent > 100)
        return std::nullopt;
    return static_cast<double>(*percent) / 100;
}

Parsed<WatchOptions> parse_watch_options(std::vector<std::string> arguments) {
    WatchOptions options;
    SharedArguments shared;
    std::string until;
    CLI::App app(watch_examples, watch_name);
    app.add_option("job", options.job, "Job to follow; none: the farm")->type_name("JOB");
    app.add_option("-o,--output", options.output, "Keep this picture file current")
        ->type_name("FILE");
    app.add_option("--until", until, "Leave at done, first (tile), or at a share as 50%")
        ->default_str("done")
        ->type_name("WHEN");
    app.add_flag("--once", options.until.once, "Print what there is now, and leave");
    shared.add_to(app, watch_name);
    if (auto early = cli::parse(app, std::move(arguments), farm_name_source(shared)))
        return *early;
    auto read = shared.read();
    if (!read)
        return cli::usage_error(watch_name, read.error().message);
    options.shared = *std::move(read);
    if (!until.empty()) {
        const auto share = parse_until(until);
        if (!share)
            return cli::usage_error(watch_name,
                                    "--until " + until + ": done, first, or a share as 50%");
        options.until.share = *share;
    }
    if (!options.job && (!options.output.empty() || !until.empty()))
        return cli::usage_error(watch_name, "--output and --until need a JOB");
    if (options.job && options.job->size() > protocol::string_bytes_max)
        return cli::usage_error(watch_name, "that is no JOB: it is too long");
    if (!options.output.empty())
        if (const auto kind = pixel_kind(options.output); !kind)
            return cli::usage_error(watch_name, kind.error().message);
    return options;
}

} // namespace fraja::client
