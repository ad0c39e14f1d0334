// Upstream: the brokers above, which this one serves as a worker while it has workers itself: one,
// or several that stand for each other.
#pragma once

#include "broker/branch.hpp"
#include "broker/events.hpp"
#include "common/net/sockets.hpp"
#include "worker/crew_wires.hpp"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace fraja::broker {

struct UpstreamOptions {
    std::vector<std::string> brokers; ///< endpoints as sockets take them; empty: there is none
    std::string name;                 ///< for people
    std::vector<std::string> tags;    ///< `K` or `K=V`
};

class Upstream final : worker::CrewWires::Host {
public:
    using OnLog = std::function<void(const LogLine&)>;

    /// `progress`: as for Branch. Whatever is given must outlive this.
    Upstream(const net::Context& context, const UpstreamOptions& options,
             std::function<std::vector<OrderProgress>()> progress, const OnLog& on_log);

    /// Speaks to them: greets them when there is a first thread here, leaves them when there is
    /// none, and returns what they want of the dispatcher. Call it until they want nothing more.
    [[nodiscard]] std::vector<Event> serve(Instant now, std::uint64_t threads);
    void take(const OrderFilled& filled) { branch_->take(filled, threads_); }
    void take(const OrderFailed& failed) { branch_->take(failed); }
    /// Hands back what is here and says Goodbye; waits for that to leave, but not for long.
    void leave();

    /// Of those that there is a connection to.
    [[nodiscard]] std::vector<const net::Socket*> sockets() const;
    [[nodiscard]] Instant next_deadline() const;

private:
    Result<net::DealerSocket> connect(const std::string& endpoint) override;
    void opened(std::size_t, const net::Socket&) override {}
    void closed(std::size_t) override {}
    void gone(std::size_t) override {}
    void used(std::size_t) override {}

    void begin(Instant now);
    void hand_out_results();
    void let_go_if_over();

    const net::Context& context_;
    const UpstreamOptions& options_;
    std::function<std::vector<OrderProgress>()> progress_;
    worker::CrewWires::OnLog on_log_;
    std::unique_ptr<Branch> branch_; ///< of these:
    std::unique_ptr<worker::CrewWires> wires_;
    std::uint64_t threads_ = 0;
    bool leaving_ = false; ///< them
    bool done_ = false;    ///< nobody wants us
    Instant again_at_{};   ///< not before
};

} // namespace fraja::broker
