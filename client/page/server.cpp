#include "client/page/server.hpp"

#include "client/page/routes.hpp"
#include "common/net/clock.hpp"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <httplib.h>
#include <mutex>
#include <sys/socket.h>
#include <thread>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr auto look_pause = 250ms;        // of a viewer's lines
constexpr auto peer_patience = 5s;        // for a request to come, an answer to be taken
constexpr std::size_t body_bytes_max = 0; // of a request: none has a body
constexpr int backlog = 1024;             // cpp-httplib's own 5 makes a herd wait for seconds

class Listening final : public httplib::Server {
public:
    void widen_backlog() { ::listen(svr_sock_, backlog); }
};

/// cpp-httplib's own choice is SO_REUSEPORT: of two pages at one address each would get some of the
/// requests.
void own_address(socket_t socket) {
    const int yes = 1;
    ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
}

HttpRequest request_of(const httplib::Request& from) {
    HttpRequest request{.method = from.method,
                        .path = from.path,
                        .query = {},
                        .host = from.get_header_value("Host"),
                        .origin = from.get_header_value("Origin"),
                        .fetch_site = from.get_header_value("Sec-Fetch-Site"),
                        .cookies = from.get_header_value("Cookie")};
    for (const auto& [name, value] : from.params)
        request.query.emplace(name, value);
    return request;
}

} // namespace

struct fraja::client::Server::State {
    explicit State(std::function<HttpAnswer(const HttpRequest&)> a) : answer(std::move(a)) {}

    void give(const httplib::Request& asked, httplib::Response& response) {
        const HttpAnswer a = answer(request_of(asked));
        if (a.lines)
            return stream(a, response);
        response.status = a.status;
        response.set_header("Cache-Control", a.caching);
        if (!a.cookie.empty())
            response.set_header("Set-Cookie", a.cookie);
        if (a.retry_after_s)
            response.set_header("Retry-After", std::to_string(*a.retry_after_s));
        send(response, a.type, a.body);
    }

    /// Not copied: a hundred viewers are sent the same bytes.
    static void send(httplib::Response& response, const std::string& type, const HttpBody& body) {
        if (!body || body->empty())
            return response.set_content("", type);
        response.set_content_provider(body->size(), type,
                                      [body](std::size_t offset, std::size_t length, auto& sink) {
                                          return sink.write(body->data() + offset, length);
                                      });
    }

    void stream(const HttpAnswer& a, httplib::Response& response) {
        if (viewers.fetch_add(1) >= viewers_max) {
            --viewers;
            response.status = 503;
            response.set_header("Retry-After", "5");
            return response.set_content(std::to_string(viewers_max) +
                                            " look at this page already: try again later.\n",
                                        "text/plain; charset=utf-8");
        }
        response.set_header("Cache-Control", "no-store");
        response.set_chunked_content_provider(
            a.type,
            [this, lines = a.lines](std::size_t, httplib::DataSink& sink) {
                const std::string text = lines->next(net::now());
                if (!text.empty() && !sink.write(text.data(), text.size()))
                    return false;
                if (!sink.is_writable())
                    return false;
                if (!pause())
                    sink.done();
                return true;
            },
            [this](bool) { --viewers; });
    }

    /// Whether it goes on then.
    bool pause() {
        std::unique_lock lock(mutex);
        return !woken.wait_for(lock, look_pause, [this] { return stopping; });
    }

    std::function<HttpAnswer(const HttpRequest&)> answer;
    std::atomic<std::size_t> viewers = 0;
    std::mutex mutex; // guards `stopping`
    std::condition_variable woken;
    bool stopping = false;
    Listening server;
    std::jthread thread;
};

Server::Server(std::function<HttpAnswer(const HttpRequest&)> answer)
    : state_(std::make_unique<State>(std::move(answer))) {
    Listening& server = state_->server;
    server.new_task_queue = [] {
        return new httplib::ThreadPool(viewers_max + requests_at_a_time); // cpp-httplib deletes it
    };
    server.set_socket_options(own_address);
    server.set_keep_alive_max_count(1);
    server.set_read_timeout(peer_patience);
    server.set_write_timeout(peer_patience);
    server.set_payload_max_length(body_bytes_max);
    server.set_tcp_nodelay(true);
    server.set_default_headers({{"Content-Security-Policy", content_security_policy},
                                {"X-Content-Type-Options", "nosniff"},
                                {"Referrer-Policy", "no-referrer"},
                                {"Cross-Origin-Resource-Policy", "same-origin"}});
    server.set_pre_routing_handler([this](const auto& asked, auto& response) {
        state_->give(asked, response);
        return httplib::Server::HandlerResponse::Handled;
    });
}

Server::~Server() {
    {
        const std::scoped_lock lock(state_->mutex);
        state_->stopping = true;
    }
    state_->woken.notify_all();
    state_->server.stop();
}

Result<PageAddress> Server::bind(const PageAddress& address) {
    PageAddress bound = address;
    errno = 0;
    const int port = address.port == 0 ? state_->server.bind_to_any_port(address.host)
                     : state_->server.bind_to_port(address.host, address.port) ? address.port
                                                                               : -1;
    if (port <= 0)
        return Error{ErrorCode::invalid_argument,
                     "--serve: cannot listen at " + address.host + ", port " +
                         std::to_string(address.port) + ": " +
                         (errno != 0 ? std::strerror(errno) : "no such address") +
                         " (with port 0 the system chooses one)"};
    state_->server.widen_backlog();
    bound.port = static_cast<std::uint16_t>(port);
    return bound;
}

void Server::start() {
    state_->thread = std::jthread([this] { state_->server.listen_after_bind(); });
    while (!state_->server.is_running()) // else a stop() that comes too early goes unheard
        std::this_thread::sleep_for(1ms);
}

} // namespace fraja::client
