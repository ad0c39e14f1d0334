// Server: speaks HTTP. The only file with cpp-httplib.
#pragma once

#include "client/page/address.hpp"
#include "client/page/http.hpp"

#include <cstddef>
#include <functional>
#include <memory>

namespace fraja::client {

/// Viewers at a time: each has a thread, as cpp-httplib does it. More are told so (503).
inline constexpr std::size_t viewers_max = 128;
/// Requests beside them, of a moment each: a connection is closed when it is answered, so that none
/// holds a thread while it is idle.
inline constexpr std::size_t requests_at_a_time = 32;

class Server {
public:
    /// `answer` is called by many threads.
    explicit Server(std::function<HttpAnswer(const HttpRequest&)> answer);
    /// Ends what is being sent.
    ~Server();

    /// Takes the address, and returns it with the port that it is. Nobody is answered yet. Errors:
    /// invalid_argument, naming the address and the cure.
    [[nodiscard]] Result<PageAddress> bind(const PageAddress& address);
    /// Answers from now on, in threads of its own. Call after bind(), once.
    void start();

private:
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace fraja::client
