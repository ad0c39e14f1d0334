#include "common/discovery/srv_lookup.hpp"

#include <algorithm>
#include <ares.h>
#include <arpa/nameser.h>
#include <array>
#include <memory>
#include <netdb.h>
#include <optional>
#include <poll.h>
#include <sys/time.h>
#include <utility>

namespace fraja::discovery {
namespace {

using Channel = std::unique_ptr<ares_channeldata, decltype(&ares_destroy)>;
using Answer = std::optional<Result<std::vector<SrvRecord>>>;

Error error_of(int status) {
    switch (status) {
    case ARES_ENOTFOUND:
        return {ErrorCode::not_found, "the DNS knows no such name"};
    case ARES_ENODATA:
        return {ErrorCode::not_found, "the name has no SRV records"};
    case ARES_ETIMEOUT:
        return {ErrorCode::unreachable, "no DNS server answers"};
    case ARES_ECONNREFUSED:
        // After a server that fails the next one is asked, and this is said of the last.
        return {ErrorCode::unreachable, "the DNS servers cannot be reached, or fail"};
    case ARES_EBADRESP:
        return {ErrorCode::malformed_frame, "the DNS server's answer cannot be read"};
    default:
        return {ErrorCode::io, std::string("DNS: ") + ares_strerror(status)};
    }
}

/// Once in a process: not safe among threads in this version of the library.
int library_status() {
    static const int status = ares_library_init(ARES_LIB_INIT_ALL);
    return status;
}

Result<Channel> open_channel(const DnsOptions& options) {
    if (const int status = library_status(); status != ARES_SUCCESS)
        return error_of(status);
    ares_options wanted{};
    wanted.timeout = static_cast<int>(
        std::chrono::duration_cast<std::chrono::milliseconds>(options.timeout).count());
    wanted.tries = options.tries;
    ares_channel made = nullptr;
    if (const int status = ares_init_options(&made, &wanted, ARES_OPT_TIMEOUTMS | ARES_OPT_TRIES);
        status != ARES_SUCCESS)
        return error_of(status);
    Channel channel(made, ares_destroy);
    if (!options.servers.empty())
        if (const int status = ares_set_servers_ports_csv(made, options.servers.c_str());
            status != ARES_SUCCESS)
            return error_of(status);
    return channel;
}

void take_answer(void* where, int status, int, unsigned char* bytes, int size) {
    Answer& answer = *static_cast<Answer*>(where);
    if (status != ARES_SUCCESS)
        answer = error_of(status);
    else
        answer = parse_srv_answer(
            std::as_bytes(std::span(bytes, static_cast<std::size_t>(std::max(size, 0)))));
}

/// Until one of the channel's sockets has something, a server has been silent for too long, or the
/// waker is woken.
void serve(ares_channel channel, const net::Waker* waker) {
    std::array<ares_socket_t, ARES_GETSOCK_MAXNUM> sockets{};
    const auto bits = static_cast<unsigned>(
        ares_getsock(channel, sockets.data(), static_cast<int>(sockets.size())));
    std::array<pollfd, ARES_GETSOCK_MAXNUM + 1> entries{};
    std::size_t count = 0;
    for (unsigned i = 0; i < sockets.size(); ++i) {
        const bool reads = ARES_GETSOCK_READABLE(bits, i), writes = ARES_GETSOCK_WRITABLE(bits, i);
        if (reads || writes)
            entries[count++] = {
                sockets[i], static_cast<short>((reads ? POLLIN : 0) | (writes ? POLLOUT : 0)), 0};
    }
    const std::size_t socket_count = count;
    entries[count++] = {waker ? waker->fd() : -1, POLLIN, 0};
    timeval longest{.tv_sec = 1, .tv_usec = 0}, left{};
    ares_timeout(channel, &longest, &left);
    (void)::poll(entries.data(), count,
                 static_cast<int>(left.tv_sec * 1000 + left.tv_usec / 1000) + 1);
    if (entries[socket_count].revents != 0)
        waker->drain();
    bool any = false;
    for (std::size_t i = 0; i < socket_count; ++i) {
        const short seen = entries[i].revents;
        if (seen == 0)
            continue;
        any = true;
        const bool failed = (seen & (POLLERR | POLLHUP | POLLNVAL)) != 0;
        ares_process_fd(channel, failed || (seen & POLLIN) ? entries[i].fd : ARES_SOCKET_BAD,
                        failed || (seen & POLLOUT) ? entries[i].fd : ARES_SOCKET_BAD);
    }
    if (!any)
        ares_process_fd(channel, ARES_SOCKET_BAD, ARES_SOCKET_BAD); // who is silent for too long
}

} // namespace

Result<std::vector<SrvRecord>> look_up_srv(const std::string& name, const DnsOptions& options,
                                           const net::Interrupt& interrupt) {
    Answer answer; // outlives the channel, whose end answers what is still open
    const auto channel = open_channel(options);
    if (!channel)
        return channel.error();
    ares_query(channel->get(), name.c_str(), ns_c_in, ns_t_srv, take_answer, &answer);
    while (!answer) {
        if (interrupt.stop.stop_requested())
            return Error{ErrorCode::cancelled, "stopped"};
        serve(channel->get(), interrupt.waker);
    }
    return *std::move(answer);
}

} // namespace fraja::discovery
