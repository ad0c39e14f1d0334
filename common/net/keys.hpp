// Keys: pairs of CURVE (RFC 26), by which friends are told from strangers and nobody listens in.
//
// A secret is in memory of libsodium's, which is locked, kept out of core dumps and wiped. libzmq
// has copies of its own, so a process that has a secret is not to be dumped at all (keep_secrets).
#pragma once

#include "common/base/result.hpp"

#include <compare>
#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

namespace fraja::net {

/// Of a key as people see it: Z85 (RFC 32), printable.
inline constexpr std::size_t key_characters = 40;
inline constexpr std::size_t key_bytes = 32; ///< that these stand for

struct PublicKey {
    std::string text; ///< key_characters of them
    friend auto operator<=>(const PublicKey&, const PublicKey&) = default;
};

/// Errors: invalid_argument, saying what a key looks like.
[[nodiscard]] Result<PublicKey> parse_public_key(std::string_view text);

/// Never printed, compared or logged.
class SecretKey {
public:
    /// Copies `text` (key_characters of them). The caller wipes his own.
    explicit SecretKey(std::string_view text);
    /// Z85, terminated. As long as this or a copy of it lives.
    [[nodiscard]] const char* text() const { return text_.get(); }

private:
    std::shared_ptr<const char> text_;
};

struct KeyPair {
    PublicKey public_key;
    SecretKey secret;
};

/// A new one.
[[nodiscard]] KeyPair make_key_pair();
/// Errors: invalid_argument: the secret is no key, or another key's. They do not quote it.
[[nodiscard]] Result<KeyPair> key_pair(std::string_view public_key, std::string_view secret);

/// What this process has of sockets' keys.
struct Keys {
    KeyPair own;
    /// Whom we connect to.
    PublicKey broker;
};

/// From now on the process leaves no core dump and cannot be looked into by others of this user.
/// Before a secret is read.
void keep_secrets();
/// Overwrites what has held one.
void wipe(std::string& text);

} // namespace fraja::net
