// fields_of<T>: the fields of a record in the order of the wire, for the codec and for the test
// that holds PROTOCOL.md against the code.
#pragma once

#include "common/base/pixel_rect.hpp"

#include <cstdint>
#include <string_view>
#include <tuple>

namespace fraja::protocol {

/// Of the protocol.
using Version = std::uint16_t;

template <class Owner, class Member>
struct Field {
    std::string_view name;
    Member Owner::*member;
    Version since = 0; ///< it came with; 0: one that is not spoken any more
};
template <class Owner, class Member>
Field(std::string_view, Member Owner::*) -> Field<Owner, Member>;
template <class Owner, class Member>
Field(std::string_view, Member Owner::*, Version) -> Field<Owner, Member>;

/// A record is whatever has fields: its own `T::fields`, or a specialisation of this.
template <class T>
struct FieldsOf {};
template <class T>
requires requires {
    T::fields();
}
struct FieldsOf<T> {
    static constexpr auto fields() { return T::fields(); }
};
template <>
struct FieldsOf<Extent> {
    static constexpr auto fields() {
        return std::tuple{Field{"width", &Extent::width}, Field{"height", &Extent::height}};
    }
};
template <>
struct FieldsOf<PixelRect> {
    static constexpr auto fields() {
        return std::tuple{Field{"x", &PixelRect::x}, Field{"y", &PixelRect::y},
                          Field{"width", &PixelRect::width}, Field{"height", &PixelRect::height}};
    }
};

template <class T>
concept Record = requires {
    FieldsOf<T>::fields();
};

/// An enum that travels says how many values it has; others are refused. Where some came with a
/// version whose predecessor is spoken, it also says what they are `in_words_of` that one.
template <class E>
struct ValueCount {};

} // namespace fraja::protocol
