#include "client/page/door.hpp"

#include "client/page/token.hpp"

#include <algorithm>
#include <utility>

namespace fraja::client {
namespace {

/// Of "a=1; b=2" the value of `name`; empty: none.
std::string_view cookie_named(std::string_view cookies, std::string_view name) {
    while (!cookies.empty()) {
        const std::size_t end = std::min(cookies.find(';'), cookies.size());
        std::string_view one = cookies.substr(0, end);
        cookies.remove_prefix(std::min(end + 1, cookies.size()));
        one.remove_prefix(std::min(one.find_first_not_of(' '), one.size()));
        if (one.starts_with(name) && one.substr(name.size()).starts_with('='))
            return one.substr(name.size() + 1);
    }
    return {};
}

bool is_page(const http::Request& request) {
    return request.method == "GET" && request.path == "/";
}

} // namespace

Door::Door(const PageAddress& address, std::string token)
    : loopback_(address.loopback), token_(std::move(token)),
      cookie_name_("fraja_page_" + std::to_string(address.port)) {
    FRAJA_ASSERT(loopback_ || !token_.empty());
}

std::optional<http::Answer> Door::refusal(const http::Request& request) const {
    if (loopback_ && !is_loopback_host(request.host))
        return http::refusal(403, "This page is for this machine alone, and you asked for '" +
                                      request.host +
                                      "': open it as 127.0.0.1, or start fraja-watch with "
                                      "--serve ADDR:PORT of a network.");
    // A browser says whose page a request is made by; the page itself may be linked to.
    const bool foreign = request.fetch_site == "cross-site" || request.fetch_site == "same-site";
    if (foreign && !is_page(request))
        return http::refusal(403, "Another site's page asked for this: open the page itself.");
    const bool changes = request.method != "GET" && request.method != "HEAD";
    if (changes && request.origin != "http://" + request.host &&
        request.origin != "https://" + request.host)
        return http::refusal(403, "What changes anything is taken from the page itself alone (its "
                                  "Origin header); scripts use fraja-ctl.");
    if (!has_token(request))
        return http::refusal(401, "This page wants its token: open the whole address that "
                                  "fraja-watch printed when it started.");
    return std::nullopt;
}

std::string Door::cookie(const http::Request& request) const {
    if (!has_token_in_address(request))
        return {};
    return cookie_name_ + "=" + token_ + "; Path=/; HttpOnly; SameSite=Strict";
}

bool Door::has_token_in_address(const http::Request& request) const {
    const auto given = request.query.find("token");
    return !token_.empty() && is_page(request) && given != request.query.end() &&
           is_same_token(given->second, token_);
}

bool Door::has_token(const http::Request& request) const {
    return token_.empty() || has_token_in_address(request) ||
           is_same_token(cookie_named(request.cookies, cookie_name_), token_);
}

} // namespace fraja::client
