// A server on a port that the system chose.
#pragma once

#include "common/http/server.hpp"
#include "tests/support/connection.hpp"

#include <chrono>
#include <cstdint>
#include <utility>

namespace fraja::http {

constexpr Duration patience = std::chrono::minutes(1);
constexpr const char* page_request = "GET /page HTTP/1.1\r\n\r\n";

inline Answer one_page(const Request& request) {
    return request.path == "/page" ? Answer{.body = body("words")} : refusal(404, "only /page");
}

class Running {
public:
    explicit Running(const Limits& limits = {}, Answerer answer = one_page)
        : server_(*Server::bind({"127.0.0.1", 0}, {std::move(answer), {}, limits})),
          port(server_.address().port) {
        server_.serve();
    }
    /// What /page is answered with, by a connection of its own.
    [[nodiscard]] int ask() const { return ask_http(port, "GET", "/page", patience).status; }

private:
    Server server_;

public:
    const std::uint16_t port;
};

/// Asks for /page, and whether that was answered. The connection is kept.
[[nodiscard]] inline bool asks(Connection& connection) {
    return connection.say(page_request) &&
           connection.read_until("\r\n\r\nwords", patience).has_value();
}

} // namespace fraja::http
