#include "tests/transcripts/words.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <sstream>
#include <utility>

namespace fraja::broker {

Words::Words(std::string_view line) {
    std::istringstream in{std::string(line)};
    for (std::string word; in >> word;)
        words_.push_back(std::move(word));
}

std::string Words::next(std::string_view what) {
    const auto word = std::ranges::find_if(
        words_, [](const std::string& w) { return w.find('=') == std::string::npos; });
    if (word == words_.end())
        throw BadCommand("here should be " + std::string(what));
    std::string found = std::move(*word);
    words_.erase(word);
    return found;
}

bool Words::next_is(std::string_view word) {
    if (words_.empty() || words_.front() != word)
        return false;
    words_.erase(words_.begin());
    return true;
}

std::string Words::rest() {
    std::string text;
    for (const std::string& word : std::exchange(words_, {}))
        text += (text.empty() ? "" : " ") + word;
    return text;
}

bool Words::has(std::string_view name) const {
    return std::ranges::any_of(
        words_, [&](const std::string& w) { return w.starts_with(std::string(name) + "="); });
}

std::string Words::text(std::string_view name) {
    const auto word = std::ranges::find_if(
        words_, [&](const std::string& w) { return w.starts_with(std::string(name) + "="); });
    if (word == words_.end())
        throw BadCommand("here should be " + std::string(name) + "=");
    std::string value = word->substr(name.size() + 1);
    words_.erase(word);
    return value;
}

std::uint32_t Words::number(std::string_view name) {
    const std::string value = text(name);
    const auto count = parse_count(value);
    if (!count || *count > UINT32_MAX)
        throw BadCommand("'" + value + "' is no number for " + std::string(name));
    return static_cast<std::uint32_t>(*count);
}

std::uint32_t Words::number(std::string_view name, std::uint32_t otherwise) {
    return has(name) ? number(name) : otherwise;
}

void Words::end() const {
    if (!words_.empty())
        throw BadCommand("'" + words_.front() + "' means nothing here");
}

} // namespace fraja::broker
