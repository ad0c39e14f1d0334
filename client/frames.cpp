#include "client/frames.hpp"

#include "common/base/assert.hpp"
#include "common/base/text.hpp"

#include <algorithm>

namespace fraja::client {
namespace {

constexpr std::size_t runs_told_max = 8;
constexpr std::size_t width_digits_max = 1; // %09d is the widest

std::optional<std::uint32_t> number_of(std::string_view text) {
    const auto count = parse_count(text);
    if (!count || *count < 1 || *count > UINT32_MAX)
        return std::nullopt;
    return static_cast<std::uint32_t>(*count);
}

/// Where the number goes, and with how many digits at least.
struct Place {
    std::size_t begin = 0, end = 0, digits = 0;
};

std::optional<Place> place_in(std::string_view pattern) {
    Place place{.begin = pattern.find('%')};
    if (place.begin == std::string_view::npos)
        return std::nullopt;
    std::size_t at = place.begin + 1;
    if (at < pattern.size() && pattern[at] == '0') {
        const std::size_t width = ++at;
        while (at < pattern.size() && pattern[at] >= '0' && pattern[at] <= '9')
            place.digits = 10 * place.digits + static_cast<std::size_t>(pattern[at++] - '0');
        if (at == width || at - width > width_digits_max || place.digits == 0)
            return std::nullopt;
    }
    if (at >= pattern.size() || pattern[at] != 'd')
        return std::nullopt;
    place.end = at + 1;
    return place;
}

} // namespace

std::optional<FrameRange> parse_frames(std::string_view text) {
    std::optional<std::uint32_t> step = 1;
    if (const std::size_t x = text.find('x'); x != std::string_view::npos) {
        if (text.find('-') > x)
            return std::nullopt;
        step = number_of(text.substr(x + 1));
        text = text.substr(0, x);
    }
    const std::size_t dash = text.find('-');
    const auto first = number_of(text.substr(0, dash));
    const auto last = dash == std::string_view::npos ? first : number_of(text.substr(dash + 1));
    if (!first || !last || !step || *first > *last)
        return std::nullopt;
    return FrameRange{*first, *last, *step};
}

Result<void> check_frame_pattern(std::string_view pattern) {
    const auto place = place_in(pattern);
    if (place && pattern.find('%', place->end) == std::string_view::npos)
        return {};
    return Error{ErrorCode::invalid_argument,
                 "a film's files are numbered: the name must have one % for that, written %d or "
                 "%04d, as in cone%04d.png"};
}

std::string frame_file(std::string_view pattern, std::uint32_t frame) {
    const auto place = place_in(pattern);
    FRAJA_ASSERT(place.has_value());
    std::string number = std::to_string(frame);
    if (number.size() < place->digits)
        number.insert(0, place->digits - number.size(), '0');
    return std::string(pattern.substr(0, place->begin)) + number +
           std::string(pattern.substr(place->end));
}

std::string runs_of(std::span<const std::string> files) {
    std::string text;
    std::size_t runs = 0, untold = 0;
    for (std::size_t begin = 0, end = 0; begin < files.size(); begin = end + 1) {
        for (end = begin; end < files.size() && !files[end].empty();)
            ++end;
        if (end == begin)
            continue;
        if (++runs > runs_told_max) {
            untold += end - begin;
            continue;
        }
        text += (text.empty() ? "" : ", ") + files[begin];
        if (end - begin > 1)
            text += (end - begin > 2 ? " ... " : ", ") + files[end - 1];
    }
    return text + (untold > 0 ? " and " + std::to_string(untold) + " more" : "");
}

std::uint32_t frames_at_a_time(const protocol::PictureSettings& settings) {
    const std::uint64_t bytes =
        std::max<std::uint64_t>(1, settings.crop.pixel_count() * settings.pixel_bytes());
    return static_cast<std::uint32_t>(
        std::clamp<std::uint64_t>(frames_bytes_max / bytes, 1, frames_at_a_time_max));
}

} // namespace fraja::client
