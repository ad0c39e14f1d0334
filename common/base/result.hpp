// Result<T>: a value or an Error, with the member names of std::expected (which GCC 12 lacks).
#pragma once

#include "common/base/assert.hpp"

#include <optional>
#include <string>
#include <utility>
#include <variant>

namespace fraja {

/// What went wrong, for a program to act on.
enum class ErrorCode {
    invalid_argument,   ///< an option, an endpoint, a size: what a person typed
    invalid_scene,      ///< a scene file that cannot be drawn
    unresolved_overlap, ///< a ray needed a priority that the scene does not give
    malformed_frame,    ///< bytes from a peer that are no message
    version_mismatch,   ///< a peer that speaks another protocol version
    limit_exceeded,     ///< more than a named limit allows
    not_found,
    io,          ///< the operating system refused
    in_use,      ///< likewise, as another program has it: a port, a folder
    cancelled,   ///< stopped on request before it was done
    unreachable, ///< a peer that is not there
    refused,     ///< a peer that says no
};

struct Error {
    ErrorCode code;
    std::string message; ///< for a person: what, where, and the cure
    friend bool operator==(const Error&, const Error&) = default;
};

template <class T>
class [[nodiscard]] Result {
public:
    using value_type = T;
    Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}
    Result(Error error) : state_(std::in_place_index<1>, std::move(error)) {}

    [[nodiscard]] bool has_value() const { return state_.index() == 0; }
    explicit operator bool() const { return has_value(); }

    /// Aborts when there is no value: ask first.
    T& value() & { return FRAJA_ASSERT(has_value()), *std::get_if<0>(&state_); }
    const T& value() const& { return FRAJA_ASSERT(has_value()), *std::get_if<0>(&state_); }
    T&& value() && { return FRAJA_ASSERT(has_value()), std::move(*std::get_if<0>(&state_)); }
    T& operator*() & { return value(); }
    const T& operator*() const& { return value(); }
    T&& operator*() && { return std::move(*this).value(); }
    T* operator->() { return &value(); }
    const T* operator->() const { return &value(); }
    T value_or(T other) const& { return has_value() ? value() : std::move(other); }

    /// Aborts when there is no error.
    const Error& error() const { return FRAJA_ASSERT(!has_value()), *std::get_if<1>(&state_); }

private:
    std::variant<T, Error> state_;
};

template <>
class [[nodiscard]] Result<void> {
public:
    using value_type = void;
    Result() = default;
    Result(Error error) : error_(std::move(error)) {}

    [[nodiscard]] bool has_value() const { return !error_; }
    explicit operator bool() const { return has_value(); }
    const Error& error() const { return FRAJA_ASSERT(error_.has_value()), *error_; }

private:
    std::optional<Error> error_;
};

} // namespace fraja
