// Connection: a plain TCP connection to a port of this machine, for what well-behaved peers do not
// do.
#pragma once

#include "common/base/instant.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace fraja {

class Connection {
public:
    /// Aborts when nobody listens.
    explicit Connection(std::uint16_t port);
    ~Connection();
    Connection(Connection&& other) noexcept;
    Connection& operator=(Connection&&) = delete;

    /// Whether it could be sent.
    bool say(std::string_view bytes);
    void close_writing();
    /// All that comes until the other end closes; nothing: it does not within `timeout`.
    [[nodiscard]] std::optional<std::string> read_to_end(Duration timeout);
    /// All that comes until it ends with `end`; nothing: it does not within `timeout`, or is closed
    /// before.
    [[nodiscard]] std::optional<std::string> read_until(std::string_view end, Duration timeout);

private:
    enum class Came : std::uint8_t { bytes, end, nothing };
    [[nodiscard]] Came read(std::string& to, Duration timeout);

    int fd_;
};

/// The port at the end of "tcp://127.0.0.1:1234" or "http://127.0.0.1:1234".
[[nodiscard]] std::uint16_t port_of(std::string_view address);

struct HttpAnswer {
    int status = 0; ///< 0: no answer came
    std::string head, body;
};

/// One request on a connection of its own, to the end.
[[nodiscard]] HttpAnswer ask_http(std::uint16_t port, std::string_view method,
                                  std::string_view path, Duration timeout);

} // namespace fraja
