// Upstream: the broker above, which this one serves as a worker while it has workers itself.
#pragma once

#include "broker/branch.hpp"
#include "broker/events.hpp"
#include "common/net/sockets.hpp"
#include "worker/link.hpp"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace fraja::broker {

struct UpstreamOptions {
    std::string broker;            ///< endpoint as sockets take it; empty: there is none
    std::string name;              ///< for people
    std::vector<std::string> tags; ///< `K` or `K=V`
};

class Upstream {
public:
    using OnLog = std::function<void(const LogLine&)>;

    /// `progress`: as for Branch. Whatever is given must outlive this.
    Upstream(const net::Context& context, const UpstreamOptions& options,
             std::function<std::vector<OrderProgress>()> progress, const OnLog& on_log);

    /// Speaks to it: greets it when there is a first thread here, leaves it when there is none, and
    /// returns what it wants of the dispatcher. Call it until it wants nothing more.
    [[nodiscard]] std::vector<Event> serve(Instant now, std::uint64_t threads);
    void take(const OrderFilled& filled) { branch_->take(filled, threads_); }
    void take(const OrderFailed& failed) { branch_->take(failed); }
    /// Hands back what is here and says Goodbye; waits for that to leave, but not for long.
    void leave();

    /// Null while there is no connection.
    [[nodiscard]] const net::Socket* socket() const { return link_ ? &link_->socket() : nullptr; }
    [[nodiscard]] Instant next_deadline() const;

private:
    void connect(Instant now);
    void let_go_if_over(Instant now);

    const net::Context& context_;
    const UpstreamOptions& options_;
    std::function<std::vector<OrderProgress>()> progress_;
    worker::Link::OnLog on_log_;
    std::unique_ptr<Branch> branch_; ///< of the link
    std::unique_ptr<worker::Link> link_;
    std::uint64_t threads_ = 0;
    bool leaving_ = false; ///< the link
    bool done_ = false;    ///< it does not want us
    Instant again_at_{};   ///< not before
};

} // namespace fraja::broker
