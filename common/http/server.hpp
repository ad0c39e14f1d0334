// Server: answers HTTP, whatever those who connect do.
#pragma once

#include "common/base/result.hpp"
#include "common/http/address.hpp"
#include "common/http/limits.hpp"
#include "common/http/message.hpp"

#include <memory>

namespace fraja::http {

/// One thread waits for all connections; only requests that are whole reach the threads that
/// answer. So nobody can keep others waiting: not by connecting and saying nothing, nor slowly, nor
/// by not taking an answer, nor by looking at lines without end. Limits say for how long each is
/// borne. GET, HEAD and POST without a body; connections are kept for more requests.
class Server {
public:
    struct Setup {
        Answerer answer;
        Headers always = {}; ///< of every answer
        Limits limits = {};
    };

    /// Whoever connects before `serve` waits for that. Errors as listen_at().
    [[nodiscard]] static Result<Server> bind(const Address& address, Setup setup);
    Server(Server&&) noexcept;
    Server& operator=(Server&&) noexcept;
    /// Closes all connections, and waits for calls of `answer` that have begun, for nobody else.
    ~Server();

    /// Answers from now on, in threads of its own. Once.
    void serve();
    /// With its real port.
    [[nodiscard]] const Address& address() const;

private:
    class Loop;
    explicit Server(std::unique_ptr<Loop> loop);
    std::unique_ptr<Loop> loop_;
};

} // namespace fraja::http
