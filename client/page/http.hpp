// Requests and answers as the live page sees them, whatever library speaks HTTP.
#pragma once

#include "common/base/instant.hpp"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>

namespace fraja::client {

struct HttpRequest {
    std::string method, path;
    std::map<std::string, std::string> query = {};
    // The headers that say who asks; empty where there is none.
    std::string host = {}, origin = {}, fetch_site = {}, cookies = {};
};

/// Lines for one viewer, without end.
class LineSource {
public:
    virtual ~LineSource() = default;
    /// What is to be sent now: whole lines, or nothing. Called a few times a second.
    [[nodiscard]] virtual std::string next(Instant now) = 0;
};

using HttpBody = std::shared_ptr<const std::string>;

struct HttpAnswer {
    int status = 200;
    std::string type = "text/plain; charset=utf-8";
    HttpBody body = {};
    std::string caching = "no-store";
    std::string cookie = {};                ///< to be kept by the browser; empty: none
    std::shared_ptr<LineSource> lines = {}; ///< instead of a body
    std::optional<int> retry_after_s = {};  ///< of a 503
};

[[nodiscard]] inline HttpBody http_body(std::string text) {
    return std::make_shared<const std::string>(std::move(text));
}
/// For a person to read.
[[nodiscard]] inline HttpAnswer http_refusal(int status, std::string reason) {
    return {.status = status, .body = http_body(std::move(reason) + "\n")};
}

} // namespace fraja::client
