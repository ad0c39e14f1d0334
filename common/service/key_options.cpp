#include "common/service/key_options.hpp"

#include "common/cli/key_file.hpp"

#include <CLI/CLI.hpp>
#include <utility>

namespace fraja::service {

void add_key_options(CLI::App& app, KeyOptions& options, const std::string& broker_key_text) {
    app.add_option("--key-file", options.file,
                   "Key pair, as fraja-ctl keygen makes it: what is said is then encrypted")
        ->envname("FRAJA_KEY_FILE")
        ->type_name("FILE");
    app.add_option("--broker-key", options.broker, broker_key_text)
        ->envname("FRAJA_BROKER_KEY")
        ->type_name("KEY");
}

Result<std::optional<net::Keys>> read_keys(const KeyOptions& options, bool is_broker) {
    if (options.file.empty()) {
        if (!options.broker
                 .empty()) // else everything would go unencrypted, though it is meant not to
            return Error{ErrorCode::invalid_argument,
                         "--broker-key is of no use without a key of one's own: --key-file FILE"};
        return std::optional<net::Keys>();
    }
    net::keep_secrets();
    const auto file = cli::read_key_file(options.file);
    if (!file)
        return Error{file.error().code, "--key-file " + file.error().message};
    auto own = net::key_pair(file->public_key, file->secret);
    if (!own)
        return Error{own.error().code, "--key-file " + options.file + ": " + own.error().message};
    const bool is_typed = !options.broker.empty();
    const std::string& named = is_typed ? options.broker : file->broker;
    if (named.empty() && is_broker) {
        net::PublicKey same = own->public_key;
        return std::optional(net::Keys{*std::move(own), std::move(same)});
    }
    if (named.empty())
        return Error{ErrorCode::invalid_argument,
                     "--key-file " + options.file +
                         ": whose key is the broker's? --broker-key KEY says it, or a line broker "
                         "= 'KEY' in that file; fraja-ctl keygen printed it when the farm's was "
                         "made"};
    auto broker = net::parse_public_key(named);
    if (!broker)
        return Error{broker.error().code,
                     (is_typed ? "--broker-key: " : "--key-file " + options.file + ": broker: ") +
                         broker.error().message};
    return std::optional(net::Keys{*std::move(own), *std::move(broker)});
}

Result<net::PublicKey> make_key_file(const std::string& file, const std::string& broker) {
    if (!broker.empty())
        if (const auto known = net::parse_public_key(broker); !known)
            return known.error();
    net::keep_secrets();
    const net::KeyPair pair = net::make_key_pair();
    const auto written =
        cli::write_key_file(file, pair.public_key.text, pair.secret.text(), broker);
    if (!written)
        return written.error();
    return pair.public_key;
}

} // namespace fraja::service
