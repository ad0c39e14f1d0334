// How a program is told of its keys: a file, never a secret itself.
#pragma once

#include "common/base/result.hpp"
#include "common/net/keys.hpp"

#include <optional>
#include <string>

namespace CLI {
class App;
}

namespace fraja::service {

/// As people type them.
struct KeyOptions {
    std::string file;   ///< empty: no keys
    std::string broker; ///< public key of whom it connects to; empty: as the file says
};

/// --key-file, and --broker-key, with what that is for.
void add_key_options(CLI::App& app, KeyOptions& options, const std::string& broker_key_text);

/// From now on the process has a secret (net::keep_secrets()). Nothing: it has no keys. The broker
/// is one of the own farm, with the same key, where neither option nor file name another and
/// `is_broker`. The errors name the option.
[[nodiscard]] Result<std::optional<net::Keys>> read_keys(const KeyOptions& options,
                                                         bool is_broker = false);

/// Makes a key file (cli::write_key_file()), and returns its public key.
[[nodiscard]] Result<net::PublicKey> make_key_file(const std::string& file,
                                                   const std::string& broker);

} // namespace fraja::service
