// The pages that a broker shows by --http.
#pragma once

#include "broker/board.hpp"
#include "common/http/address.hpp"
#include "common/http/server.hpp"

#include <filesystem>
#include <string_view>

namespace fraja::broker {

/// "ADDR:PORT"; what other machines can reach is refused as net::endpoint_to_bind() does.
[[nodiscard]] Result<http::Address> status_address(std::string_view text, bool insecure);

/// Answers GET and HEAD for /metrics and /healthz; 404 for other paths, 405 for other methods.
/// `board` must outlive it; `state`, the store's directory, may be empty.
[[nodiscard]] http::Answerer status_pages(const Board& board, std::filesystem::path state);

} // namespace fraja::broker
