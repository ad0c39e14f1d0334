// Routes: what the live page answers to which request.
#pragma once

#include "client/exit_code.hpp"
#include "client/page/door.hpp"
#include "client/page/farm_board.hpp"
#include "common/http/limits.hpp"
#include "common/http/message.hpp"

#include <functional>
#include <optional>
#include <string_view>

namespace fraja::client {

/// Headers of every answer: nothing but this page's own files, no script or style within them, and
/// no other page around it.
[[nodiscard]] http::Headers page_headers();

/// 128 may look at a time. A request that encodes a picture, or waits for the broker to do with a
/// job what is wanted, has a thread meanwhile.
inline constexpr http::Limits page_limits{
    .threads = 16, .connections_max = 256, .streams_max = 128};

/// Does something with a job, and says how it went. Any thread.
using Control = std::function<Outcome(const JobId&, protocol::JobDeed)>;

///     GET  /  /page.css  /page.js ...       the page's files (assets.hpp)
///     GET  /events[?job=ID]                 lines of JSON, without end
///     GET  /job/ID/picture.jpg?rev=N        an overview at revision N, or the newest;
///          /job/ID/picture.png?rev=N        all pixels, exactly;
///          /job/ID/cost.png?rev=N           one pixel for each cell,
///          /job/ID/workers.png?rev=N        likewise
///     GET  /job/ID/part.jpg?rect=X,Y,W,H    the pixels of a part
///     POST /job/ID/pause, resume, cancel    where control is allowed
class Routes {
public:
    /// Without `control` nothing can be changed.
    Routes(Door door, FarmBoard& board, JobViews& views, Control control);

    /// Any thread.
    [[nodiscard]] http::Answer answer(const http::Request& request) const;

private:
    [[nodiscard]] http::Answer events(const http::Request& request) const;
    [[nodiscard]] http::Answer picture(const http::Request& request, const JobId& job,
                                       std::string_view what) const;
    [[nodiscard]] http::Answer do_with(const JobId& job, std::string_view deed) const;

    Door door_;
    FarmBoard& board_;
    JobViews& views_;
    Control control_;
};

} // namespace fraja::client
