// Requests and answers as the programs see them, whatever library speaks HTTP.
#pragma once

#include "common/base/instant.hpp"

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace fraja::http {

struct Request {
    std::string method, path;
    std::map<std::string, std::string> query = {};
    // The headers that say who asks; empty where there is none.
    std::string host = {}, origin = {}, fetch_site = {}, cookies = {};
};

/// Lines for one viewer, without end.
class LineSource {
public:
    virtual ~LineSource() = default;
    /// What is to be sent now: whole lines, or nothing. Called a few times a second, unless the
    /// viewer has not yet taken what it was sent.
    [[nodiscard]] virtual std::string next(Instant now) = 0;
};

/// Not copied: a hundred viewers are sent the same bytes. May be null: empty.
using Body = std::shared_ptr<const std::string>;

struct Answer {
    int status = 200;
    std::string type = "text/plain; charset=utf-8";
    Body body = {};
    std::string caching = "no-store";
    std::string cookie = {};                ///< to be kept by the browser; empty: none
    std::string allow = {};                 ///< of a 405: the methods that are answered
    std::shared_ptr<LineSource> lines = {}; ///< instead of a body; to HEAD they are not sent
    std::optional<int> retry_after_s = {};  ///< of a 503
};

/// Says what is answered. Called by several threads.
using Answerer = std::function<Answer(const Request&)>;

/// Names and values.
using Headers = std::vector<std::pair<std::string, std::string>>;

[[nodiscard]] inline Body body(std::string text) {
    return std::make_shared<const std::string>(std::move(text));
}
/// For a person to read.
[[nodiscard]] inline Answer refusal(int status, std::string reason) {
    return {.status = status, .body = body(std::move(reason) + "\n")};
}

} // namespace fraja::http
