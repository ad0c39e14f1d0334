#include "client/options.hpp"

#include "common/base/text.hpp"
#include "common/discovery/source.hpp"
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
constexpr Names<Transfer, 3> transfers{
    {{{"raja", Transfer::raja}, {"srgb", Transfer::srgb}, {"linear", Transfer::linear}}}};
constexpr Names<PreviewMode, 5> preview_modes{{{{"auto", PreviewMode::automatic},
                                                {"kitty", PreviewMode::kitty},
                                                {"sixel", PreviewMode::sixel},
                                                {"blocks", PreviewMode::blocks},
                                                {"none", PreviewMode::none}}}};

} // namespace

void SharedArguments::add_to(CLI::App& app, std::string program, std::string_view isa) {
    program_ = std::move(program);
    app.set_version_flag("--version", version_line(program_, isa));
    app.add_option("-b,--broker", brokers_,
                   "Broker to ask, HOST:PORT; several are tried in turn; auto: one that announces "
                   "itself on this network; srv:DOMAIN: those that the DNS names")
        ->envname("FRAJA_BROKER")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->default_str(net::default_broker)
        ->type_name("ENDPOINT");
    service::add_key_options(app, keys_, "Public key of the broker");
    app.add_option("--connect-timeout", connect_timeout_, "How long to look for a broker")
        ->envname("FRAJA_CONNECT_TIMEOUT")
        ->capture_default_str()
        ->type_name("T");
    app.add_option(
           "--progress", progress_,
           "How progress is shown on stderr; json: all that is said there is an object on a line")
        ->envname("FRAJA_PROGRESS")
        ->capture_default_str()
        ->check(CLI::IsMember(progress_modes.list()))
        ->type_name("MODE");
    service::add_log_options(app, log_);
    app.add_flag(
        "--json", json_,
        "Print the result as JSON; what goes wrong is told by the exit code and on stderr");
}

Result<SharedOptions> SharedArguments::read(bool asks_broker) const {
    SharedOptions options;
    if (asks_broker) {
        auto keys = service::read_keys(keys_);
        if (!keys)
            return keys.error();
        options.keys = *std::move(keys);
    }
    std::vector<std::string> brokers = brokers_;
    std::erase(brokers, std::string());
    if (brokers.empty())
        brokers = {net::default_broker};
    if (brokers.size() > brokers_max)
        return invalid_option("--broker: at most " + std::to_string(brokers_max));
    auto words = discovery::broker_words(brokers);
    if (!words)
        return invalid_option("--broker: " + words.error().message);
    options.brokers = *std::move(words);
    const auto timeout = parse_duration(connect_timeout_);
    if (!timeout)
        return invalid_option("--connect-timeout " + connect_timeout_ +
                              ": a duration is written as 90, 90s, 5m or 1h30m");
    options.connect_timeout = *timeout;
    options.progress = progress_modes.of(progress_);
    // Whoever reads the progress by program reads every line there.
    options.console = {program_, log_.least(),
                       log_.as_json() || options.progress == ProgressMode::json,
                       log_.color_choice()};
    options.json = json_;
    return options;
}

void PreviewArgument::add_to(CLI::App& app, std::string absent, bool may_stand_alone) {
    mode_ = std::move(absent);
    const std::string what =
        "The picture so far, on a terminal: auto, kitty, sixel (with libchafa), blocks or none";
    CLI::Validator check = CLI::IsMember(preview_modes.list());
    CLI::Option* const option = may_stand_alone
                                    ? app.add_flag("--preview{auto}", mode_, what)
                                    : app.add_option("--preview", mode_, what)->type_name("MODE");
    option->check(check)->default_str(mode_);
}

bool PreviewArgument::is_mode(const std::string& word) {
    return std::ranges::count(preview_modes.list(), word) > 0;
}

std::string PreviewArgument::cure_of(const std::string& word) {
    const std::vector<std::string> modes = preview_modes.list();
    const std::vector<std::string_view> views(modes.begin(), modes.end());
    return comma_list(modes) + did_you_mean(meant_name(word, views));
}

PreviewMode PreviewArgument::read() const {
    return preview_modes.of(mode_);
}

void EncodingArguments::add_to(CLI::App& app) {
    app.add_option("--transfer", transfer_,
                   "From light to the levels of 8-bit pictures: raja (as Raja: no gamma), srgb "
                   "(the curve of displays), linear (no gamma, the nearest level)")
        ->check(CLI::IsMember(transfers.list()))
        ->default_str("raja")
        ->type_name("CURVE");
    app.add_flag("--half", half_, "Colours of an .exr as 16-bit floats, and so half as large");
}

Result<PictureEncoding> EncodingArguments::read(const std::string& output,
                                                const cli::Origins& origins) const {
    PictureEncoding encoding{transfer_.empty() ? Transfer::raja : transfers.of(transfer_), half_};
    if (output.empty())
        return encoding;
    const auto kind = pixel_kind(output);
    if (!kind)
        return invalid_option(kind.error().message);
    if (*kind != PixelKind::levels8 && !transfer_.empty() && !origins.is_setting("--transfer"))
        return invalid_option("--transfer " + transfer_ + ": " + output +
                              " holds light itself, not levels; leave it out, or choose .png");
    if (*kind != PixelKind::radiance_and_more && half_ && !origins.is_setting("--half"))
        return invalid_option("--half is for .exr: " + output + " has no 16-bit floats");
    return encoding;
}

Result<void> check_one_picture(const std::string& output) {
    if (output.find('%') == std::string::npos)
        return {};
    return invalid_option("--output " + output +
                          ": % is for the numbers of a film's frames "
                          "(fraja-submit --travel); a job is one picture");
}

SessionOptions session_options(const SharedOptions& shared) {
    char host[256] = {};
    gethostname(host, sizeof host - 1);
    return {shared.brokers, shared.connect_timeout,
            shared.console.program + "@" + host + ":" + std::to_string(getpid()),
            shared.keys.has_value()};
}

} // namespace fraja::client
