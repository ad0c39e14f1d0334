#include "common/http/exchange.hpp"

#include <algorithm>
#include <cstring>
#include <exception>
#include <httplib.h>
#include <string>
#include <utility>

namespace fraja::http {
namespace {

/// What was received, and room for what is to be sent.
class Bytes final : public httplib::Stream {
public:
    explicit Bytes(std::string_view received) : received_(received) {}

    [[nodiscard]] bool is_readable() const override { return !received_.empty(); }
    [[nodiscard]] bool is_writable() const override { return true; }
    ssize_t read(char* to, std::size_t size) override {
        size = std::min(size, received_.size());
        std::memcpy(to, received_.data(), size);
        received_.remove_prefix(size);
        return static_cast<ssize_t>(size);
    }
    ssize_t write(const char* from, std::size_t size) override {
        sent.append(from, size);
        return static_cast<ssize_t>(size);
    }
    void get_remote_ip_and_port(std::string&, int&) const override {} // nobody asks
    void get_local_ip_and_port(std::string&, int&) const override {}
    /// None: nothing here waits for it.
    [[nodiscard]] socket_t socket() const override { return INVALID_SOCKET; }

    std::string sent;

private:
    std::string_view received_;
};

bool has_body(const httplib::Request& request) {
    const auto [begin, end] = request.headers.equal_range("Content-Length");
    return request.has_header("Transfer-Encoding") || request.has_header("Expect") ||
           std::any_of(begin, end, [](const auto& header) { return header.second != "0"; });
}

Answer body_refusal() {
    return refusal(413, "Nothing here takes a request with a body.");
}

Request request_of(const httplib::Request& from) {
    Request request{.method = from.method,
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

/// A server of the library's for one request: it parses that and writes the head of the reply.
class Exchange : httplib::Server {
public:
    Exchange(const Answerer& answer, const Headers& always) : answer_(answer) {
        set_default_headers({always.begin(), always.end()});
        set_pre_routing_handler([this](const auto& asked, auto& response) {
            give(has_body(asked) ? body_refusal() : ask(request_of(asked)), asked, response);
            return HandlerResponse::Handled;
        });
        set_expect_100_continue_handler([this](const auto& asked, auto& response) {
            give(body_refusal(), asked, response);
            return response.status;
        });
        set_error_handler([this](const auto& asked, auto& response) {
            if (!answered_) // the library's own finding
                give(refusal(response.status, "This is no request that can be answered."), asked,
                     response);
            answered_ = false;
        });
        set_post_routing_handler([this](const auto& asked, auto& response) {
            // The library promises what is its own loop's to keep.
            for (const char* name : {"Keep-Alive", "Connection", "Accept-Ranges"})
                response.headers.erase(name);
            reply_.keeps = answered_ && !closes_ && !has_body(asked) && !reply_.lines;
            if (!reply_.keeps)
                response.set_header("Connection", "close");
        });
    }

    Reply speak(std::string_view request) {
        Bytes bytes(request);
        const auto whole = [](httplib::Request& asked) { asked.ranges.clear(); };
        process_request(bytes, /*close_connection=*/false, closes_, whole);
        reply_.head = body(std::move(bytes.sent));
        return std::move(reply_);
    }

private:
    [[nodiscard]] Answer ask(const Request& request) const {
        try {
            return answer_(request);
        } catch (const std::exception& e) {
            return refusal(500, std::string("This failed: ") + e.what());
        }
    }

    void give(Answer answer, const httplib::Request& asked, httplib::Response& response) {
        answered_ = true;
        response.status = answer.status;
        response.set_header("Cache-Control", answer.caching);
        if (!answer.cookie.empty())
            response.set_header("Set-Cookie", answer.cookie);
        if (!answer.allow.empty())
            response.set_header("Allow", answer.allow);
        if (answer.retry_after_s)
            response.set_header("Retry-After", std::to_string(*answer.retry_after_s));
        if (answer.lines) { // they end with the connection
            response.set_content_provider(answer.type, [](std::size_t, httplib::DataSink& sink) {
                sink.done();
                return true;
            });
        } else { // the body goes its own way
            response.set_header("Content-Type", answer.type);
            response.set_header("Content-Length",
                                std::to_string(answer.body ? answer.body->size() : 0));
        }
        if (asked.method == "HEAD")
            return;
        reply_.body = std::move(answer.body);
        reply_.lines = std::move(answer.lines);
    }

    const Answerer& answer_;
    Reply reply_;
    bool answered_ = false, closes_ = false;
};

/// As if it had been asked for.
Reply said(const Answer& answer, const Headers& always) {
    return exchange(
        "GET / HTTP/1.0\r\n\r\n", [&](const Request&) { return answer; }, always);
}

} // namespace

Reply exchange(std::string_view request, const Answerer& answer, const Headers& always) {
    try {
        return Exchange(answer, always).speak(request);
    } catch (const std::exception&) {
        return {};
    }
}

Refusals refusals(const Limits& limits, const Headers& always) {
    const auto refused = [&](int status, const std::string& reason) {
        Answer answer = refusal(status, reason);
        if (status == 503)
            answer.retry_after_s = 5;
        return said(answer, always);
    };
    return {
        .line_too_long =
            refused(414, "A request's first line has at most " +
                             std::to_string(limits.request_line_bytes_max) + " bytes here."),
        .request_too_large =
            refused(431, "A request and its headers have at most " +
                             std::to_string(limits.request_bytes_max) + " bytes here."),
        .too_late = refused(408, "The request did not come in time: send it at once."),
        .no_room = refused(503, std::to_string(limits.connections_max) +
                                    " requests are being answered already: try again later."),
        .streams_full = refused(503, std::to_string(limits.streams_max) +
                                         " look at this page already: try again later."),
    };
}

} // namespace fraja::http
