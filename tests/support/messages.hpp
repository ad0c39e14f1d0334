// Random messages of every type, for tests of the codec and of the cores.
#pragma once

#include "common/base/rng.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/messages.hpp"

#include <type_traits>
#include <utility>

namespace fraja {

namespace detail {
template <class T>
constexpr bool is_vector_v = false;
template <class T>
constexpr bool is_vector_v<std::vector<T>> = true;
} // namespace detail

/// Any value of a field's type, small and large ones alike.
template <class T>
void randomise(Rng& rng, T& value) {
    if constexpr (std::is_same_v<T, bool>) {
        value = rng.below(2) == 1;
    } else if constexpr (std::is_same_v<T, double>) {
        value = rng.between(-1e9, 1e9);
    } else if constexpr (std::is_same_v<T, Duration>) {
        value = Duration(static_cast<Duration::rep>(rng.next()));
    } else if constexpr (requires { protocol::ValueCount<T>::value; }) {
        value = static_cast<T>(rng.below(protocol::ValueCount<T>::value));
    } else if constexpr (std::is_enum_v<T> || std::is_integral_v<T>) {
        value = static_cast<T>(rng.next() >> rng.below(64));
    } else if constexpr (std::is_same_v<T, std::string>) {
        value.assign(rng.below(rng.below(20) == 0 ? protocol::string_bytes_max : 12), 'x');
        for (char& c : value)
            c = static_cast<char>('a' + rng.below(26));
    } else if constexpr (requires { value.bytes.data(); }) {
        for (auto& byte : value.bytes)
            byte = static_cast<std::uint8_t>(rng.next());
    } else if constexpr (std::is_same_v<T, Bytes>) {
        value.resize(rng.below(40));
        for (auto& byte : value)
            byte = static_cast<std::byte>(rng.next());
    } else if constexpr (detail::is_vector_v<T>) {
        value.resize(rng.below(4));
        for (auto& element : value)
            randomise(rng, element);
    } else {
        std::apply([&](const auto&... field) { (randomise(rng, value.*(field.member)), ...); },
                   protocol::FieldsOf<T>::fields());
    }
}

template <class M>
M random_message_of(Rng& rng) {
    M message;
    randomise(rng, message);
    if constexpr (protocol::CarriesBlobs<M>) {
        const std::size_t count = std::is_same_v<M, protocol::Chunk> ? 1 : 1 + rng.below(3);
        for (std::size_t i = 0; i < count; ++i)
            message.blobs.push_back(Blob(Bytes(rng.below(100), std::byte{7})));
    }
    return message;
}

/// Calls `visit(type_identity<M>)` for every message type.
template <class Visit, std::size_t... I>
void for_each_message_type(Visit visit, std::index_sequence<I...>) {
    (visit(std::type_identity<std::variant_alternative_t<I, protocol::MessageVariant>>{}), ...);
}
template <class Visit>
void for_each_message_type(Visit visit) {
    for_each_message_type(
        visit, std::make_index_sequence<std::variant_size_v<protocol::MessageVariant>>());
}

inline protocol::Message random_message(Rng& rng) {
    protocol::Message message;
    std::size_t at = rng.below(std::variant_size_v<protocol::MessageVariant>);
    for_each_message_type([&]<class M>(std::type_identity<M>) {
        if (at-- == 0)
            message = random_message_of<M>(rng);
    });
    return message;
}

} // namespace fraja
