#include "common/base/text.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <vector>

namespace fraja {
namespace {

constexpr double duration_seconds_max = 10.0 * 365 * 24 * 3600;

bool is_digit(char c) {
    return c >= '0' && c <= '9';
}

template <std::size_t N>
std::optional<std::array<std::uint32_t, N>> parse_list(std::string_view text, char separator) {
    std::array<std::uint32_t, N> values{};
    for (std::size_t i = 0; i < N; ++i) {
        const std::size_t end = i + 1 < N ? text.find(separator) : text.size();
        if (end == std::string_view::npos)
            return std::nullopt;
        const auto value = parse_count(text.substr(0, end));
        if (!value || *value > UINT32_MAX)
            return std::nullopt;
        values[i] = static_cast<std::uint32_t>(*value);
        text.remove_prefix(std::min(text.size(), end + 1));
    }
    return values;
}

/// The edit distance with neighbouring letters swapped counted as one (optimal string alignment).
std::size_t edit_distance(std::string_view a, std::string_view b) {
    std::vector<std::size_t> before(b.size() + 1), last(b.size() + 1), now(b.size() + 1);
    for (std::size_t j = 0; j <= b.size(); ++j)
        last[j] = j;
    const auto same = [](char x, char y) {
        return std::tolower(static_cast<unsigned char>(x)) ==
               std::tolower(static_cast<unsigned char>(y));
    };
    for (std::size_t i = 1; i <= a.size(); ++i) {
        now[0] = i;
        for (std::size_t j = 1; j <= b.size(); ++j) {
            now[j] = std::min(
                {last[j] + 1, now[j - 1] + 1, last[j - 1] + (same(a[i - 1], b[j - 1]) ? 0u : 1u)});
            if (i > 1 && j > 1 && same(a[i - 1], b[j - 2]) && same(a[i - 2], b[j - 1]))
                now[j] = std::min(now[j], before[j - 2] + 1);
        }
        before.swap(last);
        last.swap(now);
    }
    return last[b.size()];
}

} // namespace

std::optional<std::uint64_t> parse_count(std::string_view text) {
    std::uint64_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (text.empty() || error != std::errc{} || end != text.data() + text.size())
        return std::nullopt;
    return value;
}

std::optional<Extent> parse_extent(std::string_view text) {
    const auto sides = parse_list<2>(text, 'x');
    return sides ? std::optional(Extent{(*sides)[0], (*sides)[1]}) : std::nullopt;
}

std::optional<PixelRect> parse_rect(std::string_view text) {
    const auto v = parse_list<4>(text, ',');
    return v ? std::optional(PixelRect{(*v)[0], (*v)[1], (*v)[2], (*v)[3]}) : std::nullopt;
}

std::optional<Duration> parse_duration(std::string_view text) {
    struct Unit {
        std::string_view name;
        double in_seconds;
    };
    constexpr Unit units[] = {{"ms", 0.001}, {"s", 1}, {"m", 60}, {"h", 3600}, {"d", 86400}};
    if (text.empty())
        return std::nullopt;
    double total = 0;
    while (!text.empty()) {
        if (!is_digit(text[0]))
            return std::nullopt;
        double value = 0;
        const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value,
                                                  std::chars_format::fixed);
        if (error != std::errc{})
            return std::nullopt;
        text.remove_prefix(static_cast<std::size_t>(end - text.data()));
        const auto letters = std::ranges::find_if(text, is_digit) - text.begin();
        const std::string_view name = text.substr(0, static_cast<std::size_t>(letters));
        const auto unit = std::ranges::find(units, name.empty() ? "s" : name, &Unit::name);
        if (unit == std::end(units))
            return std::nullopt;
        total += value * unit->in_seconds;
        text.remove_prefix(name.size());
    }
    if (!(total <= duration_seconds_max))
        return std::nullopt;
    return Duration(std::llround(total * 1e9));
}

std::optional<double> parse_share(std::string_view text) {
    const bool is_percentage = text.ends_with('%');
    if (is_percentage)
        text.remove_suffix(1);
    double value = 0;
    const auto [end, error] =
        std::from_chars(text.data(), text.data() + text.size(), value, std::chars_format::fixed);
    if (error != std::errc{} || end != text.data() + text.size())
        return std::nullopt;
    const double share = is_percentage ? value / 100 : value;
    return share >= 0 && share <= 1 ? std::optional(share) : std::nullopt;
}

std::optional<std::uint64_t> parse_byte_size(std::string_view text) {
    std::uint64_t scale = 1;
    if (!text.empty() && !is_digit(text.back())) {
        constexpr std::string_view letters = "KMGT";
        const auto power = letters.find(text.back());
        if (power == std::string_view::npos)
            return std::nullopt;
        scale = std::uint64_t{1} << (10 * (power + 1));
        text.remove_suffix(1);
    }
    const auto count = parse_count(text);
    if (!count || *count > UINT64_MAX / scale)
        return std::nullopt;
    return *count * scale;
}

std::string format_duration(Duration d) {
    using namespace std::chrono_literals;
    // Rounding looks at the second above, for which the largest has no room.
    const Duration bounded = std::clamp<Duration>(d, Duration::zero(), Duration::max() - 1s);
    const std::int64_t total = std::chrono::round<std::chrono::seconds>(bounded).count();
    const auto two = [](std::int64_t n) {
        return std::string(n < 10 ? "0" : "") + std::to_string(n);
    };
    const std::int64_t h = total / 3600, m = total / 60 % 60, s = total % 60;
    if (h > 0)
        return std::to_string(h) + ":" + two(m) + ":" + two(s);
    return std::to_string(m) + ":" + two(s);
}

std::string duration_in_words(Duration d) {
    using namespace std::chrono_literals;
    std::string words;
    const auto add = [&](const std::string& more) { words += (words.empty() ? "" : " ") + more; };
    Duration rest = std::max(d, Duration::zero());
    struct Unit {
        Duration length;
        const char* name;
    };
    for (const auto& [unit, name] : {Unit{24h, "day"}, Unit{1h, "hour"}, Unit{1min, "minute"}})
        if (const auto count = rest / unit; count > 0) {
            add(counted(static_cast<std::uint64_t>(count), name));
            rest %= unit;
        }
    const auto whole_s = static_cast<std::uint64_t>(rest / 1s);
    std::string millis = std::to_string(rest % 1s / 1ms + 1000).substr(1);
    millis.erase(millis.find_last_not_of('0') + 1);
    if (!millis.empty())
        add(std::to_string(whole_s) + "." + millis + " seconds");
    else if (whole_s > 0 || words.empty())
        add(counted(whole_s, "second"));
    return words;
}

std::string counted(std::uint64_t count, std::string_view what) {
    return std::to_string(count) + " " + std::string(what) + (count == 1 ? "" : "s");
}

std::string did_you_mean(std::optional<std::string_view> name) {
    return name ? " (did you mean '" + std::string(*name) + "'?)" : "";
}

std::string comma_list(std::span<const std::string> words) {
    std::string all;
    for (const std::string& word : words)
        all += (all.empty() ? "" : ", ") + word;
    return all;
}

std::optional<std::string_view> nearest_name(std::string_view name,
                                             std::span<const std::string_view> candidates) {
    constexpr std::size_t name_letters_max = 200; // longer ones are no typing slip
    if (name.size() > name_letters_max)
        return std::nullopt;
    std::optional<std::string_view> best;
    std::size_t best_distance = std::max<std::size_t>(1, name.size() / 3) + 1;
    for (const std::string_view candidate : candidates) {
        const std::size_t distance = edit_distance(name, candidate);
        if (distance < best_distance) {
            best = candidate;
            best_distance = distance;
        }
    }
    return best;
}

std::optional<std::string_view> meant_name(std::string_view name,
                                           std::span<const std::string_view> candidates) {
    constexpr std::size_t telling_letters = 3;
    if (name.size() < telling_letters)
        return std::nullopt;
    const auto begun = std::ranges::find_if(
        candidates, [&](std::string_view candidate) { return candidate.starts_with(name); });
    return begun != candidates.end() ? std::optional(*begun) : nearest_name(name, candidates);
}

std::string printable(std::string_view text) {
    std::string result;
    result.reserve(text.size());
    for (std::size_t i = 0; i < text.size(); ++i) {
        const auto byte = static_cast<unsigned char>(text[i]);
        const bool control = byte < 0x20 || byte == 0x7f;
        // U+0080..U+009F: some terminals take them for escapes as well.
        const bool c1 =
            byte == 0xc2 && i + 1 < text.size() && static_cast<unsigned char>(text[i + 1]) < 0xa0;
        if (control)
            result += byte == '\n' || byte == '\t' ? ' ' : '?';
        else if (c1)
            result += '?', ++i;
        else
            result += text[i];
    }
    return result;
}

std::string_view clipped(std::string_view text, std::size_t bytes_max) {
    const auto is_continuation = [&](std::size_t at) {
        return (static_cast<unsigned char>(text[at]) & 0xc0) == 0x80;
    };
    std::size_t size = std::min(text.size(), bytes_max);
    while (size > 0 && size < text.size() && is_continuation(size))
        --size;
    return text.substr(0, size);
}

} // namespace fraja
