#include "common/scene/raj_diagnostics.hpp"

#include <algorithm>

namespace fraja::raj {
namespace {

constexpr std::size_t quoted_bytes_max = 60;

bool starts_character(char c) {
    return (static_cast<unsigned char>(c) & 0xc0) != 0x80; // not a continuation byte of UTF-8
}

/// The bytes of the UTF-8 character that `text` (not empty) starts with; 0 if it starts with none.
std::size_t character_bytes(std::string_view text) {
    const auto first = static_cast<unsigned char>(text[0]);
    const std::size_t bytes = first < 0x80                    ? 1
                              : first >= 0xc2 && first < 0xe0 ? 2
                              : first >= 0xe0 && first < 0xf0 ? 3
                              : first >= 0xf0 && first < 0xf5 ? 4
                                                              : 0;
    if (bytes == 0 || bytes > text.size())
        return 0;
    const auto rest = text.substr(1, bytes - 1);
    return std::ranges::none_of(rest, starts_character) ? bytes : 0;
}

std::string hexadecimal(char c) {
    constexpr std::string_view digits = "0123456789ABCDEF";
    const auto byte = static_cast<unsigned char>(c);
    return {'\\', 'x', digits[byte >> 4], digits[byte & 15]};
}

} // namespace

bool Diagnostics::refuse(Place place, std::string_view message, ErrorCode code) {
    if (!error_)
        error_ = Error{code, located(place, message)};
    return false;
}

bool Diagnostics::refuse_limit(Place place, std::string_view name, std::uint64_t limit,
                               std::string_view counts) {
    return refuse(place,
                  "more than " + std::to_string(limit) + " " + std::string(counts) + " (limit '" +
                      std::string(name) + "')",
                  ErrorCode::limit_exceeded);
}

void Diagnostics::warn(Place place, std::string_view message) {
    if (warnings_.size() < warnings_max)
        warnings_.push_back(located(place, message));
    else
        ++warnings_unsaid_;
}

std::vector<std::string> Diagnostics::take_warnings() {
    if (warnings_unsaid_ > 0)
        warnings_.push_back(std::string(file_name_) + ": and " + std::to_string(warnings_unsaid_) +
                            " more warnings");
    return std::move(warnings_);
}

std::string Diagnostics::located(Place place, std::string_view message) const {
    const std::string_view before = text_.substr(0, place.offset);
    const std::size_t line_end = before.find_last_of("\r\n");
    const std::string_view line =
        before.substr(line_end == std::string_view::npos ? 0 : line_end + 1);
    const auto column = std::ranges::count_if(line, starts_character) + 1;
    return std::string(file_name_) + ":" + std::to_string(place.line) + ":" +
           std::to_string(column) + ": " + std::string(message);
}

std::string quoted(std::string_view text) {
    std::string shown = "'";
    while (!text.empty() && shown.size() < quoted_bytes_max) {
        const std::size_t bytes = character_bytes(text);
        const bool control = static_cast<unsigned char>(text[0]) < 0x20 || text[0] == 0x7f;
        shown += bytes == 0 || control ? hexadecimal(text[0]) : std::string(text.substr(0, bytes));
        text.remove_prefix(std::max<std::size_t>(bytes, 1));
    }
    return shown + (text.empty() ? "'" : "...'");
}

} // namespace fraja::raj
