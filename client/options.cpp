#include "client/options.hpp"

#include "common/base/text.hpp"
#include "common/net/endpoint.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/messages.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <unistd.h>
#include <utility>

namespace fraja::client {
namespace {

constexpr std::size_t brokers_max = 64;

template <class E, std::size_t N>
struct Names {
    std::array<std::pair<const char*, E>, N> all;
    [[nodiscard]] std::vector<std::string> list() const {
        std::vector<std::string> names;
        for (const auto& [name, value] : all)
            names.emplace_back(name);
        return names;
    }
    [[nodiscard]] E of(const std::string& text) const {
        return std::ranges::find_if(all, [&](const auto& e) { return text == e.first; })->second;
    }
};

constexpr Names<ProgressMode, 5> progress_modes{{{{"auto", ProgressMode::automatic},
                                                  {"bar", ProgressMode::bar},
                                                  {"plain", ProgressMode::plain},
                                                  {"json", ProgressMode::json},
                                                  {"none", ProgressMode::none}}}};
constexpr Names<ColorChoice, 3> color_choices{{{{"auto", ColorChoice::automatic},
                                                {"always", ColorChoice::always},
                                                {"never", ColorChoice::never}}}};
constexpr Names<LogLevel, 6> log_levels{{{{"trace", LogLevel::trace},
                                          {"debug", LogLevel::debug},
                                          {"info", LogLevel::info},
                                          {"warning", LogLevel::warning},
                                          {"warn", LogLevel::warning},
                                          {"error", LogLevel::error}}}};

} // namespace

void SharedArguments::add_to(CLI::App& app, std::string program, std::string_view isa) {
    program_ = std::move(program);
    app.set_version_flag("--version", version_line(program_, isa));
    app.add_option("-b,--broker", brokers_, "Broker to ask, HOST:PORT; several are tried in turn")
        ->envname("FRAJA_BROKER")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->default_str(net::default_broker)
        ->type_name("ENDPOINT");
    app.add_option("--connect-timeout", connect_timeout_, "How long to look for a broker")
        ->envname("FRAJA_CONNECT_TIMEOUT")
        ->capture_default_str()
        ->type_name("T");
    app.add_option("--progress", progress_, "How progress is shown on stderr")
        ->envname("FRAJA_PROGRESS")
        ->capture_default_str()
        ->check(CLI::IsMember(progress_modes.list()))
        ->type_name("MODE");
    app.add_option("--color", color_, "Whether messages are coloured")
        ->envname("FRAJA_COLOR")
        ->capture_default_str()
        ->check(CLI::IsMember(color_choices.list()))
        ->type_name("WHEN");
    app.add_option("--log-level", log_level_, "How much is said on stderr")
        ->envname("FRAJA_LOG_LEVEL")
        ->capture_default_str()
        ->check(CLI::IsMember(log_levels.list()))
        ->type_name("LEVEL");
    app.add_flag("--json", json_, "Print the result as JSON");
}

Result<SharedOptions> SharedArguments::read() const {
    SharedOptions options;
    std::vector<std::string> brokers = brokers_;
    std::erase(brokers, std::string());
    if (brokers.empty())
        brokers = {net::default_broker};
    if (brokers.size() > brokers_max)
        return invalid_option("--broker: at most " + std::to_string(brokers_max));
    for (const std::string& text : brokers) {
        if (text == "auto")
            return invalid_option("--broker auto: this release does not discover brokers yet; name "
                                  "one, as -b HOST:50057");
        auto endpoint = net::endpoint_to_connect(text, net::broker_port);
        if (!endpoint)
            return invalid_option("--broker: " + endpoint.error().message);
        options.brokers.push_back(std::move(*endpoint));
    }
    const auto timeout = parse_duration(connect_timeout_);
    if (!timeout)
        return invalid_option("--connect-timeout " + connect_timeout_ +
                              ": a duration is written as 90, 90s, 5m or 1h30m");
    options.connect_timeout = *timeout;
    options.progress = progress_modes.of(progress_);
    options.console = {program_, log_levels.of(log_level_), color_choices.of(color_)};
    options.json = json_;
    return options;
}

SessionOptions session_options(const SharedOptions& shared) {
    char host[256] = {};
    gethostname(host, sizeof host - 1);
    return {shared.brokers, shared.connect_timeout,
            shared.console.program + "@" + host + ":" + std::to_string(getpid())};
}

} // namespace fraja::client
