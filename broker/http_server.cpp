#include "broker/http_server.hpp"

#include "broker/http_stream.hpp"
#include "common/base/assert.hpp"
#include "common/net/clock.hpp"
#include "common/net/endpoint.hpp"
#include "common/net/waker.hpp"

#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <deque>
#include <httplib.h>
#include <mutex>
#include <string_view>
#include <sys/socket.h>
#include <system_error>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

namespace fraja::broker {
namespace {

/// The connection that this thread handles is one too many.
thread_local bool turns_away = false;

constexpr std::string_view busy_answer =
    "HTTP/1.1 503 Service Unavailable\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";

/// So many threads, and room for so many connections; who comes when there is none is told so by
/// the thread that accepts, which never waits.
class BoundedQueue : public httplib::TaskQueue {
public:
    explicit BoundedQueue(const HttpLimits& limits) : connections_max_(limits.connections_max) {
        for (std::size_t i = 0; i < limits.threads; ++i)
            threads_.emplace_back([this] { run(); });
    }

    void enqueue(std::function<void()> connection) override {
        {
            const std::lock_guard lock(mutex_);
            if (connections_ < connections_max_) {
                ++connections_;
                waiting_.push_back(std::move(connection));
                changed_.notify_one();
                return;
            }
        }
        turns_away = true;
        connection();
        turns_away = false;
    }

    void shutdown() override {
        {
            const std::lock_guard lock(mutex_);
            stopping_ = true;
        }
        changed_.notify_all();
        threads_.clear(); // joins
    }

private:
    void run() {
        std::unique_lock lock(mutex_);
        for (;;) {
            changed_.wait(lock, [this] { return !waiting_.empty() || stopping_; });
            if (waiting_.empty())
                return;
            const auto connection = std::move(waiting_.front());
            waiting_.pop_front();
            lock.unlock();
            connection();
            lock.lock();
            --connections_;
        }
    }

    const std::size_t connections_max_;
    std::mutex mutex_; // of what follows
    std::condition_variable changed_;
    std::deque<std::function<void()>> waiting_;
    std::size_t connections_ = 0; // that wait or are answered
    bool stopping_ = false;
    std::vector<std::jthread> threads_; // last: they use the rest
};

/// "[::1]" without its brackets; "*" is every interface.
std::string host_of(const net::Endpoint& endpoint) {
    if (endpoint.host == "*")
        return "0.0.0.0";
    if (endpoint.host.starts_with('[') && endpoint.host.ends_with(']'))
        return endpoint.host.substr(1, endpoint.host.size() - 2);
    return endpoint.host;
}

/// Two brokers must not share a port, as the library's own options would let them.
void set_options(socket_t socket) {
    const int yes = 1;
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
}

} // namespace

Result<std::string> http_endpoint(std::string_view text, bool insecure) {
    const auto endpoint = net::parse_endpoint(text, net::http_port);
    if (!endpoint)
        return endpoint.error();
    if (endpoint->transport != net::Endpoint::Transport::tcp)
        return Error{ErrorCode::invalid_argument,
                     "'" + std::string(text) + "' is no address and port, as 127.0.0.1:50059"};
    return net::endpoint_to_bind(text, net::http_port, insecure);
}

class HttpServer::Impl : httplib::Server {
public:
    Impl(Pages pages, HttpLimits limits) : pages_(std::move(pages)), limits_(limits) {
        new_task_queue = [this] { return new BoundedQueue(limits_); }; // the library owns it
        set_socket_options(set_options);
        set_pre_routing_handler(
            [this](const httplib::Request& request, httplib::Response& response) {
                answer(request, response);
                return HandlerResponse::Handled;
            });
    }

    ~Impl() override {
        stopping_.wake();
        if (thread_.joinable())
            stop();
    }

    Result<void> bind(const std::string& text) {
        const auto endpoint = net::parse_endpoint(text, 0);
        if (!endpoint)
            return endpoint.error();
        const std::string host = host_of(*endpoint);
        errno = 0;
        const int port = endpoint->port == 0                  ? bind_to_any_port(host)
                         : bind_to_port(host, endpoint->port) ? endpoint->port
                                                              : -1;
        if (port < 0)
            return Error{ErrorCode::io,
                         "http://" + host + ":" + std::to_string(endpoint->port) +
                             ": cannot listen there: " +
                             (errno != 0 ? std::generic_category().message(errno)
                                         : "there is no such address on this machine")};
        address_ = "http://" + (endpoint->host == "*" ? host : endpoint->host) + ":" +
                   std::to_string(port);
        return {};
    }

    void serve() {
        FRAJA_ASSERT(!thread_.joinable());
        thread_ = std::jthread([this] {
            listen_after_bind();
            ended_ = true;
        });
        while (!is_running() && !ended_) // stop() does nothing before
            std::this_thread::yield();
    }

    [[nodiscard]] const std::string& address() const { return address_; }

private:
    void answer(const httplib::Request& request, httplib::Response& response) const {
        const auto plain = [&](int status, const std::string& text) {
            response.status = status;
            response.set_content(text + "\n", "text/plain; charset=utf-8");
        };
        if (request.method != "GET" && request.method != "HEAD") {
            response.set_header("Allow", "GET, HEAD");
            return plain(405, "only GET and HEAD are answered here");
        }
        const auto page = pages_.find(request.path);
        if (page == pages_.end()) {
            std::string hint = "there is no such page; there is";
            for (const auto& [path, make] : pages_)
                hint += " " + path;
            return plain(404, hint);
        }
        const HttpPage made = page->second();
        response.status = made.status;
        response.set_content(made.body, made.content_type);
    }

    /// The library's way with a connection has no end as long as its bytes trickle.
    bool process_and_close_socket(socket_t socket) override {
        if (turns_away) {
            [[maybe_unused]] const auto sent =
                send(socket, busy_answer.data(), busy_answer.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
        } else {
            HttpStream stream(socket, stopping_.fd(), net::now() + limits_.time_max,
                              limits_.request_bytes_max);
            try {
                bool closed = false;
                const auto whole = [](httplib::Request& request) { request.ranges.clear(); };
                if (process_request(stream, /*close_connection=*/true, closed, whole))
                    stream.finish();
            } catch (const std::exception&) { // out of memory, say: it gets no answer
            }
        }
        close(socket);
        return true;
    }

    const Pages pages_;
    const HttpLimits limits_;
    std::string address_;
    net::Waker stopping_; // never drained
    std::atomic<bool> ended_ = false;
    std::jthread thread_; // last: it uses the rest
};

HttpServer::HttpServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
HttpServer::HttpServer(HttpServer&&) noexcept = default;
HttpServer& HttpServer::operator=(HttpServer&&) noexcept = default;
HttpServer::~HttpServer() = default;

Result<HttpServer> HttpServer::bind(const std::string& endpoint, Pages pages, HttpLimits limits) {
    auto impl = std::make_unique<Impl>(std::move(pages), limits);
    if (const auto bound = impl->bind(endpoint); !bound)
        return bound.error();
    return HttpServer(std::move(impl));
}

void HttpServer::serve() {
    impl_->serve();
}

const std::string& HttpServer::address() const {
    return impl_->address();
}

} // namespace fraja::broker
