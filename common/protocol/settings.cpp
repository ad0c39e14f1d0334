#include "common/protocol/settings.hpp"

#include "common/protocol/limits.hpp"

#include <string>

namespace fraja::protocol {
namespace {

Error invalid(std::string message) {
    return {ErrorCode::invalid_argument, std::move(message)};
}

std::string text(Extent e) {
    return std::to_string(e.width) + "x" + std::to_string(e.height);
}

} // namespace

Result<void> validate(const PictureSettings& s) {
    if (s.size.width == 0 || s.size.height == 0)
        return invalid("size " + text(s.size) + ": a picture needs at least one pixel");
    if (s.size.width > picture_side_max || s.size.height > picture_side_max)
        return invalid("size " + text(s.size) + ": a side is at most " +
                       std::to_string(picture_side_max) + " pixels");
    if (s.size.pixel_count() > picture_pixels_max)
        return invalid("size " + text(s.size) + ": a picture has at most " +
                       std::to_string(picture_pixels_max) + " pixels");
    if (s.crop.empty())
        return invalid("crop: the rectangle is empty");
    if (!s.crop.inside(s.size))
        return invalid("crop: the rectangle " + std::to_string(s.crop.x) + "," +
                       std::to_string(s.crop.y) + "," + std::to_string(s.crop.width) + "," +
                       std::to_string(s.crop.height) + " is not within " + text(s.size));
    if (s.depth > depth_max)
        return invalid("depth " + std::to_string(s.depth) + ": at most " +
                       std::to_string(depth_max));
    if (s.aa > aa_max)
        return invalid("aa " + std::to_string(s.aa) + ": at most " + std::to_string(aa_max));
    if (s.spp > samples_max)
        return invalid("spp " + std::to_string(s.spp) + ": at most " + std::to_string(samples_max));
    if (!(s.error >= 0 && s.error <= error_max))
        return invalid("error " + std::to_string(s.error) + ": from 0 to " +
                       std::to_string(static_cast<int>(error_max)) + " levels");
    if (s.max_samples < samples_min || s.max_samples > samples_max)
        return invalid("max-samples " + std::to_string(s.max_samples) + ": from " +
                       std::to_string(samples_min) + " to " + std::to_string(samples_max));
    if (int{s.aa > 0} + int{s.spp > 0} + int{s.error > 0} > 1)
        return invalid("aa: one of aa, spp and error says how many samples there are, not two");
    if (s.time_limit < Duration::zero() || s.time_limit > time_limit_max)
        return invalid("time-limit: from 0 to 1000 days");
    if (s.limited_in_time() && (s.aa > 0 || s.spp > 0 || s.error > 0))
        return invalid("time-limit: says how many samples there are; without aa, spp and error");
    if (s.limited_in_time() && s.layers)
        return invalid("layers: not with --time-limit, whose passes would all bring them");
    if (s.filter != PixelFilter::box && s.spp == 0 && s.error == 0 && !s.limited_in_time())
        return invalid("filter: weighs the samples of --spp, --error or --time-limit, none of "
                       "which is given");
    return {};
}

} // namespace fraja::protocol
