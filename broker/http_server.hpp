// HttpServer: a few pages for whoever watches over a broker. What it is asked, and how, is no
// affair of the broker's loop.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/result.hpp"

#include <chrono>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>

namespace fraja::broker {

struct HttpLimits {
    std::size_t threads = 4;              ///< requests answered at once
    std::size_t connections_max = 16;     ///< beyond, 503 at once
    std::size_t request_bytes_max = 8192; ///< line and headers; beyond, the connection ends
    Duration time_max =
        std::chrono::seconds(5); ///< of a connection, from its first byte to its last
};

struct HttpPage {
    int status = 200;
    std::string content_type;
    std::string body;
};

/// "ADDR:PORT" as HttpServer::bind() takes it; what other machines can reach is refused as
/// net::endpoint_to_bind() does.
[[nodiscard]] Result<std::string> http_endpoint(std::string_view text, bool insecure);

/// Answers GET and HEAD for its pages; 404 for others, 405 for other methods. One request for each
/// connection.
class HttpServer {
public:
    /// By path. They are made anew for each request, in any thread.
    using Pages = std::map<std::string, std::function<HttpPage()>, std::less<>>;

    /// `endpoint`: tcp://HOST:PORT, as net::endpoint_to_bind() gives it; port 0: the system
    /// chooses. Errors: invalid_argument, io (the port is taken, no permission). It answers once
    /// `serve` has been called; whoever connects before waits for that.
    [[nodiscard]] static Result<HttpServer> bind(const std::string& endpoint, Pages pages,
                                                 HttpLimits limits = {});
    HttpServer(HttpServer&&) noexcept;
    HttpServer& operator=(HttpServer&&) noexcept;
    /// Ends at once, whoever is being answered.
    ~HttpServer();

    void serve();
    /// http://HOST:PORT, with its real port.
    [[nodiscard]] const std::string& address() const;

private:
    class Impl;
    explicit HttpServer(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

} // namespace fraja::broker
