// What people type (sizes, rectangles, durations; the name they probably meant), and text from
// others made fit to be shown.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/pixel_rect.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace fraja {

/// A non-negative decimal integer and nothing else; nothing when it does not fit.
[[nodiscard]] std::optional<std::uint64_t> parse_count(std::string_view text);
/// "640x480" and nothing else. Zero sides are read as they stand.
[[nodiscard]] std::optional<Extent> parse_extent(std::string_view text);
/// "X,Y,W,H" and nothing else.
[[nodiscard]] std::optional<PixelRect> parse_rect(std::string_view text);
/// "90", "90s", "1.5s", "250ms", "5m", "1h30m": seconds where no unit stands. At most 10 years.
[[nodiscard]] std::optional<Duration> parse_duration(std::string_view text);
/// "512", "512K", "512M", "4G", in powers of 1024.
[[nodiscard]] std::optional<std::uint64_t> parse_byte_size(std::string_view text);

/// "0.1", "10%": a share from 0 to 1.
[[nodiscard]] std::optional<double> parse_share(std::string_view text);

/// "0:42", "12:07", "1:02:03": for progress lines. Negative is shown as 0:00.
[[nodiscard]] std::string format_duration(Duration d);

/// "7 days", "1 hour 30 minutes", "1.5 seconds": what parse_duration() has read, to the
/// millisecond.
[[nodiscard]] std::string duration_in_words(Duration d);

/// "1 job", "2 jobs": of words that take an s.
[[nodiscard]] std::string counted(std::uint64_t count, std::string_view what);

/// The candidate nearest to `name` (Damerau-Levenshtein, ignoring case), if it is near enough to be
/// what was meant: at most a third of the name's letters differ. Of equals the first.
[[nodiscard]] std::optional<std::string_view>
nearest_name(std::string_view name, std::span<const std::string_view> candidates);

/// What was meant by `name`: the first candidate that it begins, or else the nearest_name(). Of up
/// to two letters nothing can be said.
[[nodiscard]] std::optional<std::string_view>
meant_name(std::string_view name, std::span<const std::string_view> candidates);

/// " (did you mean 'cone'?)", or nothing where there is no name.
[[nodiscard]] std::string did_you_mean(std::optional<std::string_view> name);

/// "a, b, c".
[[nodiscard]] std::string comma_list(std::span<const std::string> words);

/// UTF-8 without the bytes that could move a terminal's cursor or make one line two: names and
/// reasons come from others.
[[nodiscard]] std::string printable(std::string_view text);
/// At most the first `bytes_max` bytes of UTF-8, cut between characters.
[[nodiscard]] std::string_view clipped(std::string_view text, std::size_t bytes_max);

} // namespace fraja
