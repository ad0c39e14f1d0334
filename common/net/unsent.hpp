// Unsent: how many bytes wait for peers that do not take them.
#pragma once

#include "common/base/bytes.hpp"

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>

namespace fraja::net {

/// libzmq bounds the messages that wait for a peer, whatever is in them. The bytes of those that
/// have blobs are counted here, from when they are lent to it until it lets go of them.
class Unsent {
public:
    explicit Unsent(std::uint64_t bytes_max) : bytes_max_(bytes_max) {}

    /// The bytes, counted as long as there is a copy of what is returned. Nothing: too many wait
    /// for that peer already.
    [[nodiscard]] std::optional<Blob> lend(const std::string& peer, Blob packed);

private:
    using Count = std::atomic<std::uint64_t>; // libzmq lets go in threads of its own
    [[nodiscard]] static Blob counted(Blob blob, const std::shared_ptr<Count>& count);
    void forget_idle_peers();

    std::uint64_t bytes_max_;
    std::unordered_map<std::string, std::shared_ptr<Count>> peers_;
    std::size_t peers_before_forgetting_ = 1'000;
};

} // namespace fraja::net
