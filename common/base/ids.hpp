// Ids as types, so that they cannot be swapped.
#pragma once

#include "common/base/rng.hpp"

#include <array>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace fraja {

/// 128 bits, written as 8-4-4-4-12 hexadecimal digits (RFC 9562). The tag keeps kinds apart.
template <class Tag>
struct Uuid {
    std::array<std::uint8_t, 16> bytes{};
    friend auto operator<=>(const Uuid&, const Uuid&) = default;
};

using JobId = Uuid<struct JobTag>;       ///< one submitted picture; made by the client
using FilmId = Uuid<struct FilmTag>;     ///< of jobs that are its frames; made by the client
using WorkerId = Uuid<struct WorkerTag>; ///< one worker process; made at its start
using BrokerId = Uuid<struct BrokerTag>; ///< one broker process; made at its start
using Nonce = Uuid<struct NonceTag>;     ///< used once: a barrier, a request

/// BLAKE2b-256 of a scene's or an asset's bytes.
struct ContentHash {
    std::array<std::uint8_t, 32> bytes{};
    friend auto operator<=>(const ContentHash&, const ContentHash&) = default;
};

enum class TileIndex : std::uint32_t {};     ///< a tile's number within its job, from 0
enum class AttemptNumber : std::uint32_t {}; ///< counts the times a tile was handed out, from 1

namespace detail {
std::string format_uuid(const std::array<std::uint8_t, 16>& bytes);
std::optional<std::array<std::uint8_t, 16>> parse_uuid(std::string_view text);
std::array<std::uint8_t, 16> random_uuid();
} // namespace detail

/// A fresh version-4 UUID from the operating system's random numbers.
template <class Id>
[[nodiscard]] Id random_id() {
    return Id{detail::random_uuid()};
}
/// A generator that no other process has: for nonces and other ids that need not be secret.
[[nodiscard]] Rng fresh_rng();
template <class Tag>
[[nodiscard]] std::string to_string(const Uuid<Tag>& id) {
    return detail::format_uuid(id.bytes);
}
/// Reads the 36-character form, in either case; nothing else.
template <class Id>
[[nodiscard]] std::optional<Id> parse_id(std::string_view text) {
    const auto bytes = detail::parse_uuid(text);
    return bytes ? std::optional<Id>(Id{*bytes}) : std::nullopt;
}

/// 64 hexadecimal digits.
[[nodiscard]] std::string to_string(const ContentHash& hash);

} // namespace fraja

template <class Tag>
struct std::hash<fraja::Uuid<Tag>> {
    std::size_t operator()(const fraja::Uuid<Tag>& id) const noexcept {
        std::size_t h = 14695981039346656037u; // FNV-1a
        for (const std::uint8_t b : id.bytes)
            h = (h ^ b) * 1099511628211u;
        return h;
    }
};
