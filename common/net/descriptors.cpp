#include "common/net/descriptors.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <string>
#include <sys/resource.h>

namespace fraja::net {
namespace {

constexpr rlim_t per_socket = 2; ///< its mailbox and its connection
constexpr rlim_t others = 100;   ///< ZeroMQ's own, log, libraries, wakers

} // namespace

Result<void> reserve_descriptors(std::size_t sockets) {
    const rlim_t needed = sockets * per_socket + others;
    rlimit limit{};
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= needed)
        return {};
    const rlim_t hard = limit.rlim_max;
    limit.rlim_cur = needed;
    if (needed <= hard && setrlimit(RLIMIT_NOFILE, &limit) == 0)
        return {};
    return Error{ErrorCode::limit_exceeded, "for " + counted(sockets, "socket") +
                                                " this process needs " + std::to_string(needed) +
                                                " file descriptors, and it may have " +
                                                std::to_string(hard) + " (ulimit -Hn)"};
}

std::size_t reserve_connections(std::size_t wanted) {
    const rlim_t needed = wanted + others;
    rlimit limit{};
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0)
        return wanted; // nobody counts
    const rlim_t soft = limit.rlim_cur;
    if (soft < needed) {
        limit.rlim_cur = std::min(needed, limit.rlim_max);
        if (setrlimit(RLIMIT_NOFILE, &limit) != 0)
            limit.rlim_cur = soft;
    }
    return limit.rlim_cur <= others ? 0 : std::min<std::size_t>(wanted, limit.rlim_cur - others);
}

} // namespace fraja::net
