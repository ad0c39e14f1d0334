// Door: whom the live page is shown to.
#pragma once

#include "client/page/address.hpp"
#include "common/http/message.hpp"

#include <optional>
#include <string>

namespace fraja::client {

/// On loopback everybody on this machine may come in, but no other site's page by way of the user's
/// browser: neither by a name that it lets point here (the Host header must be loopback's), nor by
/// a request of its own (Sec-Fetch-Site, and Origin of what changes anything). With a token,
/// whoever has it: it comes once in the address, and then as a cookie that scripts cannot read and
/// other sites' pages do not send.
class Door {
public:
    /// `token` may be empty only on loopback (asserted). The address has its real port.
    Door(const PageAddress& address, std::string token);

    /// Nothing: come in. Else what is to be answered: it names the cure.
    [[nodiscard]] std::optional<http::Answer> refusal(const http::Request& request) const;
    /// The cookie to be set with the page, where the request brings the token in its address.
    [[nodiscard]] std::string cookie(const http::Request& request) const;

private:
    [[nodiscard]] bool has_token_in_address(const http::Request& request) const;
    [[nodiscard]] bool has_token(const http::Request& request) const;

    bool loopback_;
    std::string token_;
    std::string cookie_name_; ///< names the port: cookies are for all of a host's
};

} // namespace fraja::client
