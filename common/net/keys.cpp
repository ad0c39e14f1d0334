#include "common/net/keys.hpp"

#include "common/base/assert.hpp"
#include "common/base/text.hpp"
#include "common/base/z85.hpp"

#include <array>
#include <cstring>
#include <new>
#include <sodium.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <zmq.hpp>

namespace fraja::net {
namespace {

using Text = std::array<char, key_characters + 1>;

/// As zmq_z85_decode() wants it, which complains to nobody of some bytes that are none.
bool is_z85(std::string_view text) {
    std::array<std::uint8_t, key_bytes> bytes{};
    Text terminated{};
    if (text.size() != key_characters || !is_of_z85(text))
        return false;
    std::ranges::copy(text, terminated.begin());
    const bool decodes = zmq_z85_decode(bytes.data(), terminated.data()) != nullptr;
    sodium_memzero(bytes.data(), bytes.size());
    sodium_memzero(terminated.data(), terminated.size());
    return decodes;
}

std::shared_ptr<const char> guarded_copy(std::string_view text) {
    FRAJA_ASSERT(sodium_init() >= 0);
    auto* const memory = static_cast<char*>(sodium_malloc(key_characters + 1));
    if (!memory)
        throw std::bad_alloc();
    std::memcpy(memory, text.data(), key_characters);
    memory[key_characters] = 0;
    sodium_mprotect_readonly(memory);
    return {memory, [](const char* p) { sodium_free(const_cast<char*>(p)); }};
}

} // namespace

Result<PublicKey> parse_public_key(std::string_view text) {
    if (!is_z85(text))
        return Error{ErrorCode::invalid_argument,
                     "'" + printable(clipped(text, key_characters + 20)) +
                         "' is no public key: it has 40 characters, as fraja-ctl keygen prints "
                         "them (quote it: '...')"};
    return PublicKey{std::string(text)};
}

SecretKey::SecretKey(std::string_view text) : text_(guarded_copy(text)) {
    FRAJA_ASSERT(text.size() == key_characters);
}

KeyPair make_key_pair() {
    Text public_key{}, secret{};
    FRAJA_ASSERT(zmq_curve_keypair(public_key.data(), secret.data()) == 0);
    KeyPair pair{{public_key.data()}, SecretKey({secret.data(), key_characters})};
    sodium_memzero(secret.data(), secret.size());
    return pair;
}

Result<KeyPair> key_pair(std::string_view public_key, std::string_view secret) {
    auto parsed = parse_public_key(public_key);
    if (!parsed)
        return parsed.error();
    if (!is_z85(secret))
        return Error{ErrorCode::invalid_argument, "the secret is no key of 40 characters"};
    SecretKey kept(secret);
    Text derived{};
    if (zmq_curve_public(derived.data(), kept.text()) != 0 || parsed->text != derived.data())
        return Error{ErrorCode::invalid_argument,
                     "public and secret are no pair; fraja-ctl keygen makes a new one"};
    return KeyPair{*std::move(parsed), std::move(kept)};
}

void keep_secrets() {
    (void)prctl(PR_SET_DUMPABLE, 0, 0, 0, 0);
    const rlimit none{0, 0};
    (void)setrlimit(RLIMIT_CORE, &none);
}

void wipe(std::string& text) {
    sodium_memzero(text.data(), text.capacity());
    text.clear();
}

} // namespace fraja::net
