#include "broker/drawer.hpp"

#include "common/protocol/content_hash.hpp"

#include <algorithm>
#include <cstddef>
#include <span>

namespace fraja::broker {
namespace {

// RFC 9562: where a UUID has its version, and its variant. Random ids have version 4.
constexpr std::size_t version_byte = 6, variant_byte = 8;
constexpr std::uint8_t version_of_keys = 0x80;

} // namespace

WorkerId drawer_of(const WorkerId& worker, const Holder& holder) {
    if (!holder || holder->is_shared)
        return worker;
    const ContentHash hash = protocol::content_hash(std::as_bytes(std::span(holder->key)));
    WorkerId id;
    std::ranges::copy_n(hash.bytes.begin(), id.bytes.size(), id.bytes.begin());
    id.bytes[version_byte] =
        static_cast<std::uint8_t>((id.bytes[version_byte] & 0x0f) | version_of_keys);
    id.bytes[variant_byte] = static_cast<std::uint8_t>((id.bytes[variant_byte] & 0x3f) | 0x80);
    return id;
}

std::string voter_of(const WorkerId& drawer, const std::string& worker_name) {
    return (drawer.bytes[version_byte] & 0xf0) == version_of_keys ? to_string(drawer) : worker_name;
}

} // namespace fraja::broker
