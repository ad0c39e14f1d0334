#include "client/columns.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <clocale>
#include <cwchar>

namespace fraja::client {
namespace {

/// The system's table of widths speaks only in a locale of UTF-8, whatever the user's is.
class Utf8Locale {
public:
    Utf8Locale() : before_(::uselocale(utf8())) {}
    ~Utf8Locale() { ::uselocale(before_); }
    Utf8Locale(const Utf8Locale&) = delete;
    Utf8Locale& operator=(const Utf8Locale&) = delete;

private:
    /// Null where there is none: then the thread's own stays.
    static locale_t utf8() {
        static const locale_t locale = ::newlocale(LC_CTYPE_MASK, "C.UTF-8", nullptr);
        return locale;
    }
    locale_t before_;
};

struct Character {
    std::size_t bytes = 1, columns = 1;
};

/// The first one of a text that is not empty.
Character first_character(std::string_view text) {
    std::mbstate_t state{};
    wchar_t wide = 0;
    const std::size_t bytes = std::mbrtowc(&wide, text.data(), text.size(), &state);
    if (bytes > 0 && bytes <= text.size())
        if (const int columns = ::wcwidth(wide); columns >= 0)
            return {bytes, static_cast<std::size_t>(columns)};
    Character unknown; // with the bytes that belong to it, if it is UTF-8
    while (unknown.bytes < text.size() &&
           (static_cast<unsigned char>(text[unknown.bytes]) & 0xc0) == 0x80)
        ++unknown.bytes;
    return unknown;
}

} // namespace

std::size_t columns_of(std::string_view text) {
    const Utf8Locale locale;
    std::size_t columns = 0;
    while (!text.empty()) {
        const Character c = first_character(text);
        columns += c.columns;
        text.remove_prefix(c.bytes);
    }
    return columns;
}

std::string_view first_columns(std::string_view text, std::size_t columns_max) {
    const Utf8Locale locale;
    std::size_t bytes = 0;
    for (std::size_t columns = 0; bytes < text.size();) {
        const Character c = first_character(text.substr(bytes));
        if (columns + c.columns > columns_max)
            break;
        columns += c.columns;
        bytes += c.bytes;
    }
    return text.substr(0, bytes);
}

std::string shortened(std::string_view text, std::size_t columns_max) {
    constexpr std::string_view dots = "...";
    std::string clean = printable(text);
    if (columns_of(clean) <= columns_max)
        return clean;
    const std::size_t room = columns_max - std::min(columns_max, dots.size());
    return std::string(first_columns(clean, room)) + std::string(dots.substr(0, columns_max));
}

} // namespace fraja::client
