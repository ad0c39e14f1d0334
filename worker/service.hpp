// Service: a worker's process from its start to its end. It serves in its hours, until it is told
// to leave or has served enough, and tells whoever runs it how it is.
#pragma once

#include "common/base/result.hpp"
#include "common/net/signals.hpp"
#include "common/net/sockets.hpp"
#include "common/service/log_options.hpp"
#include "common/service/logger.hpp"
#include "common/service/notifier.hpp"
#include "worker/duty.hpp"
#include "worker/shell.hpp"

#include <atomic>
#include <optional>
#include <string>

namespace fraja::worker {

struct ServiceOptions {
    std::string program;           ///< opens every line of the log
    WorkerOptions worker;          ///< its callbacks are the service's
    std::optional<net::Keys> keys; ///< nothing: it has none
    DutyTerms duty;
    std::optional<Hours> hours; ///< nothing: all day
    service::LogOptions log;
    std::string isa;                  ///< what it renders with, for people
    std::string threads_because = {}; ///< why they are fewer than the machine has; empty: no reason
    std::string warning = {};         ///< said with its first words; empty: none
    std::string alive_file = {}; ///< written anew about every second, as long as the loop turns
    const net::SignalWatch* hangups =
        nullptr; ///< at which the allow-list is read again; null: none
};

class Service {
public:
    /// The first of these signals has it finish the tiles at hand, the second hand them back.
    Service(ServiceOptions options, const net::SignalWatch& signals);

    /// Until it has served enough, or is told to leave. The exit code: 0, 4 (a broker of another
    /// version), 75 (start it again), 128 + the signal that it handed back at. Errors: those of
    /// run_worker().
    [[nodiscard]] Result<int> run();

private:
    void open();
    void tell(const std::string& text);
    [[nodiscard]] bool on_duty() const;
    [[nodiscard]] bool show_life() const;
    void look_at(const Load& load);
    void leave(const std::string& why);
    bool wait_for_hours();
    Result<FinishReason> serve();
    void take_signals();
    void read_allow_list_again();

    ServiceOptions options_;
    const net::SignalWatch& signals_;
    const std::string opening_;
    bool opened_ = false; ///< and said so
    service::Logger logger_;
    service::Notifier notifier_;
    const net::Context context_;
    Duty duty_;                      ///< of the worker that serves now
    std::optional<Control> control_; ///< likewise
    bool is_ready_ = false;
    std::atomic<bool> leaving_ = false;
    Duty::Verdict verdict_ = Duty::Verdict::go_on;
    Reception reception_ = Reception::nobody; // when it was left
    std::atomic<int> signal_count_ = 0;
    int last_signal_ = 0;
};

} // namespace fraja::worker
