// RollCall: all brokers that are named, and those that they tell of, asked for their farms at the
// same time.
#pragma once

#include "client/notices.hpp"
#include "client/session.hpp"
#include "client/shell.hpp"
#include "client/table.hpp"

#include <list>
#include <optional>
#include <string>
#include <vector>

namespace fraja::client {

/// Once one has answered, the others have so long. Before, each has its --connect-timeout.
inline constexpr Duration roll_call_patience = std::chrono::milliseconds(1500);

class RollCall {
public:
    /// `named`: endpoints, or sources (common/discovery) that have none now; at least one.
    /// `session`: whose brokers do not count. `context` must outlive this.
    RollCall(const net::Context& context, const std::vector<std::string>& named,
             SessionOptions session, SearchNotice notice);
    /// Waits for names that are being looked up.
    ~RollCall();
    RollCall(const RollCall&) = delete;
    RollCall& operator=(const RollCall&) = delete;

    /// Until nobody is waited for any more. Done where at least one has answered. `signals` may be
    /// null.
    [[nodiscard]] Outcome hold(const net::SignalWatch* signals);
    /// Each once, in the order in which it was named or told of.
    [[nodiscard]] std::vector<AskedBroker> brokers() const;

private:
    class Guest;

    void ask(const std::string& endpoint);
    void ask_those_told_of();
    void settle(Guest& guest);
    [[nodiscard]] bool turn();
    void wait(const net::SignalWatch* signals) const;
    [[nodiscard]] Outcome outcome() const;
    [[nodiscard]] std::string trouble_of(const Guest& guest) const;

    const net::Context& context_;
    SessionOptions session_;
    SearchNotice notice_;
    std::list<Guest> guests_; // which stay where they are
    Instant notice_due_{};
    Instant answered_at_ = Instant::never(); ///< by the first
};

/// A broker that answers at several endpoints is there once, at the first; none of those where it
/// does not is told then.
[[nodiscard]] std::vector<AskedBroker> each_once(std::vector<AskedBroker> asked);

} // namespace fraja::client
