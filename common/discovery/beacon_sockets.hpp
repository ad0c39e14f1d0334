// The UDP sockets of beacons, and the networks that they reach: the only code with these.
//
// Beacons stay on the link: they go to each interface's broadcast address, and with a hop limit of
// 1 to a multicast group of IPv4 and one of IPv6.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/result.hpp"
#include "common/discovery/beacon.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace fraja::discovery {

inline constexpr const char* beacon_group = "239.255.70.82"; ///< local scope (RFC 2365)
inline constexpr const char* beacon_group6 =
    "ff12::4652:414a"; ///< link-local, transient (RFC 4291)
/// Of a machine with more of them, the others are passed over.
inline constexpr std::size_t interfaces_max = 64;

struct BeaconWays {
    bool broadcast = true, multicast = true;
    bool ipv4 = true, ipv6 = true;
    friend bool operator==(const BeaconWays&, const BeaconWays&) = default;
};

/// Owns a descriptor.
class Descriptor {
public:
    explicit Descriptor(int fd = -1) : fd_(fd) {}
    ~Descriptor();
    Descriptor(Descriptor&& other) noexcept;
    Descriptor& operator=(Descriptor&& other) noexcept;
    [[nodiscard]] int fd() const { return fd_; } ///< -1: none

private:
    int fd_;
};

class BeaconSender {
public:
    /// Errors: io, when no socket can be had.
    [[nodiscard]] static Result<BeaconSender> open(const BeaconWays& ways);
    /// To all who can be reached that way now: interfaces come and go. Returns how many datagrams
    /// have left.
    [[nodiscard]] std::size_t send(std::span<const std::byte> bytes) const;

private:
    BeaconSender(BeaconWays ways, Descriptor ipv4, Descriptor ipv6);
    BeaconWays ways_;
    Descriptor ipv4_, ipv6_;
};

struct Datagram {
    Bytes bytes;        ///< at most beacon_bytes + 1: enough to see that it is too long
    std::string sender; ///< as Endpoint's host
};

class BeaconReceiver {
public:
    /// Hears beacons, beside others of this machine that do. Errors: io, in_use (the port is
    /// somebody's who does not share it).
    [[nodiscard]] static Result<BeaconReceiver> open();
    /// Hears those of interfaces that have come since, too.
    void join_groups() const;
    /// The next one that is here. What was sent to this machine alone is dropped: so it comes from
    /// this link, and not from afar.
    [[nodiscard]] std::optional<Datagram> receive() const;
    /// Readable when that may bring something; -1: there is none of that family.
    [[nodiscard]] int fd() const { return ipv4_.fd(); }
    [[nodiscard]] int fd6() const { return ipv6_.fd(); }

private:
    BeaconReceiver(Descriptor ipv4, Descriptor ipv6);
    Descriptor ipv4_, ipv6_;
};

} // namespace fraja::discovery
