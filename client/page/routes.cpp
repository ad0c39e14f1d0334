#include "client/page/routes.hpp"

#include "client/page/assets.hpp"
#include "client/page/viewer_lines.hpp"
#include "common/base/text.hpp"

#include <memory>
#include <string>
#include <utility>

namespace fraja::client {
namespace {

http::Answer not_found() {
    return http::refusal(404, "There is no such thing here.");
}

http::Answer not_allowed(const std::string& methods) {
    http::Answer answer = http::refusal(405, "Here is answered: " + methods + ".");
    answer.allow = methods;
    return answer;
}

http::Answer refusal(const Error& error) {
    const int status = error.code == ErrorCode::not_found          ? 404
                       : error.code == ErrorCode::invalid_argument ? 400
                       : error.code == ErrorCode::limit_exceeded   ? 503
                                                                   : 500;
    http::Answer answer = http::refusal(status, error.message);
    if (status == 503)
        answer.retry_after_s = 5;
    return answer;
}

std::string parameter(const http::Request& request, const std::string& name) {
    const auto found = request.query.find(name);
    return found == request.query.end() ? std::string() : found->second;
}

std::optional<protocol::JobDeed> deed_named(std::string_view name) {
    using enum protocol::JobDeed;
    if (name == "pause")
        return pause;
    if (name == "resume")
        return resume;
    if (name == "cancel")
        return cancel;
    return std::nullopt;
}

std::optional<Layer> layer_named(std::string_view file) {
    if (file == "picture.jpg")
        return Layer::overview;
    if (file == "cost.png")
        return Layer::costs;
    if (file == "workers.png")
        return Layer::workers;
    if (file == "picture.png")
        return Layer::pixels;
    return std::nullopt;
}

/// As clients' exit codes would be said in HTTP.
int status_of(ExitCode code) {
    switch (code) {
    case ExitCode::done:
        return 200;
    case ExitCode::no_such_job:
        return 404;
    case ExitCode::usage:
        return 409;
    default:
        return 502;
    }
}

} // namespace

http::Headers page_headers() {
    return {{"Content-Security-Policy",
             "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
             "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"},
            {"X-Content-Type-Options", "nosniff"},
            {"Referrer-Policy", "no-referrer"},
            {"Cross-Origin-Resource-Policy", "same-origin"}};
}

Routes::Routes(Door door, FarmBoard& board, JobViews& views, Control control)
    : door_(std::move(door)), board_(board), views_(views), control_(std::move(control)) {}

http::Answer Routes::answer(const http::Request& request) const {
    if (auto refused = door_.refusal(request))
        return *std::move(refused);
    const std::string_view path = request.path;
    const bool posts = request.method == "POST";
    if (!posts && request.method != "GET" && request.method != "HEAD")
        return not_allowed("GET, HEAD, POST");
    if (path.starts_with("/job/")) {
        const std::string_view rest = path.substr(5);
        const std::size_t slash = std::min(rest.find('/'), rest.size());
        const auto job = parse_id<JobId>(rest.substr(0, slash));
        if (!job || slash == rest.size())
            return not_found();
        const std::string_view what = rest.substr(slash + 1);
        return posts ? do_with(*job, what) : picture(request, *job, what);
    }
    if (posts)
        return not_found();
    if (path == "/events")
        return request.method == "GET" ? events(request) : not_allowed("GET");
    const std::string_view name =
        path == "/" ? "index.html" : path.substr(std::min<std::size_t>(1, path.size()));
    for (const Asset& asset : page_assets())
        if (asset.name == name)
            return {.type = std::string(asset.type),
                    .body = http::body(std::string(asset.text)),
                    .caching = "no-cache",
                    .cookie = door_.cookie(request)};
    return not_found();
}

http::Answer Routes::events(const http::Request& request) const {
    std::shared_ptr<Viewer> viewer;
    if (const std::string name = parameter(request, "job"); !name.empty()) {
        const auto job = parse_id<JobId>(name);
        if (!job)
            return http::refusal(400, "job=" + printable(clipped(name, 100)) + " is no job's id.");
        auto looks = views_.look_at(*job);
        if (!looks)
            return refusal(looks.error());
        viewer = *std::move(looks);
    }
    return {.type = "application/x-ndjson",
            .lines = std::make_shared<ViewerLines>(board_, std::move(viewer))};
}

http::Answer Routes::picture(const http::Request& request, const JobId& job,
                             std::string_view what) const {
    const auto view = views_.find(job);
    if (!view)
        return http::refusal(404, "Nobody looks at this job: ask for /events?job=" +
                                      fraja::to_string(job) + " meanwhile.");
    if (what == "part.jpg") {
        const auto rect = parse_rect(parameter(request, "rect")).value_or(PixelRect{});
        const auto bytes = view->part(rect);
        if (!bytes)
            return refusal(bytes.error());
        return {.type = "image/jpeg", .body = *bytes};
    }
    const auto wanted = layer_named(what);
    if (!wanted)
        return not_found();
    const auto layer = view->layer(*wanted, parse_count(parameter(request, "rev")).value_or(0));
    if (!layer)
        return refusal(layer.error());
    return {.type = what.ends_with(".jpg") ? "image/jpeg" : "image/png",
            .body = layer->bytes,
            .caching = layer->is_asked_for ? "private, max-age=86400, immutable" : "no-store"};
}

http::Answer Routes::do_with(const JobId& job, std::string_view name) const {
    const auto deed = deed_named(name);
    if (!deed)
        return not_found();
    if (!control_)
        return http::refusal(403, "This page only shows: start fraja-watch with --serve "
                                  "--allow-control, or use fraja-ctl.");
    const Outcome outcome = control_(job, *deed);
    return {.status = status_of(outcome.code), .body = http::body(outcome.reason + "\n")};
}

} // namespace fraja::client
