// Dispatcher: who may say what, where there are keys.
#include "broker/dispatcher.hpp"

#include <chrono>
#include <utility>

namespace fraja::broker {

using namespace protocol;

/// Whoever has no key at all has come to a broker without keys, where everybody may do all.
bool Dispatcher::may_say(const PeerSaid& event) {
    const Roles needed = roles_to_say(event.message);
    if (!event.holder || needed.empty() || event.holder->roles.has_any(needed))
        return true;
    const std::string deed(name_of(event.message));
    refuse_role(event.peer, *event.holder, needed, deed);
    return false;
}

/// Counted each time, told in the log once in a while.
void Dispatcher::refuse_role(const PeerId& peer, const KeyHolder& holder, Roles needed,
                             const std::string& deed) {
    ++counters_.not_allowed;
    const std::string whose = holder.name.empty()
                                  ? "a key that is not (any more) in the allow-list of this broker"
                                  : "the key of " + holder.name;
    const std::string reason =
        holder.name.empty()
            ? "this key is not (any more) in the allow-list of the broker"
            : whose + " lacks the role " + alternatives(needed) + ", which " + deed + " needs";
    if (refusals_told_.is_new(now_, holder.key + deed))
        log({.level = LogLevel::warning,
             .kind = "not_allowed",
             .subject = holder.name,
             .text = "refused " + deed + ": " + whose +
                     (holder.name.empty() ? " (" + holder.key + ")"
                                          : " lacks the role " + alternatives(needed))});
    refuse(peer, RefusalCode::not_allowed, reason);
}

/// Whose key has gone, or has lost the role, has no session any more: at once, as a worker might
/// else be given tiles until it speaks again.
void Dispatcher::on(const RolesChanged& event) {
    const auto has_lost = [&](const Holder& holder, Roles needed) {
        if (!holder)
            return false;
        const auto now = event.roles.find(holder->key);
        return now == event.roles.end() || !now->second.has_any(needed);
    };
    std::vector<std::pair<PeerId, Holder>> workers, clients;
    for (const auto& [peer, worker] : workers_)
        if (has_lost(worker.holder, worker_roles))
            workers.emplace_back(peer, worker.holder);
    for (const auto& [peer, client] : clients_)
        if (has_lost(client.holder, client_roles))
            clients.emplace_back(peer, client.holder);
    for (const auto& [peer, holder] : workers) {
        refuse_role(peer, *holder, worker_roles, "a worker's session");
        end_worker(workers_.find(peer), Departure::dismissed, "its key has lost the role worker");
    }
    for (const auto& [peer, holder] : clients) {
        refuse_role(peer, *holder, client_roles, "a client's session");
        end_client(peer, Departure::dismissed);
    }
}

} // namespace fraja::broker
