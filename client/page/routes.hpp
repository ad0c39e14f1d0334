// Routes: what the live page answers to which request.
#pragma once

#include "client/exit_code.hpp"
#include "client/page/door.hpp"
#include "client/page/farm_board.hpp"
#include "client/page/http.hpp"

#include <functional>
#include <optional>
#include <string_view>

namespace fraja::client {

/// The header Content-Security-Policy of every answer: nothing but this page's own files, no script
/// or style within them, and no other page around it.
inline constexpr const char* content_security_policy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

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
    [[nodiscard]] HttpAnswer answer(const HttpRequest& request) const;

private:
    [[nodiscard]] HttpAnswer events(const HttpRequest& request) const;
    [[nodiscard]] HttpAnswer picture(const HttpRequest& request, const JobId& job,
                                     std::string_view what) const;
    [[nodiscard]] HttpAnswer do_with(const JobId& job, std::string_view deed) const;

    Door door_;
    FarmBoard& board_;
    JobViews& views_;
    Control control_;
};

} // namespace fraja::client
