#include "client/watch_options.hpp"

#include "client/farm_names.hpp"
#include "client/tev/packets.hpp"
#include "common/base/text.hpp"
#include "common/image_io/picture_file.hpp"
#include "common/protocol/limits.hpp"

#include <CLI/CLI.hpp>

namespace fraja::client {
namespace {

constexpr const char* watch_name = "fraja-watch";
constexpr const char* watch_examples = R"(Examples:
  fraja-watch                      the tables of broker, jobs and workers, live
  fraja-watch '#17'                the tiles of job 17, one line each, as they finish
  fraja-watch cone -o now.png      also keep a picture current
  fraja-watch cone --tev           also show it in tev, which runs here
  fraja-watch --json cone          the same as JSON lines, for scripts
  fraja-watch cone --serve         a live page for browsers, at http://127.0.0.1:50060/

A JOB is an id, the beginning of one, a name (its newest job) or #N; '' is the newest. It may be
joined at any time: every tile is shown exactly once, or on a terminal the picture as it grows
(--preview none: the tiles). The exit code is the job's, or 0 where one left by q, 130 by Ctrl-C.
)";

/// --tev may stand alone: then the word behind it, if it is no HOST:PORT, is none of its own.
void complete_tev(std::vector<std::string>& arguments) {
    for (std::size_t i = 0; i < arguments.size() && arguments[i] != "--"; ++i) {
        if (arguments[i] != "--tev")
            continue;
        const std::string next = i + 1 < arguments.size() ? arguments[i + 1] : "";
        const auto colon = next.rfind(':');
        if (colon == std::string::npos || !parse_count(next.substr(colon + 1)))
            arguments[i] += "=127.0.0.1:" + std::to_string(tev::port);
    }
}

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
    EncodingArguments encoding;
    std::string until;
    PreviewArgument preview;
    ServeOptions serve;
    CLI::App app(watch_examples, watch_name);
    app.add_option("job", options.job, "Job to follow; none: the farm")->type_name("JOB");
    app.add_option("-o,--output", options.output, "Keep this picture file current")
        ->type_name("FILE");
    encoding.add_to(app);
    app.add_option("--until", until, "Leave at done, first (tile), or at a share as 50%")
        ->default_str("done")
        ->type_name("WHEN");
    app.add_flag("--once", options.until.once, "Print what there is now, and leave");
    preview.add_to(app, "auto", false);
    app.add_option("--tev", options.tev, "Show the picture in tev, here or at HOST:PORT")
        ->type_name("[HOST:PORT]");
    CLI::Option* const serves = app.add_option("--serve", serve.at,
                                               "Serve a live page for browsers, there or at " +
                                                   std::string("127.0.0.1:50060"))
                                    ->expected(0, 1)
                                    ->type_name("[ADDR:PORT]");
    app.add_flag("--allow-control", serve.allow_control,
                 "With --serve: the page may pause, resume and cancel jobs");
    app.add_option("--token-file", serve.token_file,
                   "With --serve: the token that opens the page; off loopback one is made")
        ->envname("FRAJA_TOKEN_FILE")
        ->type_name("FILE");
    shared.add_to(app, watch_name);
    complete_tev(arguments);
    cli::Origins origins({{"--serve", "--output"},
                          {"--serve", "--until"},
                          {"--serve", "--once"},
                          {"--serve", "--tev"},
                          {"--serve", "--json"}});
    const auto mistake = [&](const std::string& text) {
        return cli::usage_error(watch_name, origins.blame(text));
    };
    if (auto early = cli::parse(app, std::move(arguments), origins, farm_name_source(shared)))
        return *early;
    auto read = shared.read();
    if (!read)
        return mistake(read.error().message);
    options.shared = *std::move(read);
    if (!until.empty()) {
        const auto share = parse_until(until);
        if (!share)
            return mistake("--until " + until + ": done, first, or a share as 50%");
        options.until.share = *share;
    }
    options.preview = preview.read();
    if (!options.job && (!options.output.empty() || !until.empty() || options.tev))
        return mistake("--output, --until and --tev need a JOB");
    if (!options.job && options.preview != PreviewMode::automatic &&
        options.preview != PreviewMode::none)
        return mistake("--preview needs a JOB");
    if (serves->count() > 0) {
        if (!options.output.empty() || !until.empty() || options.until.once ||
            options.shared.json || options.tev)
            return mistake("--serve shows all there is in a browser: it goes with "
                           "no --output, --until, --once, --tev or --json");
        options.serve = std::move(serve);
    } else if (serve.allow_control) {
        return mistake("--allow-control needs --serve");
    } else if (origins.is_typed("--token-file")) {
        return mistake("--token-file needs --serve: it is the live page that a token opens");
    }
    if (const auto good = check_one_picture(options.output); !good)
        return mistake(good.error().message);
    if (options.job && options.job->size() > protocol::string_bytes_max)
        return mistake("that is no JOB: it is too long");
    if (options.output.empty())
        for (const char* option : {"--half", "--transfer"})
            if (origins.is_typed(option))
                return mistake(std::string(option) + " is for the file that --output names");
    const auto how = encoding.read(options.output, origins);
    if (!how)
        return mistake(how.error().message);
    options.encoding = *how;
    return options;
}

} // namespace fraja::client
