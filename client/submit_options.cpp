#include "client/submit_options.hpp"

#include "client/notices.hpp"
#include "common/base/ids.hpp"
#include "common/base/text.hpp"
#include "common/net/endpoint.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/passes.hpp"
#include "common/render/kernel/render.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <utility>

namespace fraja::client {
namespace {

constexpr const char* submit_name = "fraja-submit";
constexpr const char* submit_examples = R"(Examples:
  fraja-submit --local scenes/cone.raj -o cone.png     render here, without any daemon
  fraja-submit scenes/cone.raj -r 1920x1080 -a 4       render on the farm to ./cone.png
  fraja-submit scenes/cone.raj --error 1               right to about one level of 255
  fraja-submit scenes/cone.raj --time-limit 30s        the best picture in half a minute
  fraja-submit --preview scenes/cone.raj               see it grow, in this terminal
  fraja-submit --direct host1:7001,host2:7001 a.raj    on workers that listen, without a broker
  fraja-submit scenes/cone.raj --travel scenes/travels/cone.raj -o cone%04d.png    a film
  job=$(fraja-submit --detach scenes/cone.raj)         submit and leave; then: fraja-watch $job

Submits a scene, follows it, and writes the picture. Exit: 0 done, 1 the job failed, 2 usage or
scene, 3 no broker, 4 refused, 5 cancelled, 124 --timeout ran out.
FRAJA_ISA=x86-64-v2 (-v3, -v4) forces the instruction set of --local; it never changes pixels.
)";

constexpr std::uint32_t threads_max = 2048;
constexpr std::uint32_t workers_max = 1'000'000;
constexpr std::size_t direct_max = 10'000;
/// More is asked for than floats can tell.
constexpr double error_min = 0.001;

/// What is typed, as it is typed.
struct Arguments {
    SharedArguments shared;
    EncodingArguments encoding;
    PreviewArgument preview;
    SubmitOptions options;
    std::string size, crop, tile = "auto", order = "auto", schedule = "demand", kernel = "fast",
                            filter = "box", time_limit, timeout, frames, verify;
    CLI::Option *max_samples = nullptr, *broker = nullptr;
    std::vector<std::string> direct;
    bool overwrite = false;
    /// What a settings file wishes for all jobs gives way to what is typed for this one.
    cli::Origins origins{{{"--overwrite", "--skip-existing"},
                          {"--detach", "--local"},
                          {"--detach", "--direct"},
                          {"--detach", "--output"},
                          {"--detach", "--wait"},
                          {"--detach", "--stats"},
                          {"--detach", "--skip-existing"},
                          {"--detach", "--preview"},
                          {"--detach", "--travel"},
                          {"--resume", "--local"},
                          {"--resume", "--direct"},
                          {"--resume", "--time-limit"},
                          {"--local", "--direct"},
                          {"--tag", "--local"},
                          {"--layers", "--time-limit"},
                          {"--schedule", "--time-limit"},
                          {"--verify", "--time-limit"},
                          {"--verify", "--local"},
                          {"--travel", "--time-limit"},
                          {"--travel", "--schedule"},
                          {"--travel", "--stats"},
                          {"--travel", "--preview"}}};
};

void add_picture_options(CLI::App& app, Arguments& a) {
    app.add_option("-o,--output", a.options.output,
                   "Picture file: .png .tif .jpg .webp .bmp .ppm .tga .dpx ..., what OpenImageIO "
                   "writes; or .exr (linear, with metadata), .hdr (linear)")
        ->default_str("scene name + .png")
        ->type_name("FILE");
    a.encoding.add_to(app);
    app.add_flag("--layers", a.options.settings.layers,
                 "Into an .exr also what stands at the middle of each pixel: distance, normal, "
                 "solid");
    app.add_option(
           "--travel", a.options.travel_file,
           "A film: a .raj list of cameras, a frame each; number the files: -o cone%04d.png")
        ->type_name("FILE");
    app.add_option("--frames", a.frames, "Of a film these frames, counted from 1; every S-th")
        ->default_str("all")
        ->type_name("A-B[xS]");
    app.add_option("-r,--size", a.size, "Resolution")->default_str("256x192")->type_name("WxH");
    app.add_option("--crop", a.crop, "Only this rectangle")->type_name("X,Y,W,H");
    app.add_option("-d,--depth", a.options.settings.depth, "Recursion depth")
        ->capture_default_str()
        ->check(CLI::Range(0u, protocol::depth_max))
        ->type_name("N");
    app.add_option("-a,--aa", a.options.settings.aa,
                   "N x N regular samples per pixel; 0: one at its centre")
        ->capture_default_str()
        ->check(CLI::Range(0u, protocol::aa_max))
        ->type_name("N");
    CLI::Option* const spp = app.add_option("--spp", a.options.settings.spp,
                                            "N low-discrepancy samples per pixel, instead of --aa")
                                 ->check(CLI::Range(1u, protocol::samples_max))
                                 ->excludes("--aa")
                                 ->type_name("N");
    CLI::Option* const error =
        app.add_option("--error", a.options.settings.error,
                       "As many samples as a pixel needs until its error is about E levels of 255")
            ->check(CLI::Range(error_min, protocol::error_max))
            ->excludes("--aa")
            ->excludes(spp)
            ->type_name("E");
    app.add_option("--time-limit", a.time_limit,
                   "The best picture that there is time for, in passes over all of it")
        ->excludes("--aa")
        ->excludes(spp)
        ->excludes(error)
        ->type_name("T");
    a.max_samples = app.add_option("--max-samples", a.options.settings.max_samples,
                                   "Ceiling per pixel for --error (4, 8, 16 ...) and --time-limit")
                        ->capture_default_str()
                        ->check(CLI::Range(protocol::samples_min, protocol::samples_max))
                        ->type_name("N");
    app.add_option("--filter", a.filter, "Pixel filter of --spp, --error and --time-limit")
        ->capture_default_str()
        ->check(CLI::IsMember({"box", "tent"}))
        ->type_name("FILTER");
    app.add_flag("-e,--exact", a.options.settings.exact, "No cut-off of faint rays");
    app.add_option("--kernel", a.kernel,
                   "Ray tracer: fast, or reference (plain, with Raja's own arithmetic)")
        ->capture_default_str()
        ->check(CLI::IsMember({"fast", "reference"}))
        ->type_name("KERNEL");
}

void add_job_options(CLI::App& app, Arguments& a) {
    SubmitOptions& o = a.options;
    app.add_option("--tile", a.tile, "Side of a tile in pixels, or auto")
        ->capture_default_str()
        ->type_name("N");
    app.add_option("--order", a.order, "In which order tiles appear; never changes pixels")
        ->capture_default_str()
        ->check(CLI::IsMember({"auto", "scan", "spiral", "diadic"}))
        ->type_name("ORDER");
    app.add_option("-p,--priority", o.priority, "Higher goes first")
        ->capture_default_str()
        ->check(CLI::Range(INT32_MIN, INT32_MAX))
        ->type_name("N");
    app.add_option("--max-workers", o.wishes.workers_max, "At most so many workers at a time")
        ->default_str("as many as help")
        ->check(CLI::Range(1u, workers_max))
        ->type_name("N");
    app.add_option("--tag", o.wishes.tags,
                   "Only workers with this tag, K or K=V; K alone fits any value; repeatable")
        ->allow_extra_args(false)
        ->type_name("K[=V]");
    app.add_option("--schedule", a.schedule,
                   "How tiles are dealt out: demand; or at the start, for comparison: static "
                   "(equal shares), weighted (by cost and capacity) or stealing")
        ->capture_default_str()
        ->check(CLI::IsMember({"demand", "static", "weighted", "stealing"}))
        ->type_name("SCHEDULE");
    app.add_option("--verify", a.verify,
                   "Have this share of the tiles (0.1 or 10%) drawn by a second worker as well and "
                   "compared: one that answers wrong pixels is found, and its tiles drawn again")
        ->default_str("0")
        ->type_name("P");
    app.add_option("-n,--name", o.job_name, "Name of the job")
        ->default_str("scene name")
        ->type_name("NAME");
    app.add_flag("--local", o.local, "Render in this process: no daemon needed");
    const auto direct = [&a](const std::vector<std::string>& workers) {
        a.direct.insert(a.direct.end(), workers.begin(), workers.end()); // of each mention
        a.broker->envname("")->configurable(
            false); // a broker that is set is for jobs that want one
    };
    app.add_option_function<std::vector<std::string>>(
           "--direct", direct,
           "Call these workers (fraja-worker --listen) and deal the tiles out from here, without a "
           "broker; waits --connect-timeout for the first; a comma list, or repeatable")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->type_name("HOST:PORT")
        ->trigger_on_parse();
    app.add_option("-j,--threads", o.local_threads, "Threads of --local")
        ->default_str("every CPU")
        ->check(CLI::Range(1u, threads_max))
        ->type_name("N");
}

void add_conduct_options(CLI::App& app, Arguments& a) {
    SubmitOptions& o = a.options;
    app.add_flag("--detach", o.detach, "Print the job's id, alone on stdout, and leave");
    app.add_flag("--wait", o.wait, "Wait without a progress line");
    app.add_flag(
        "--resume", o.resume,
        "Take over the newest job of the same scene and settings, if there is one; one that "
        "failed or was cancelled goes on with what it has");
    app.add_option("--timeout", a.timeout,
                   "Leave after this time with exit 124; the job goes on, but with --local or "
                   "--direct, where what is done is saved as NAME.unfinished.png")
        ->type_name("T");
    a.preview.add_to(app, "none", true);
    app.add_flag("--dry-run", o.dry_run, "Check everything and say what would be rendered");
    app.add_flag("--stats", o.stats,
                 "Print rays by kind, what they cost, the estimated error, and times");
    app.add_flag("--overwrite", a.overwrite, "Replace an existing output when done (the default)");
    app.add_flag("--skip-existing", o.skip_existing, "Nothing is rendered where the output exists");
}

/// The name of a scene file without folder and extension.
std::string stem_of(const std::string& file) {
    const std::string stem = std::filesystem::path(file).stem().string();
    return stem.empty() ? "scene" : stem;
}

/// Settings that are for other jobs than this one.
void pass_over_settings(Arguments& a) {
    protocol::PictureSettings& s = a.options.settings;
    if (a.origins.is_typed("--broker")) { // one that is set excludes neither
        if (a.origins.is_setting("--local"))
            a.options.local = false;
        if (a.origins.is_setting("--direct"))
            a.direct.clear();
    }
    const bool estimated = s.error > 0 || !a.time_limit.empty();
    if (!estimated && a.origins.is_setting("--max-samples")) {
        a.max_samples->clear();
        s.max_samples = protocol::PictureSettings().max_samples;
    }
    if (!estimated && s.spp == 0 && a.origins.is_setting("--filter"))
        a.filter = "box";
    if (!a.options.local && a.origins.is_setting("--threads"))
        a.options.local_threads = 0;
}

Result<void> read_picture(Arguments& a) {
    protocol::PictureSettings& s = a.options.settings;
    pass_over_settings(a);
    if (!a.size.empty()) {
        const auto size = parse_extent(a.size);
        if (!size)
            return invalid_option("--size " + a.size + ": a picture's size is written as 640x480");
        s.size = *size;
    }
    s.crop = {0, 0, s.size.width, s.size.height};
    if (!a.crop.empty()) {
        const auto crop = parse_rect(a.crop);
        if (!crop)
            return invalid_option("--crop " + a.crop + ": a rectangle is written as X,Y,W,H");
        s.crop = *crop;
    }
    if (!a.time_limit.empty()) {
        const auto limit = parse_duration(a.time_limit);
        if (!limit || *limit <= Duration::zero())
            return invalid_option("--time-limit " + a.time_limit +
                                  ": a time above 0 is written as 90, 1.5s, 5m or 1h30m");
        s.time_limit = *limit;
    }
    if (*a.max_samples && s.error == 0 && !s.limited_in_time())
        return invalid_option("--max-samples: without --error or --time-limit there is nothing "
                              "that it limits");
    using enum protocol::KernelChoice;
    s.kernel = a.kernel == "reference" ? reference : fast;
    s.filter = a.filter == "tent" ? protocol::PixelFilter::tent : protocol::PixelFilter::box;
    if (a.options.local && s.kernel == fast)
        if (const auto isa = kernel::instruction_set(); !isa)
            return invalid_option(isa.error().message);
    const auto valid = protocol::validate(s);
    return valid ? Result<void>() : invalid_option("--" + valid.error().message);
}

Result<void> read_verify(Arguments& a) {
    SubmitOptions& o = a.options;
    if (a.verify.empty())
        return {};
    const auto share = parse_share(a.verify);
    if (!share)
        return invalid_option("--verify " + a.verify +
                              ": a share of the tiles is written as 0.1 or 10%, up to 100%");
    o.wishes.verify = *share;
    if (*share > 0 && o.local)
        return invalid_option("--verify and --local contradict each other: a tile is checked by "
                              "another worker, and here is one");
    if (*share > 0 && o.settings.limited_in_time())
        return invalid_option("--verify and --time-limit contradict each other: the time is for "
                              "drawing; --spp or --error ends by itself");
    if (*share > 0 && o.wishes.workers_max == 1)
        return invalid_option("--verify needs two workers: not with --max-workers 1");
    return {};
}

Result<void> read_tiles(Arguments& a) {
    SubmitOptions& o = a.options;
    using enum protocol::TileOrder;
    o.order = a.order == "scan"     ? scan
              : a.order == "spiral" ? spiral
              : a.order == "diadic" ? diadic
                                    : automatic;
    o.wishes.schedule = a.schedule == "static"     ? protocol::Schedule::equal
                        : a.schedule == "weighted" ? protocol::Schedule::weighted
                        : a.schedule == "stealing" ? protocol::Schedule::stealing
                                                   : protocol::Schedule::demand;
    if (o.wishes.schedule != protocol::Schedule::demand && o.settings.limited_in_time())
        return invalid_option("--schedule " + a.schedule +
                              ": a picture with --time-limit is dealt out on demand");
    if (const auto read = read_verify(a); !read)
        return read;
    if (o.wishes.tags.size() > protocol::tags_max)
        return invalid_option("--tag: at most " + std::to_string(protocol::tags_max) + " of them");
    for (const std::string& tag : o.wishes.tags)
        if (tag.empty() || tag.starts_with('=') || tag.size() > protocol::name_bytes_max)
            return invalid_option("--tag '" + tag.substr(0, protocol::name_bytes_max) +
                                  "': K or K=V of at most " +
                                  std::to_string(protocol::name_bytes_max) + " bytes");
    if (a.tile == "auto")
        return {};
    const auto side = parse_count(a.tile);
    if (!side || *side < 1 || *side > protocol::tile_side_max)
        return invalid_option("--tile " + a.tile + ": auto, or 1 to " +
                              std::to_string(protocol::tile_side_max) + " pixels");
    o.tile_side = static_cast<std::uint32_t>(*side);
    if (cells_of(o.settings.crop, o.tile_side).pixel_count() * protocol::pass_count(o.settings) >
        protocol::cells_per_job_max)
        return invalid_option("--tile " + a.tile + ": that makes more than " +
                              std::to_string(protocol::cells_per_job_max) + " tiles");
    return {};
}

/// Each once, as whole endpoints.
Result<void> read_direct(Arguments& a) {
    SubmitOptions& o = a.options;
    if (a.direct.empty())
        return {};
    if (a.broker->count() > 0)
        return invalid_option("--direct and --broker contradict each other: without a broker, or "
                              "with one");
    if (o.local)
        return invalid_option("--direct and --local contradict each other: on other workers, or "
                              "here");
    if (o.detach)
        return invalid_option("--detach needs a farm that goes on: not with --direct");
    if (o.resume)
        return invalid_option("--resume needs a farm that goes on: not with --direct");
    if (a.direct.size() > direct_max)
        return invalid_option("--direct: at most " + std::to_string(direct_max) + " workers");
    for (const std::string& text : a.direct) {
        auto worker = net::endpoint_to_connect(text, 0);
        if (!worker)
            return invalid_option("--direct: " + worker.error().message +
                                  " (fraja-worker --listen prints its own)");
        if (!worker->starts_with("tcp://"))
            return invalid_option("--direct " + text + ": a worker is reached at tcp://HOST:PORT");
        if (std::ranges::find(o.direct, *worker) != o.direct.end())
            return invalid_option("--direct " + text + ": the same worker twice");
        o.direct.push_back(std::move(*worker));
    }
    return {};
}

Result<void> read_conduct(Arguments& a) {
    SubmitOptions& o = a.options;
    o.preview = a.preview.read();
    if (!a.timeout.empty()) {
        o.timeout = parse_duration(a.timeout);
        if (!o.timeout)
            return invalid_option("--timeout " + a.timeout +
                                  ": a duration is written as 90, 90s, 5m or 1h30m");
    }
    if (o.detach && !o.travel_file.empty())
        return invalid_option("--detach and --travel contradict each other: a film's frames are "
                              "submitted as machines come free, so leave it running; once "
                              "interrupted, it goes on with --skip-existing --resume");
    if (o.detach && !o.output.empty())
        return invalid_option("--detach leaves before there is a picture: without --output; use "
                              "fraja-ctl get JOB -o FILE later");
    if (o.detach && o.local)
        return invalid_option("--detach needs a farm that goes on: not with --local");
    if (o.local && a.origins.is_typed("--broker"))
        return invalid_option("--local and -b/--broker contradict each other: here, or on a farm");
    if (o.detach && o.wait)
        return invalid_option("--detach and --wait contradict each other");
    if (o.detach && (o.stats || o.skip_existing || o.preview != PreviewMode::none))
        return invalid_option("--detach leaves before the job is done: without --stats, "
                              "--skip-existing and --preview");
    if (o.local && !o.wishes.tags.empty())
        return invalid_option("--tag chooses among a farm's workers: not with --local");
    if (o.resume && o.local)
        return invalid_option("--resume needs a farm that goes on: not with --local");
    if (o.resume && o.settings.limited_in_time())
        return invalid_option("--resume: the time of a job with --time-limit goes on without you");
    if (o.local_threads != 0 && !o.local)
        return invalid_option("--threads is for --local; on a farm, the workers have theirs");
    if (a.overwrite && o.skip_existing)
        return invalid_option("--overwrite and --skip-existing contradict each other");
    return {};
}

/// #N
bool is_job_number(std::string_view name) {
    return name.starts_with('#') && parse_count(name.substr(1)).has_value();
}

Result<void> read_names(Arguments& a) {
    SubmitOptions& o = a.options;
    if (o.job_name.size() > protocol::name_bytes_max)
        return invalid_option("--name: at most " + std::to_string(protocol::name_bytes_max) +
                              " bytes");
    if (is_job_number(o.job_name))
        return invalid_option("--name " + o.job_name + ": so a JOB is called by its number");
    if (o.job_name.empty())
        o.job_name = stem_of(o.scene_file).substr(0, protocol::name_bytes_max);
    o.job_name = printable(o.job_name);
    if (!o.travel_file.empty())
        return {}; // read_film() looks at it
    if (o.output.find('%') != std::string::npos)
        return invalid_option("--output " + o.output +
                              ": % is for the numbers of a film's frames: give --travel FILE");
    if (o.output.empty() && !o.detach)
        o.output = stem_of(o.scene_file) + ".png";
    return {};
}

Result<void> read_encoding(Arguments& a) {
    SubmitOptions& o = a.options;
    if (o.detach)
        return {};
    auto encoding = a.encoding.read(o.output, a.origins);
    if (!encoding)
        return encoding.error();
    o.encoding = *encoding;
    if (const auto kind = pixel_kind(o.output);
        o.settings.layers && kind && *kind != PixelKind::radiance_and_more) {
        if (a.origins.is_setting("--layers"))
            return o.settings.layers = false, Result<void>();
        return invalid_option("--layers are for .exr: " + o.output + " holds colours alone");
    }
    return {};
}

Result<void> read_film(Arguments& a) {
    SubmitOptions& o = a.options;
    if (o.travel_file.empty())
        return a.frames.empty()
                   ? Result<void>()
                   : invalid_option(
                         "--frames are those of a film: give its cameras, --travel FILE");
    if (!a.frames.empty()) {
        o.frames = parse_frames(a.frames);
        if (!o.frames)
            return invalid_option("--frames " + a.frames +
                                  ": written as A-B or A-BxS, with 1 <= A <= B and S >= 1");
    }
    if (o.output.empty())
        return invalid_option("--travel draws many pictures: number their files, as in -o " +
                              stem_of(o.scene_file) + "%04d.png");
    if (const auto good = check_frame_pattern(o.output); !good)
        return invalid_option("--output " + o.output + ": " + good.error().message);
    if (o.settings.limited_in_time())
        return invalid_option("--time-limit is for a single picture: not with --travel");
    if (o.wishes.schedule != protocol::Schedule::demand)
        return invalid_option("--schedule " + a.schedule +
                              ": a film's frames are dealt out on demand");
    if (o.stats)
        return invalid_option("--stats is for a single picture: a film has --json");
    if (o.preview != PreviewMode::none)
        return invalid_option("--preview is for a single picture: not with --travel");
    return {};
}

/// --preview may stand alone; a mode behind it is its own. Errors: what stands behind it is neither
/// a mode nor a scene.
Result<void> complete_preview(std::vector<std::string>& arguments) {
    for (std::size_t i = 0; i + 1 < arguments.size() && arguments[i] != "--"; ++i) {
        const std::string next = arguments[i + 1];
        if (arguments[i] != "--preview" || next.starts_with('-'))
            continue;
        std::error_code ignored;
        if (PreviewArgument::is_mode(next)) {
            arguments[i] += "=" + next;
            arguments.erase(arguments.begin() + static_cast<std::ptrdiff_t>(i) + 1);
        } else if (!std::filesystem::path(next).has_extension() &&
                   !std::filesystem::exists(next, ignored)) {
            return invalid_option("--preview " + next + ": there is no scene of that name, and " +
                                  "the modes are " + PreviewArgument::cure_of(next));
        }
    }
    return {};
}

} // namespace

Parsed<SubmitOptions> parse_submit_options(std::vector<std::string> arguments) {
    Arguments a;
    CLI::App app(submit_examples, submit_name);
    app.add_option("scene", a.options.scene_file, "Scene file")->required()->type_name("SCENE.raj");
    add_picture_options(app, a);
    add_job_options(app, a);
    add_conduct_options(app, a);
    a.shared.add_to(app, submit_name,
                    kernel::instruction_set().value_or("no instruction set to render with"));
    a.broker = app.get_option("--broker");
    if (const auto good = complete_preview(arguments); !good)
        return cli::usage_error(submit_name, good.error().message);
    if (auto early = cli::parse(app, std::move(arguments), a.origins))
        return *early;
    for (const auto read : {read_picture, read_tiles, read_direct, read_conduct, read_names,
                            read_film, read_encoding})
        if (const auto good = read(a); !good)
            return cli::usage_error(submit_name, a.origins.blame(good.error().message));
    auto shared = a.shared.read(!a.options.local);
    if (!shared)
        return cli::usage_error(submit_name, a.origins.blame(shared.error().message));
    a.options.shared = *std::move(shared);
    if (a.options.wait)
        a.options.shared.progress = ProgressMode::none;
    return std::move(a.options);
}

std::string broker_text(const SubmitOptions& options) {
    return options.local            ? "none: in this process"
           : options.direct.empty() ? options.brokers_asked()
                                    : "none: workers at " + comma_list(options.direct);
}

std::string worker_cure(const SubmitOptions& options, const std::string& broker) {
    return options.direct.empty() ? worker_cure(broker)
                                  : "none answers yet at " + comma_list(options.direct);
}

std::string why_no_worker(const SubmitOptions& options) {
    return "no worker takes tiles at " + comma_list(options.direct) +
           ": none listens there, or all serve somebody else" +
           (options.wishes.tags.empty() ? "" : ", or none has the tags") +
           " (--connect-timeout says how long to wait for the first)";
}

protocol::SubmitJob new_job(const SubmitOptions& options, std::string name,
                            const ContentHash& scene, std::uint64_t scene_bytes) {
    return {.job = random_id<JobId>(),
            .job_name = std::move(name),
            .scene = scene,
            .scene_bytes = scene_bytes,
            .settings = options.settings,
            .tile_side = options.tile_side,
            .order = options.order,
            .priority = options.priority,
            .wishes = options.wishes,
            .resume = options.resume};
}

} // namespace fraja::client
