#include "common/net/unsent.hpp"

#include <algorithm>
#include <utility>

namespace fraja::net {

std::optional<protocol::Packet> Unsent::lend(const std::string& peer,
                                             const protocol::Packet& packet) {
    const std::uint64_t bytes = byte_count(packet.blobs);
    std::shared_ptr<Count>& mine = peers_[peer];
    if (!mine)
        mine = std::make_shared<Count>(0);
    const std::uint64_t waiting = *mine;
    if (waiting > 0 && waiting + bytes > bytes_max_)
        return std::nullopt;
    protocol::Packet lent{packet.header, packet.body, {}};
    for (const Blob& blob : packet.blobs)
        lent.blobs.push_back(counted(blob, mine));
    forget_idle_peers();
    return lent;
}

Blob Unsent::counted(const Blob& blob, const std::shared_ptr<Count>& count) {
    *count += blob.size();
    const auto end = [count](const Blob* lent) {
        *count -= lent->size();
        delete lent;
    };
    return {std::shared_ptr<const Blob>(new Blob(blob), end), blob};
}

void Unsent::forget_idle_peers() {
    if (peers_.size() < peers_before_forgetting_)
        return;
    std::erase_if(peers_, [](const auto& peer) { return *peer.second == 0; });
    peers_before_forgetting_ = std::max<std::size_t>(1'000, 2 * peers_.size());
}

} // namespace fraja::net
