// HttpStream: a connection that has an end: so many bytes of a request, so much time for all of it.
#pragma once

#include "common/base/instant.hpp"

#include <array>
#include <cstddef>
#include <httplib.h>
#include <string>

namespace fraja::broker {

/// Does not own the socket. After the deadline, or once `stop_fd` is readable, nothing can be read
/// or written.
class HttpStream : public httplib::Stream {
public:
    HttpStream(socket_t socket, int stop_fd, Instant deadline, std::size_t read_bytes_max)
        : socket_(socket), stop_fd_(stop_fd), deadline_(deadline), left_bytes_(read_bytes_max) {}

    [[nodiscard]] bool is_readable() const override;
    [[nodiscard]] bool is_writable() const override;
    ssize_t read(char* ptr, std::size_t size) override;
    ssize_t write(const char* ptr, std::size_t size) override;
    void get_remote_ip_and_port(std::string&, int&) const override {} // nobody asks
    void get_local_ip_and_port(std::string&, int&) const override {}
    [[nodiscard]] socket_t socket() const override { return socket_; }

    /// Says that nothing more is sent, and waits for the other end to close as well: what it is
    /// still sending would otherwise reset the connection, and it might not see its answer.
    void finish();

private:
    [[nodiscard]] bool wait_for(short events) const;

    socket_t socket_;
    int stop_fd_;
    Instant deadline_;
    std::size_t left_bytes_; ///< that may still be read
    std::array<char, 2048> buffer_{};
    std::size_t begin_ = 0, end_ = 0; ///< of what has been received and not read
};

} // namespace fraja::broker
