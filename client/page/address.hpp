// Where the live page is served.
#pragma once

#include "common/base/result.hpp"

#include <cstdint>
#include <string>
#include <string_view>

namespace fraja::client {

inline constexpr std::uint16_t page_port = 50060; ///< unless told otherwise

struct PageAddress {
    std::string host = "127.0.0.1"; ///< as a socket binds it: an IPv6 address without brackets
    std::uint16_t port = page_port; ///< 0: the system chooses
    bool loopback = true;           ///< only this machine can reach it
    friend bool operator==(const PageAddress&, const PageAddress&) = default;
};

/// "ADDR:PORT"; the host * is every interface, an IPv6 address has brackets. Empty: the default.
/// Errors: invalid_argument.
[[nodiscard]] Result<PageAddress> parse_page_address(std::string_view text);

/// Whether a Host header, of any port, names this machine to itself. A name that only begins like
/// an address does not.
[[nodiscard]] bool is_loopback_host(std::string_view host);

/// What a browser opens. `token` may be empty. Where every interface is served, `machine` is the
/// name that others know this one by.
[[nodiscard]] std::string page_url(const PageAddress& address, std::string_view machine,
                                   std::string_view token);

} // namespace fraja::client
