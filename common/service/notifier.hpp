// Notifier: tells systemd that a service is ready, alive or stopping.
#pragma once

#include "common/base/instant.hpp"

#include <optional>
#include <string>
#include <string_view>

namespace fraja::service {

/// Speaks the protocol of sd_notify(3), one datagram for each word: it is stable, and libsystemd
/// would load six libraries into each program for it. Without a service manager ($NOTIFY_SOCKET)
/// everything here does nothing. Never waits: a word that cannot be sent at once is lost.
class Notifier {
public:
    /// From $NOTIFY_SOCKET, $WATCHDOG_USEC and $WATCHDOG_PID.
    Notifier();
    ~Notifier();
    Notifier(const Notifier&) = delete;
    Notifier& operator=(const Notifier&) = delete;

    /// `status`: a line for people, as `systemctl status` shows it.
    void ready(std::string_view status) const;
    void status(std::string_view status) const;
    void stopping(std::string_view status) const;
    /// To be called about once a second by the loop without which the service is of no use: said as
    /// often as the watchdog wants to hear it, if there is one.
    void alive(Instant now);

private:
    void send(const std::string& words) const;

    int fd_ = -1;
    std::optional<Duration> alive_interval_; ///< nothing: there is no watchdog
    Instant alive_at_{};                     ///< said last
};

} // namespace fraja::service
