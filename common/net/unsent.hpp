// Unsent: how many bytes wait for peers that do not take them.
#pragma once

#include "common/protocol/codec.hpp"

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>

namespace fraja::net {

/// libzmq bounds the messages that wait for a peer, whatever is in them. Of blobs their bytes are
/// counted here, from when they are lent to it until it lets go of them.
class Unsent {
public:
    Unsent(std::uint64_t bytes_max, std::uint64_t bytes_of_all_max)
        : bytes_max_(bytes_max), bytes_of_all_max_(bytes_of_all_max) {}

    /// The packet with blobs that are counted as long as there is a copy of them. Nothing: too many
    /// bytes wait for that peer; or for all together, and some of them for this one.
    [[nodiscard]] std::optional<protocol::Packet> lend(const std::string& peer,
                                                       const protocol::Packet& packet);

private:
    using Count = std::atomic<std::uint64_t>; // libzmq lets go in threads of its own
    struct Counts {
        std::shared_ptr<Count> mine, all;
    };
    [[nodiscard]] static Blob counted(const Blob& blob, const Counts& counts);
    void forget_idle_peers();

    std::uint64_t bytes_max_, bytes_of_all_max_;
    std::shared_ptr<Count> all_ = std::make_shared<Count>(0);
    std::unordered_map<std::string, std::shared_ptr<Count>> peers_;
    std::size_t peers_before_forgetting_ = 1'000;
};

} // namespace fraja::net
