// Roles: what the holder of a key may do on a farm.
#pragma once

#include "common/protocol/messages.hpp"

#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::protocol {

enum class Role : std::uint8_t {
    worker, ///< renders
    submit, ///< submits jobs and decides over jobs
    watch,  ///< looks
    admin,  ///< decides over jobs and workers
    broker, ///< another broker of the same farm: may do all
};
template <>
struct ValueCount<Role> {
    static constexpr unsigned value = 5;
};

/// A set of them.
class Roles {
public:
    constexpr Roles() = default;
    constexpr Roles(std::initializer_list<Role> roles) {
        for (const Role role : roles)
            add(role);
    }
    constexpr void add(Role role) { bits_ |= 1u << static_cast<unsigned>(role); }
    [[nodiscard]] constexpr bool has(Role role) const {
        return (bits_ >> static_cast<unsigned>(role) & 1u) != 0;
    }
    [[nodiscard]] constexpr bool has_any(Roles others) const { return (bits_ & others.bits_) != 0; }
    [[nodiscard]] constexpr bool empty() const { return bits_ == 0; }
    friend constexpr bool operator==(Roles, Roles) = default;

private:
    unsigned bits_ = 0;
};

/// One of these is needed to follow the stream, and to open a client's session.
inline constexpr Roles client_roles{Role::submit, Role::watch, Role::admin, Role::broker};
/// One of these is needed to call a worker that listens.
inline constexpr Roles caller_roles{Role::submit, Role::broker};
inline constexpr Roles worker_roles{Role::worker, Role::broker};

/// One of these is needed to say that to a broker. Empty: nobody needs any.
[[nodiscard]] Roles roles_to_say(const Message& message);

[[nodiscard]] std::string_view name_of(Role role);
[[nodiscard]] std::optional<Role> parse_role(std::string_view name);
/// Of an allow-list: all but broker, which nobody is given.
[[nodiscard]] std::vector<std::string_view> role_names();
/// "submit or admin": those that are given; in their order. "broker" where that is the only one.
[[nodiscard]] std::string alternatives(Roles roles);

/// Who has a key.
struct KeyHolder {
    std::string key;  ///< the public one, Z85
    std::string name; ///< for people; empty: nobody knows that key (any more)
    Roles roles;
    bool is_shared = false; ///< by many machines of one owner: each is somebody by itself
    friend bool operator==(const KeyHolder&, const KeyHolder&) = default;
};

} // namespace fraja::protocol
