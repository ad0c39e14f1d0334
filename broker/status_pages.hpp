// The pages that a broker shows by --http.
#pragma once

#include "broker/board.hpp"
#include "broker/http_server.hpp"

#include <filesystem>

namespace fraja::broker {

/// /metrics and /healthz. `board` must outlive them; `state`, the store's directory, may be empty.
[[nodiscard]] HttpServer::Pages status_pages(const Board& board, std::filesystem::path state);

} // namespace fraja::broker
