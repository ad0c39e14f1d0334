// Feed: keeps a tev that runs somewhere current, in a thread of its own, so that nobody waits for
// it.
#pragma once

#include "client/tev/canvas.hpp"
#include "common/base/instant.hpp"
#include "common/base/result.hpp"
#include "common/net/tcp.hpp"
#include "common/net/waker.hpp"

#include <condition_variable>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace fraja::client::tev {

/// Where tev listens.
struct Address {
    std::string text; ///< HOST:PORT
    std::vector<net::TcpAddress> tcp;
};
/// "HOST:PORT" or "HOST"; may ask for a name and wait for the answer. Errors: invalid_argument.
[[nodiscard]] Result<Address> find_address(std::string_view text);

/// tev gets the newest state, at most five times a second; where it is not there, or goes, it is
/// looked for without end, and then gets all of it. But for its thread, use from one thread only.
class Feed {
public:
    explicit Feed(Address address);
    ~Feed(); ///< leaves at once

    // As with a Canvas. Neither waits for tev.
    void begin(std::string name, const Film& film);
    void update(PixelRect rect, const Film& film);
    /// Waits until tev has all of it, or is known not to be there, but no longer than `patience`.
    void finish(Duration patience);

    struct Notice {
        bool good = false; ///< it is there
        std::string text;
    };
    /// What has become of tev, once for each change.
    [[nodiscard]] std::optional<Notice> take_notice();

private:
    class Link;
    Result<void> run(const std::stop_token& stop);
    void converse(Link& link, const std::stop_token& stop);
    bool flush(Link& link, const std::stop_token& stop);
    void note(bool there, const std::string& text);

    const Address address_;
    net::Waker waker_; ///< there is something to send, or it is to leave
    std::mutex mutex_;
    std::condition_variable changed_;
    // guarded by mutex_
    Canvas canvas_;
    bool sending_ = false; ///< a flush is on its way
    std::optional<bool> there_;
    std::optional<Notice> notice_;
    std::jthread thread_; ///< last: it uses the others
};

} // namespace fraja::client::tev
