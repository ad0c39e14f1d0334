#include "tests/transcripts/transcript.hpp"

#include "tests/transcripts/players.hpp"

#include <algorithm>
#include <cctype>
#include <vector>

namespace fraja::broker {
namespace {

constexpr std::string_view indent = "    ";

std::vector<std::string_view> lines_of(std::string_view text) {
    std::vector<std::string_view> lines;
    while (!text.empty()) {
        const std::size_t end = std::min(text.find('\n'), text.size());
        lines.push_back(text.substr(0, end));
        text.remove_prefix(std::min(end + 1, text.size()));
    }
    return lines;
}

/// Of a log's line how serious it is, and not its wording.
std::string_view what_counts(std::string_view line) {
    std::size_t at = std::min(line.find_first_not_of(' '), line.size());
    if (line.substr(at).starts_with('+')) // the time comes first
        at = std::min(line.find(' ', at), line.size() - 1) + 1;
    const std::string_view log = "log ";
    return at > 0 && line.substr(at).starts_with(log)
               ? line.substr(0, line.find(' ', at + log.size()))
               : line;
}

} // namespace

Replay replay(std::string_view text, std::string_view file) {
    Replay anew;
    const auto fail = [&](std::size_t number, const std::string& what) {
        anew.error = Error{ErrorCode::invalid_argument,
                           std::string(file) + ":" + std::to_string(number) + ": " + what};
    };
    if (!text.starts_with("# "))
        fail(1, "a transcript opens with a comment on what it shows");
    Players players;
    bool has_commands = false;
    std::size_t at = 0; // the line, from 1
    for (const std::string_view line : lines_of(text)) {
        ++at;
        const bool was_done = line.starts_with(indent);
        if (was_done && !anew.error)
            continue;
        anew.text.append(line) += '\n';
        if (anew.error || line.empty() || line.starts_with('#'))
            continue;
        has_commands = true;
        if (std::isspace(static_cast<unsigned char>(line.front()))) {
            fail(at, "a command begins its line, and an action has four spaces before it");
            continue;
        }
        try {
            for (const std::string& action : players.perform(line))
                anew.text.append(indent).append(action) += '\n';
        } catch (const BadCommand& bad) {
            fail(at, bad.what());
        }
    }
    if (!has_commands && !anew.error)
        fail(at, "a transcript without a command");
    return anew;
}

std::optional<Difference> first_difference(std::string_view before, std::string_view now) {
    const auto old_lines = lines_of(before), new_lines = lines_of(now);
    const auto line = [](const auto& lines, std::size_t i) {
        return i < lines.size() ? lines[i] : std::string_view("(the end)");
    };
    for (std::size_t i = 0; i < std::max(old_lines.size(), new_lines.size()); ++i)
        if (what_counts(line(old_lines, i)) != what_counts(line(new_lines, i)))
            return Difference{i + 1, std::string(line(old_lines, i)),
                              std::string(line(new_lines, i))};
    return std::nullopt;
}

} // namespace fraja::broker
