// Doorman: answers libzmq, which asks at each handshake whether a key may come in (ZAP, RFC 27).
// For sockets.cpp alone.
#pragma once

#include "common/base/once.hpp"
#include "common/net/allow_list.hpp"
#include "common/net/sockets.hpp"

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>
#include <zmq.hpp>

namespace fraja::net {

/// What a socket is for: its ZAP domain.
inline constexpr const char* session_door = "session";
inline constexpr const char* stream_door = "stream";
inline constexpr const char* call_door = "call";

/// A thread of its own, until the context is shut down. Without it libzmq lets in everybody: so it
/// is there before the first socket that needs it.
class Doorman {
public:
    /// Throws zmq::error_t: another one is there.
    Doorman(zmq::context_t& context, AllowList list);
    ~Doorman() = default; // the context is shut down
    Doorman(const Doorman&) = delete;
    Doorman& operator=(const Doorman&) = delete;

    // From any thread:
    void replace(AllowList list);
    [[nodiscard]] std::shared_ptr<const AllowList> list() const;
    /// Of a message that came with that User-Id. Never null: a key that is known to nobody has no
    /// roles, nor has who shows none.
    [[nodiscard]] AllowList::Holder holder(const char* user_id) const;
    [[nodiscard]] std::uint64_t refused_count() const;
    [[nodiscard]] std::vector<Stranger> take_strangers();

private:
    void serve();
    void answer(const std::vector<std::string>& request);
    [[nodiscard]] std::string objection(std::string_view door, const std::string& key) const;
    void note(Stranger stranger);

    zmq::socket_t socket_;
    mutable std::mutex mutex_; // guards what follows
    std::shared_ptr<const AllowList> list_;
    std::uint64_t refused_count_ = 0;
    Once told_;
    std::vector<Stranger> strangers_;
    std::jthread thread_; // ends before they go
};

} // namespace fraja::net
