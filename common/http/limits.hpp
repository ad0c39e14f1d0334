// What a server bears of those who connect.
#pragma once

#include "common/base/instant.hpp"

#include <chrono>
#include <cstddef>

namespace fraja::http {

struct Limits {
    std::size_t threads = 4; ///< that answer
    /// Beyond, whoever the server waits for is given up for who comes; if it waits for nobody, who
    /// comes is told 503.
    std::size_t connections_max = 32;
    std::size_t streams_max = 0;               ///< of the connections; beyond, 503
    std::size_t request_line_bytes_max = 4096; ///< beyond, 414
    std::size_t request_bytes_max = 8192;      ///< line and headers; beyond, 431
    Duration request_time_max =
        std::chrono::seconds(5); ///< from a request's first byte to its last; beyond, 408
    Duration idle_max = std::chrono::seconds(60); ///< between requests
    /// For the other end to take some of what it is sent, or to close when it has all.
    Duration patience = std::chrono::seconds(5);
    Duration look_pause = std::chrono::milliseconds(250); ///< of lines without end
};

} // namespace fraja::http
