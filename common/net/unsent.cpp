#include "common/net/unsent.hpp"

#include <algorithm>
#include <utility>

namespace fraja::net {

std::optional<Blob> Unsent::lend(const std::string& peer, Blob packed) {
    std::shared_ptr<Count>& mine = peers_[peer];
    if (!mine)
        mine = std::make_shared<Count>(0);
    const std::uint64_t waiting = *mine;
    if (waiting > 0 && waiting + packed.size() > bytes_max_)
        return std::nullopt;
    Blob lent = counted(std::move(packed), mine);
    forget_idle_peers();
    return lent;
}

Blob Unsent::counted(Blob blob, const std::shared_ptr<Count>& count) {
    *count += blob.size();
    const auto end = [count](const Blob* lent) {
        *count -= lent->size();
        delete lent;
    };
    const std::shared_ptr<const Blob> owner(new Blob(std::move(blob)), end);
    return {owner, *owner};
}

void Unsent::forget_idle_peers() {
    if (peers_.size() < peers_before_forgetting_)
        return;
    std::erase_if(peers_, [](const auto& peer) { return *peer.second == 0; });
    peers_before_forgetting_ = std::max<std::size_t>(1'000, 2 * peers_.size());
}

} // namespace fraja::net
