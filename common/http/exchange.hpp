// One request and its answer as bytes, by cpp-httplib. Nothing here waits for anybody.
#pragma once

#include "common/http/limits.hpp"
#include "common/http/message.hpp"

#include <memory>
#include <string_view>

namespace fraja::http {

/// What is to be sent.
struct Reply {
    Body head = {};                         ///< status line and headers
    Body body = {};                         ///< null: none
    std::shared_ptr<LineSource> lines = {}; ///< after the head, without end
    bool keeps = false;                     ///< the connection, for another request
};

/// The reply to a request: its line and headers, as they were sent. `always` are headers of every
/// reply. What cannot be read is told so (400), an Answerer that throws is 500, and one that has a
/// body is not asked (413): nothing here takes one. Without memory there is no head. Any thread.
[[nodiscard]] Reply exchange(std::string_view request, const Answerer& answer,
                             const Headers& always);

/// The replies for which nobody is asked.
struct Refusals {
    Reply line_too_long, request_too_large, too_late, no_room, streams_full;
};
[[nodiscard]] Refusals refusals(const Limits& limits, const Headers& always);

} // namespace fraja::http
