#include "client/settings_text.hpp"

#include "client/progress.hpp"
#include "common/base/version.hpp"

#include <chrono>
#include <cstdlib>
#include <ctime>
#include <fmt/chrono.h>
#include <fmt/core.h>

namespace fraja::client {
namespace {

using Settings = protocol::PictureSettings;

std::string size_text(const Settings& s) {
    return fmt::format("{}x{}", s.size.width, s.size.height);
}

std::string crop_text(const Settings& s) {
    return fmt::format("{},{},{},{}", s.crop.x, s.crop.y, s.crop.width, s.crop.height);
}

bool is_cropped(const Settings& s) {
    return s.crop.pixel_count() != s.size.pixel_count();
}

/// Universal time, as EXIF and OpenEXR have it.
std::string time_now() {
    const auto now = std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now());
    return fmt::format("{:%Y:%m:%d %H:%M:%S}", fmt::gmtime(now));
}

void add_account(const protocol::JobState& job, std::vector<PictureAttribute>& to) {
    to.push_back({"DateTime", time_now()});
    to.push_back({"fraja:job", fraja::to_string(job.job)});
    to.push_back({"fraja:job_name", job.job_name});
    to.push_back({"fraja:elapsed_s", fmt::format("{:.3f}", seconds(job.elapsed))});
    to.push_back({"fraja:render_time_s", fmt::format("{:.3f}", seconds(job.render_time))});
    to.push_back({"fraja:rays_camera", std::to_string(job.rays.camera)});
    to.push_back({"fraja:rays_reflected", std::to_string(job.rays.reflected)});
    to.push_back({"fraja:rays_refracted", std::to_string(job.rays.refracted)});
    to.push_back({"fraja:rays_shadow", std::to_string(job.rays.shadow)});
}

} // namespace

std::string to_string(protocol::KernelChoice kernel) {
    switch (kernel) {
    case protocol::KernelChoice::reference:
        return "reference";
    case protocol::KernelChoice::fast:
        return "fast";
    }
    return "unknown";
}

std::string to_string(protocol::PixelFilter filter) {
    switch (filter) {
    case protocol::PixelFilter::box:
        return "box";
    case protocol::PixelFilter::tent:
        return "tent";
    }
    return "unknown";
}

std::string extent_text(const Settings& s) {
    return size_text(s) + (is_cropped(s) ? ", of it " + crop_text(s) : "");
}

std::string settings_text(const Settings& s) {
    std::string text = fmt::format("depth {}, ", s.depth);
    if (s.error > 0)
        text += fmt::format("error {} with at most {} samples, ", s.error, s.max_samples);
    else if (s.limited_in_time())
        text += fmt::format("time limit {:.6g} s with at most {} samples, ",
                            seconds(std::chrono::round<std::chrono::milliseconds>(s.time_limit)),
                            s.max_samples);
    else if (s.spp > 0)
        text += fmt::format("spp {}, ", s.spp);
    else
        text += fmt::format("aa {}, ", s.aa);
    if (s.filter != protocol::PixelFilter::box)
        text += fmt::format("filter {}, ", to_string(s.filter));
    return text + (s.exact ? "exact, " : "") + (s.layers ? "layers, " : "") + "kernel " +
           to_string(s.kernel);
}

std::string settings_options(const Settings& s) {
    std::string text = fmt::format("-r {} -d {}", size_text(s), s.depth);
    if (is_cropped(s))
        text += " --crop " + crop_text(s);
    if (s.aa > 0)
        text += fmt::format(" -a {}", s.aa);
    if (s.spp > 0)
        text += fmt::format(" --spp {}", s.spp);
    if (s.error > 0)
        text += fmt::format(" --error {}", s.error);
    if (s.limited_in_time())
        text += fmt::format(" --time-limit {}s", seconds(s.time_limit));
    if (s.error > 0 || s.limited_in_time())
        text += fmt::format(" --max-samples {}", s.max_samples);
    if (s.filter != protocol::PixelFilter::box)
        text += " --filter " + to_string(s.filter);
    if (s.kernel != protocol::KernelChoice::fast)
        text += " --kernel " + to_string(s.kernel);
    return text + (s.exact ? " --exact" : "") + (s.layers ? " --layers" : "");
}

std::vector<PictureAttribute> picture_attributes(const protocol::JobState& job,
                                                 const std::string& more_options) {
    const Settings& s = job.settings;
    std::vector<PictureAttribute> attributes = {
        {"Software", build_line("Fraja")},
        {"fraja:scene", fraja::to_string(job.scene)},
        {"fraja:size", size_text(s)},
        {"fraja:crop", crop_text(s)},
        {"fraja:depth", std::to_string(s.depth)},
        {"fraja:aa", std::to_string(s.aa)},
        {"fraja:spp", std::to_string(s.spp)},
        {"fraja:error", fmt::format("{}", s.error)},
        {"fraja:max_samples", std::to_string(s.max_samples)},
        {"fraja:filter", to_string(s.filter)},
        {"fraja:exact", s.exact ? "true" : "false"},
        {"fraja:layers", s.layers ? "true" : "false"},
        {"fraja:kernel", to_string(s.kernel)}};
    const bool with_account = std::getenv("SOURCE_DATE_EPOCH") == nullptr;
    if (with_account || !s.limited_in_time()) // the passes done decide, not the time there was
        attributes.push_back({"fraja:options", settings_options(s) + more_options});
    if (job.film != FilmId{})
        attributes.push_back({"fraja:frame", std::to_string(job.frame)});
    if (job.phase != protocol::JobPhase::done)
        attributes.push_back({"fraja:unfinished", fmt::format("{:.4f} of it", share_done(job))});
    if (with_account)
        add_account(job, attributes);
    return attributes;
}

} // namespace fraja::client
