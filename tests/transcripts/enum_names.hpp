// The names of enumerators, as they are written in the code: the compiler knows them.
#pragma once

#include "broker/events.hpp"
#include "common/protocol/fields.hpp"

#include <array>
#include <cstddef>
#include <optional>
#include <string_view>
#include <utility>

/// It does not travel, so this is not said where it is defined.
template <>
struct fraja::protocol::ValueCount<fraja::LogLevel> {
    static constexpr unsigned value = 4;
};

namespace fraja {

template <class E>
concept Named = requires {
    protocol::ValueCount<E>::value;
};

namespace detail {
template <auto value>
constexpr std::string_view enumerator_name() {
    // GCC: "... [with auto value = fraja::Colour::red; ...]", clang: "... [value = ...]".
    std::string_view text = __PRETTY_FUNCTION__;
    text.remove_prefix(text.find("value = "));
    text = text.substr(0, text.find_first_of(";]"));
    return text.substr(text.rfind(':') + 1);
}
template <class E, std::size_t... I>
constexpr auto enumerator_names(std::index_sequence<I...>) {
    return std::array<std::string_view, sizeof...(I)>{enumerator_name<static_cast<E>(I)>()...};
}
} // namespace detail

/// By value, from 0.
template <Named E>
inline constexpr auto enumerators =
    detail::enumerator_names<E>(std::make_index_sequence<protocol::ValueCount<E>::value>());

template <Named E>
[[nodiscard]] std::optional<E> enumerator_named(std::string_view name) {
    for (std::size_t i = 0; i < enumerators<E>.size(); ++i)
        if (enumerators<E>[i] == name)
            return static_cast<E>(i);
    return std::nullopt;
}

} // namespace fraja
