#include "common/cli/settings_file.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <optional>
#include <sstream>
#include <toml++/toml.h>
#include <utility>

namespace fraja::cli {
namespace {

/// What may stand before the tables.
constexpr std::array<std::string_view, 9> shared_options = {
    "broker",    "key-file",   "broker-key", "connect-timeout", "progress", "color",
    "log-level", "log-format", "json"};

/// Also where its name is given without what all of them have in common.
std::optional<std::string_view> program_meant(std::string_view name) {
    if (const auto whole = nearest_name(name, programs))
        return whole;
    constexpr std::string_view common = "fraja-";
    std::vector<std::string_view> ends;
    for (const std::string_view program : programs)
        ends.push_back(program.substr(common.size()));
    const auto end = nearest_name(name, ends);
    return end ? std::optional(programs[static_cast<std::size_t>(std::ranges::find(ends, *end) -
                                                                 ends.begin())])
               : std::nullopt;
}

/// The cure, where a line that is no TOML has a word for its value.
std::string quotes_missing(std::string_view text, std::size_t line_number) {
    for (std::size_t line = 1; line < line_number && !text.empty(); ++line)
        text.remove_prefix(std::min(text.find('\n'), text.size() - 1) + 1);
    text = text.substr(0, text.find('\n'));
    const std::size_t equals = text.find('=');
    if (equals == std::string_view::npos)
        return {};
    constexpr std::string_view blanks = " \t\r";
    std::string_view value = text.substr(equals + 1, text.find('#', equals) - equals - 1);
    value.remove_prefix(std::min(value.find_first_not_of(blanks), value.size()));
    value = value.substr(0, value.find_last_not_of(blanks) + 1);
    if (value.empty() || value.find_first_of("'\"[]{}=") != std::string_view::npos)
        return {};
    return " (words are written in quotes: '" + printable(clipped(value, 200)) + "')";
}

Error unreadable(const std::filesystem::path& file, const std::string& reason) {
    return {ErrorCode::io, file.string() + ": " + reason};
}

/// Nothing: there is no such file.
Result<std::optional<std::string>> contents_of(const std::filesystem::path& file) {
    std::error_code ec;
    const auto status = std::filesystem::status(file, ec);
    if (status.type() == std::filesystem::file_type::not_found)
        return std::optional<std::string>();
    if (ec)
        return unreadable(file, ec.message());
    std::ifstream in(file, std::ios::binary);
    if (std::filesystem::is_directory(status) || !in)
        return unreadable(file, std::filesystem::is_directory(status) ? "it is a directory"
                                                                      : std::strerror(errno));
    std::string text(settings_file_bytes_max + 1, '\0');
    in.read(text.data(), static_cast<std::streamsize>(text.size()));
    text.resize(static_cast<std::size_t>(in.gcount()));
    if (text.size() > settings_file_bytes_max)
        return Error{ErrorCode::limit_exceeded, file.string() + ": a settings file has at most " +
                                                    std::to_string(settings_file_bytes_max) +
                                                    " bytes"};
    return std::optional(std::move(text));
}

/// Reads one file for one program.
class Reader {
public:
    Reader(const std::filesystem::path& file, std::string_view program,
           const std::vector<std::string>& options)
        : file_(file), program_(program), options_(options.begin(), options.end()) {}

    Result<std::vector<Setting>> read(const toml::table& all) {
        for (const auto& [key, node] : all) {
            const auto read =
                node.is_table() ? take_table(key, *node.as_table()) : take_shared(key, node);
            if (!read)
                return read.error();
        }
        for (Setting& setting : shared_)
            if (std::ranges::find(own_, setting.option, &Setting::option) == own_.end())
                own_.push_back(std::move(setting));
        return std::move(own_);
    }

private:
    [[nodiscard]] std::string place(const toml::source_region& source) const {
        return file_.string() + ":" + std::to_string(source.begin.line) + ":" +
               std::to_string(source.begin.column);
    }

    [[nodiscard]] Error mistake(const toml::source_region& source, const std::string& text) const {
        return {ErrorCode::invalid_argument, place(source) + ": " + text};
    }

    /// With the name that may have been meant.
    [[nodiscard]] Error unknown(const toml::key& key, const std::string& what,
                                std::span<const std::string_view> known) const {
        return mistake(key.source(), what + " '" + printable(key.str()) + "'" +
                                         did_you_mean(nearest_name(key.str(), known)));
    }

    Result<void> take_table(const toml::key& key, const toml::table& table) {
        if (std::ranges::find(programs, key.str()) == programs.end())
            return mistake(key.source(), "there is no program '" + printable(key.str()) + "'" +
                                             did_you_mean(program_meant(key.str())));
        if (key.str() != program_)
            return {};
        for (const auto& [option, node] : table) {
            if (std::ranges::find(options_, option.str()) == options_.end())
                return unknown(option, std::string(program_) + " has no option", options_);
            if (const auto read = take(option, node, own_); !read)
                return read.error();
        }
        return {};
    }

    Result<void> take_shared(const toml::key& key, const toml::node& node) {
        if (std::ranges::find(shared_options, key.str()) == shared_options.end()) {
            if (std::ranges::find(options_, key.str()) != options_.end())
                return mistake(key.source(), "'" + std::string(key.str()) +
                                                 "' is not for every program: it belongs below [" +
                                                 std::string(program_) + "]");
            return unknown(key, "programs share no option", shared_options);
        }
        if (std::ranges::find(options_, key.str()) == options_.end())
            return {};
        return take(key, node, shared_);
    }

    Result<void> take(const toml::key& key, const toml::node& node, std::vector<Setting>& to) {
        Setting setting{std::string(key.str()), {}, place(key.source())};
        if (const toml::array* list = node.as_array()) {
            for (const toml::node& element : *list)
                if (const auto read = take_value(element, setting); !read)
                    return read.error();
        } else if (const auto read = take_value(node, setting); !read) {
            return read.error();
        }
        to.push_back(std::move(setting));
        return {};
    }

    Result<void> take_value(const toml::node& node, Setting& setting) const {
        if (const auto* text = node.as_string()) {
            setting.values.push_back(text->get());
        } else if (node.is_integer() || node.is_floating_point()) {
            std::ostringstream number;
            if (const auto* whole = node.as_integer())
                number << whole->get();
            else
                number << node.as_floating_point()->get();
            setting.values.push_back(number.str());
        } else if (const auto* truth = node.as_boolean()) {
            setting.values.emplace_back(truth->get() ? "true" : "false");
        } else {
            return mistake(node.source(),
                           setting.option + ": text, a number, true, false, or a list of such");
        }
        return {};
    }

    const std::filesystem::path& file_;
    std::string_view program_;
    std::vector<std::string_view> options_;
    std::vector<Setting> own_, shared_;
};

} // namespace

Result<std::vector<Setting>> read_settings(const std::filesystem::path& file,
                                           std::string_view program,
                                           const std::vector<std::string>& options) {
    const auto text = contents_of(file);
    if (!text)
        return text.error();
    if (!*text)
        return std::vector<Setting>();
    try {
        return Reader(file, program, options).read(toml::parse(**text, file.string()));
    } catch (const toml::parse_error& e) {
        const auto& begin = e.source().begin;
        return Error{ErrorCode::invalid_argument, file.string() + ":" + std::to_string(begin.line) +
                                                      ":" + std::to_string(begin.column) + ": " +
                                                      std::string(e.description()) +
                                                      quotes_missing(**text, begin.line)};
    }
}

} // namespace fraja::cli
