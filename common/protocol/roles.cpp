#include "common/protocol/roles.hpp"

#include <array>
#include <variant>

namespace fraja::protocol {
namespace {

constexpr std::array<std::string_view, ValueCount<Role>::value> names = {
    "worker", "submit", "watch", "admin", "broker"};

// PROTOCOL.md has the same as a table, and a test compares the two.
Roles needed(const WorkerHello&) {
    return worker_roles;
}
Roles needed(const WorkerBeat&) {
    return worker_roles;
}
Roles needed(const NeedChunk&) {
    return worker_roles;
}
Roles needed(const TileRendered&) {
    return worker_roles;
}
Roles needed(const TileFailed&) {
    return worker_roles;
}
Roles needed(const ClientHello&) {
    return client_roles;
}
Roles needed(const FindJob&) {
    return client_roles;
}
Roles needed(const Repair&) {
    return client_roles;
}
Roles needed(const SubmitJob&) {
    return {Role::submit, Role::broker};
}
Roles needed(const Chunk&) {
    return {Role::submit, Role::broker};
}
Roles needed(const ControlJob&) {
    return {Role::submit, Role::admin, Role::broker};
}
Roles needed(const ControlWorker&) {
    return {Role::admin, Role::broker};
}
// What only those have to say that stand for this broker.
Roles needed(const BrokerHello&) {
    return {Role::broker};
}
Roles needed(const BrokerBeat&) {
    return {Role::broker};
}
Roles needed(const CompareJobs&) {
    return {Role::broker};
}
Roles needed(const JobDigests&) {
    return {Role::broker};
}
Roles needed(const WantJob&) {
    return {Role::broker};
}
Roles needed(const JobRecord&) {
    return {Role::broker};
}
Roles needed(const JobKept&) {
    return {Role::broker};
}
Roles needed(const JobForgotten&) {
    return {Role::broker};
}
Roles needed(const TileDone&) {
    return {Role::broker};
}
Roles needed(const RepairDone&) {
    return {Role::broker};
}
/// Beat, Goodbye, Refused, and what has no place at a broker: that is said to everybody.
template <class M>
Roles needed(const M&) {
    return {};
}

} // namespace

Roles roles_to_say(const Message& message) {
    return std::visit([](const auto& m) { return needed(m); }, message);
}

std::string_view name_of(Role role) {
    return names.at(static_cast<std::size_t>(role));
}

std::optional<Role> parse_role(std::string_view name) {
    for (std::size_t i = 0; i < names.size(); ++i)
        if (names[i] == name && static_cast<Role>(i) != Role::broker)
            return static_cast<Role>(i);
    return std::nullopt;
}

std::vector<std::string_view> role_names() {
    return {names.begin(), names.end() - 1};
}

std::string alternatives(Roles roles) {
    std::string text;
    for (std::size_t i = 0; i + 1 < names.size(); ++i)
        if (roles.has(static_cast<Role>(i)))
            text += (text.empty() ? "" : " or ") + std::string(names[i]);
    return text.empty() && roles.has(Role::broker) ? std::string(name_of(Role::broker)) : text;
}

} // namespace fraja::protocol
