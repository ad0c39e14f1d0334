// CrewWires: a crew on its wires: what moves for one worker. Who waits for its sockets is its host.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/result.hpp"
#include "common/net/sockets.hpp"
#include "worker/crew.hpp"
#include "worker/pool.hpp"
#include "worker/wire.hpp"

#include <cstddef>
#include <deque>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::worker {

/// Used by one thread, whose loop it never blocks. Slots count the crew's sessions from 0.
class CrewWires {
public:
    using OnLog = Wire::OnLog;

    class Host {
    public:
        Host() = default;
        virtual ~Host() = default;
        Host(const Host&) = delete;
        Host& operator=(const Host&) = delete;

        /// To a broker that was told of, or found; as it was told.
        virtual Result<net::DealerSocket> connect(const std::string& endpoint) = 0;
        virtual void opened(std::size_t slot, const net::Socket& socket) = 0;
        virtual void closed(std::size_t slot) = 0; ///< it is not waited for any more, and still
                                                   ///< says its last words
        virtual void gone(std::size_t wires) = 0;  ///< likewise, and said them
        /// Something was done with the socket: what is there to receive may not show as news.
        virtual void used(std::size_t slot) = 0;
    };

    /// `title`: behind the endpoint in the log, if there is one. What is referred to must outlive
    /// this.
    CrewWires(CrewOptions options, std::string title, const OnLog& on_log, Pool& pool, Host& host);

    /// The line of a session that the crew has had from the start.
    void add_line(std::size_t slot, Line line, const std::string& endpoint);

    void step(CrewEvent event);
    /// As much as there is, but for a flood.
    void receive_some(std::size_t slot);
    /// What has arrived is heard before silence is judged.
    void keep_time(Instant now);
    [[nodiscard]] Instant next_deadline() const;

    [[nodiscard]] const Crew& crew() const { return crew_; }
    /// Nothing is left to do, and all that was sent has left, or has taken too long.
    [[nodiscard]] bool is_over() const { return crew_.finished() && leaving_.empty(); }
    /// That are open.
    [[nodiscard]] std::vector<const net::Socket*> sockets() const;

private:
    void open(std::size_t slot, const std::string& endpoint, std::deque<CrewEvent>& events);
    void close(std::size_t slot);
    void flush(std::size_t slot, std::deque<CrewEvent>& events);
    template <class D>
    void hand_to_pool(SessionIndex session, D deed);
    void perform(CrewAction action, std::deque<CrewEvent>& events);
    void send_again(Instant now);
    void drop_those_that_left(Instant now);
    [[nodiscard]] bool has_somebody_to_greet() const;
    [[nodiscard]] CrewTick tick() const;
    [[nodiscard]] Wire* wire(std::size_t slot) const {
        return slot < wires_.size() ? wires_[slot].get() : nullptr;
    }
    [[nodiscard]] SessionIndex session_of(std::size_t slot) const;
    [[nodiscard]] std::size_t slot_of(SessionIndex session) const;

    const SessionIndex first_;
    const std::string title_;
    Crew crew_;
    const OnLog& on_log_;
    Pool& pool_;
    Host& host_;
    std::vector<std::unique_ptr<Wire>> wires_;   // of its sessions; null where one is over
    std::vector<std::unique_ptr<Wire>> leaving_; // of those that are over, with something to send
    std::vector<CrewAction> actions_;            // of the step that goes on
    std::set<std::size_t> touched_;              // likewise: slots whose wire has something to send
};

} // namespace fraja::worker
