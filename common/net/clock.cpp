#include "common/net/clock.hpp"

#include <chrono>

namespace fraja::net {

Instant now() {
    return {
        std::chrono::duration_cast<Duration>(std::chrono::steady_clock::now().time_since_epoch())};
}

} // namespace fraja::net
