// Sources: what --broker takes besides endpoints. Where a source stands, brokers are found when
// they are needed.
//
//   auto        brokers that announce themselves on this network (beacon.hpp)
//   srv:NAME    those that the DNS names in SRV records (RFC 2782) of _fraja._tcp.NAME; a NAME that
//               begins with _ is taken as it is
#pragma once

#include "common/base/result.hpp"

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::discovery {

inline constexpr std::string_view beacon_source = "auto";
inline constexpr std::string_view srv_prefix = "srv:";
inline constexpr std::size_t sources_max = 8; ///< in one list of brokers
inline constexpr std::string_view srv_service = "_fraja._tcp.";

/// Why there is nobody at `auto`, for people.
inline constexpr const char* nobody_announced =
    "none announces itself on this network (fraja-broker --announce)";

/// Of a word that broker_word() has returned.
[[nodiscard]] bool is_source(std::string_view word);
/// Of such a source: the name whose records are asked for.
[[nodiscard]] std::string srv_name(std::string_view source);

/// What was given for a broker, whole: a source, srv: with the name that is asked for; or an
/// endpoint as sockets connect to it. The error says what is wrong.
[[nodiscard]] Result<std::string> broker_word(std::string_view text);

/// Of a list: all of them whole, each once. Errors: one of them is wrong, or there are more than
/// sources_max sources, which are looked at all the time.
[[nodiscard]] Result<std::vector<std::string>> broker_words(const std::vector<std::string>& texts);

} // namespace fraja::discovery
