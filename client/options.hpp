// Options that every client shares.
#pragma once

#include "client/console.hpp"
#include "client/preview/preview.hpp"
#include "client/session.hpp"
#include "common/base/result.hpp"
#include "common/base/version.hpp"
#include "common/cli/parse.hpp"
#include "common/image_io/picture_file.hpp"
#include "common/service/key_options.hpp"
#include "common/service/log_options.hpp"

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace fraja::client {

enum class ProgressMode : std::uint8_t { automatic, bar, plain, json, none };

struct SharedOptions {
    std::vector<std::string> brokers; ///< whole endpoints and sources, at least one
    Duration connect_timeout = std::chrono::seconds(10);
    ProgressMode progress = ProgressMode::automatic;
    ConsoleOptions console;
    std::optional<net::Keys> keys; ///< nothing: there are none
    bool json = false;
};

using cli::EarlyExit;
template <class Options>
using Parsed = std::variant<Options, EarlyExit>;

/// The shared options as they are typed, until all of the line has been read.
class SharedArguments {
public:
    /// Adds --broker and its companions to `app`; this must outlive the parsing. --version names
    /// `isa`.
    void add_to(CLI::App& app, std::string program, std::string_view isa = isa_level());
    /// Without `asks_broker` no key is read: it may be bad, or somebody else's.
    [[nodiscard]] Result<SharedOptions> read(bool asks_broker = true) const;
    [[nodiscard]] const std::string& broker_key() const { return keys_.broker; }

private:
    std::string program_;
    std::vector<std::string> brokers_;
    std::string connect_timeout_ = "10s", progress_ = "auto";
    service::KeyOptions keys_;
    service::LogOptions log_;
    bool json_ = false;
};

/// --preview as it is typed.
class PreviewArgument {
public:
    /// Without it: `absent`, one of the modes. Where it `may_stand_alone`, that means auto; then a
    /// mode is given as --preview=MODE.
    void add_to(CLI::App& app, std::string absent, bool may_stand_alone);
    [[nodiscard]] PreviewMode read() const;
    [[nodiscard]] static bool is_mode(const std::string& word);
    /// What to say of a word that is none.
    [[nodiscard]] static std::string cure_of(const std::string& word);

private:
    std::string mode_;
};

/// --transfer and --half, which say how an output's numbers are written.
class EncodingArguments {
public:
    /// This must outlive the parsing.
    void add_to(CLI::App& app);
    /// Errors: the output is of a format that they say nothing to. In a settings file they are for
    /// the outputs that they fit.
    [[nodiscard]] Result<PictureEncoding> read(const std::string& output,
                                               const cli::Origins& origins) const;

private:
    std::string transfer_;
    bool half_ = false;
};

/// A name for the file of one picture numbers no frames. Errors: it does. Empty: there is none.
[[nodiscard]] Result<void> check_one_picture(const std::string& output);

/// For keep_freed_memory(): little, as a picture is memory enough.
inline constexpr std::size_t kept_freed_bytes = std::size_t{8} << 20;

[[nodiscard]] SessionOptions session_options(const SharedOptions& shared);

[[nodiscard]] inline Error invalid_option(std::string message) {
    return {ErrorCode::invalid_argument, std::move(message)};
}

} // namespace fraja::client
