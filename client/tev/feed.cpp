#include "client/tev/feed.hpp"

#include "client/tev/packets.hpp"
#include "common/base/guarded.hpp"
#include "common/net/clock.hpp"
#include "common/net/endpoint.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <poll.h>
#include <span>
#include <sys/socket.h>
#include <utility>

namespace fraja::client::tev {
namespace {

using namespace std::chrono_literals;

constexpr Duration flush_pause = 200ms;
constexpr Duration connect_max = 3s;
constexpr Duration retry_first = 200ms, retry_max = 3s;

} // namespace

Result<Address> find_address(std::string_view text) {
    const auto endpoint = net::parse_endpoint(text, port);
    if (!endpoint)
        return endpoint.error();
    const auto wrong = [&](const std::string& why) {
        return Error{ErrorCode::invalid_argument, std::string(text) + ": " + why};
    };
    if (endpoint->transport != net::Endpoint::Transport::tcp || endpoint->host == "*" ||
        endpoint->port == 0)
        return wrong("tev listens at HOST:PORT");
    const auto addresses = net::addresses_of(endpoint->host, endpoint->port);
    if (!addresses)
        return wrong(addresses.error().message);
    return Address{endpoint->host + ":" + std::to_string(endpoint->port), *addresses};
}

/// The connection. Whatever waits here is woken by the waker.
class Feed::Link {
public:
    Link(net::TcpSocket socket, const net::Waker& waker)
        : waker_(waker), socket_(std::move(socket)) {}

    /// Whether all of it has gone; not if the connection ends before, or it is to stop.
    bool send(std::span<const std::byte> bytes, const std::stop_token& stop) {
        while (!bytes.empty() && !stop.stop_requested()) {
            const ssize_t n =
                ::send(socket_.fd(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
            if (n > 0)
                bytes = bytes.subspan(static_cast<std::size_t>(n));
            else if (errno == EAGAIN || errno == EWOULDBLOCK)
                wait(POLLOUT, 1min);
            else if (errno != EINTR)
                return false;
        }
        return bytes.empty();
    }

    /// tev never says anything; but the end of the connection can be heard.
    bool is_open() {
        std::array<std::byte, 256> rubbish;
        ssize_t n = 0;
        while ((n = ::recv(socket_.fd(), rubbish.data(), rubbish.size(), MSG_DONTWAIT)) > 0) {
        }
        return n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR);
    }

    /// Until there is what is asked for, or a wake; returns what poll() says of the connection.
    short wait(short events, Duration timeout) {
        std::array<pollfd, 2> entries = {{{socket_.fd(), events, 0}, {waker_.fd(), POLLIN, 0}}};
        const auto ms = std::chrono::ceil<std::chrono::milliseconds>(
            std::clamp<Duration>(timeout, Duration::zero(), 1min));
        if (::poll(entries.data(), entries.size(), static_cast<int>(ms.count())) > 0 &&
            entries[1].revents != 0)
            waker_.drain();
        return entries[0].revents;
    }

private:
    const net::Waker& waker_;
    net::TcpSocket socket_; ///< where there is none, only wakes are waited for
};

Feed::Feed(Address address) : address_(std::move(address)) {
    thread_ = std::jthread([this](const std::stop_token& stop) {
        const std::stop_callback leave(stop, [this] { waker_.wake(); });
        if (const auto ran = guarded([&] { return run(stop); }); !ran)
            note(false, "tev is not served any more: " + ran.error().message);
    });
}

Feed::~Feed() = default;

void Feed::begin(std::string name, const Film& film) {
    const std::lock_guard lock(mutex_);
    canvas_.begin(std::move(name), film);
    waker_.wake();
}

void Feed::update(PixelRect rect, const Film& film) {
    const std::lock_guard lock(mutex_);
    canvas_.update(rect, film);
    waker_.wake();
}

void Feed::finish(Duration patience) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, patience, [&] {
        return there_ == false || (there_ == true && !canvas_.is_dirty() && !sending_);
    });
}

std::optional<Feed::Notice> Feed::take_notice() {
    const std::lock_guard lock(mutex_);
    return std::exchange(notice_, std::nullopt);
}

void Feed::note(bool there, const std::string& text) {
    {
        const std::lock_guard lock(mutex_);
        if (there_ == there)
            return;
        there_ = there;
        notice_ = Notice{there, text};
    }
    changed_.notify_all();
}

Result<void> Feed::run(const std::stop_token& stop) {
    Duration pause = retry_first;
    while (!stop.stop_requested()) {
        auto connection = net::connect_to(address_.tcp, connect_max, {stop, &waker_});
        if (connection) {
            pause = retry_first;
            Link link(std::move(connection->socket), waker_);
            converse(link, stop);
            note(false, "tev at " + address_.text + " has gone; looking for it");
        } else {
            note(false, "no tev at " + address_.text + " (" + connection.error().message +
                            "): start tev there, or name another place, as --tev HOST:PORT; "
                            "looking for it");
        }
        const Instant again = net::now() + pause;
        while (!stop.stop_requested() && net::now() < again)
            Link({}, waker_).wait(0, again - net::now());
        pause = std::min(2 * pause, retry_max);
    }
    return {};
}

/// Until the connection ends, or it is to stop.
void Feed::converse(Link& link, const std::stop_token& stop) {
    {
        const std::lock_guard lock(mutex_);
        canvas_.send_all();
    }
    note(true, "tev at " + address_.text + " is shown the picture");
    while (!stop.stop_requested() && link.is_open()) {
        const Instant next = net::now() + flush_pause;
        if (!flush(link, stop))
            return;
        while (!stop.stop_requested() && net::now() < next && link.is_open())
            link.wait(POLLIN, next - net::now());
        const auto is_dirty = [&] {
            const std::lock_guard lock(mutex_);
            return canvas_.is_dirty();
        };
        while (!stop.stop_requested() && !is_dirty() && link.is_open())
            link.wait(POLLIN, 1min);
    }
}

/// Whether all of it has gone.
bool Feed::flush(Link& link, const std::stop_token& stop) {
    {
        const std::lock_guard lock(mutex_);
        canvas_.begin_flush();
        sending_ = true;
    }
    const auto next_packet = [&] {
        const std::lock_guard lock(mutex_);
        return canvas_.next_packet();
    };
    bool sent = true;
    while (sent) {
        const auto packet = next_packet();
        if (!packet)
            break;
        sent = link.send(*packet, stop);
    }
    {
        const std::lock_guard lock(mutex_);
        sending_ = false;
    }
    changed_.notify_all();
    return sent;
}

} // namespace fraja::client::tev
