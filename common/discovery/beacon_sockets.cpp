#include "common/discovery/beacon_sockets.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <ifaddrs.h>
#include <memory>
#include <net/if.h>
#include <netinet/in.h>
#include <string_view>
#include <sys/socket.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace fraja::discovery {
namespace {

/// An address of an interface of this machine's that is up and leads out of it.
struct Way {
    int interface = 0;
    bool is_ipv6 = false;
    bool multicast = false;
    in_addr address{};                     // of IPv4
    std::optional<in_addr> broadcast = {}; // likewise
};

sockaddr_in as_ipv4(const sockaddr* address) {
    sockaddr_in read{};
    std::memcpy(&read, address, sizeof read);
    return read;
}

std::vector<Way> ways_out() {
    ifaddrs* list = nullptr;
    if (::getifaddrs(&list) != 0)
        return {};
    const std::unique_ptr<ifaddrs, decltype(&::freeifaddrs)> owner(list, ::freeifaddrs);
    std::vector<Way> ways;
    for (const ifaddrs* at = list; at && ways.size() < interfaces_max; at = at->ifa_next) {
        if (!at->ifa_addr || (at->ifa_flags & IFF_UP) == 0 || (at->ifa_flags & IFF_LOOPBACK) != 0)
            continue;
        Way way{.interface = static_cast<int>(::if_nametoindex(at->ifa_name)),
                .is_ipv6 = at->ifa_addr->sa_family == AF_INET6,
                .multicast = (at->ifa_flags & IFF_MULTICAST) != 0};
        if (at->ifa_addr->sa_family == AF_INET) {
            way.address = as_ipv4(at->ifa_addr).sin_addr;
            if ((at->ifa_flags & IFF_BROADCAST) != 0 && at->ifa_broadaddr)
                way.broadcast = as_ipv4(at->ifa_broadaddr).sin_addr;
        } else if (!way.is_ipv6) {
            continue;
        }
        const bool is_known = std::ranges::any_of(ways, [&](const Way& w) { // of IPv6: by another
            return w.is_ipv6 && way.is_ipv6 && w.interface == way.interface;
        });
        if (way.interface != 0 && !is_known)
            ways.push_back(way);
    }
    return ways;
}

in_addr group() {
    in_addr address{};
    ::inet_pton(AF_INET, beacon_group, &address);
    return address;
}

in6_addr group6() {
    in6_addr address{};
    ::inet_pton(AF_INET6, beacon_group6, &address);
    return address;
}

Descriptor open_socket(int family) {
    return Descriptor(::socket(family, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
}

template <class T>
bool set_option(const Descriptor& socket, int level, int name, const T& value) {
    return ::setsockopt(socket.fd(), level, name, &value, sizeof value) == 0;
}

Error failed(const std::string& what) {
    const auto code = errno == EADDRINUSE ? ErrorCode::in_use : ErrorCode::io;
    return {code, what + ": " + std::error_code(errno, std::generic_category()).message()};
}

/// With data of control of type T.
template <class T>
struct Control {
    alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(T))> bytes{};

    void attach(msghdr& message) {
        message.msg_control = bytes.data();
        message.msg_controllen = bytes.size();
    }
};

template <class To, class Info>
bool send_one(const Descriptor& socket, std::span<const std::byte> bytes, To to, int level,
              int type, const Info& info) {
    iovec part{const_cast<std::byte*>(bytes.data()), bytes.size()}; // is read alone
    msghdr message{};
    message.msg_name = &to;
    message.msg_namelen = sizeof to;
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    Control<Info> control;
    control.attach(message);
    cmsghdr* const header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = level;
    header->cmsg_type = type;
    header->cmsg_len = CMSG_LEN(sizeof info);
    std::memcpy(CMSG_DATA(header), &info, sizeof info);
    return ::sendmsg(socket.fd(), &message, 0) == static_cast<ssize_t>(bytes.size());
}

/// From that interface's own address, whatever the routes are.
bool send_ipv4(const Descriptor& socket, std::span<const std::byte> bytes, const Way& way,
               in_addr to_address) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(beacon_port);
    to.sin_addr = to_address;
    in_pktinfo info{};
    info.ipi_ifindex = way.interface;
    info.ipi_spec_dst = way.address;
    return send_one(socket, bytes, to, IPPROTO_IP, IP_PKTINFO, info);
}

bool send_ipv6(const Descriptor& socket, std::span<const std::byte> bytes, const Way& way) {
    sockaddr_in6 to{};
    to.sin6_family = AF_INET6;
    to.sin6_port = htons(beacon_port);
    to.sin6_addr = group6();
    to.sin6_scope_id = static_cast<std::uint32_t>(way.interface);
    in6_pktinfo info{};
    info.ipi6_ifindex = static_cast<unsigned>(way.interface);
    return send_one(socket, bytes, to, IPPROTO_IPV6, IPV6_PKTINFO, info);
}

Result<Descriptor> bind_ipv4() {
    Descriptor socket = open_socket(AF_INET);
    sockaddr_in here{};
    here.sin_family = AF_INET;
    here.sin_port = htons(beacon_port);
    if (socket.fd() < 0 || !set_option(socket, SOL_SOCKET, SO_REUSEADDR, 1) ||
        !set_option(socket, IPPROTO_IP, IP_PKTINFO, 1) ||
        // Else it would hear groups that others of this machine have joined on any interface.
        !set_option(socket, IPPROTO_IP, IP_MULTICAST_ALL, 0) ||
        ::bind(socket.fd(), reinterpret_cast<const sockaddr*>(&here), sizeof here) != 0)
        return failed("UDP port " + std::to_string(beacon_port));
    return socket;
}

/// Nothing where the system has no IPv6.
Descriptor bind_ipv6() {
    Descriptor socket = open_socket(AF_INET6);
    sockaddr_in6 here{};
    here.sin6_family = AF_INET6;
    here.sin6_port = htons(beacon_port);
    if (socket.fd() < 0 || !set_option(socket, SOL_SOCKET, SO_REUSEADDR, 1) ||
        !set_option(socket, IPPROTO_IPV6, IPV6_V6ONLY, 1) ||
        !set_option(socket, IPPROTO_IPV6, IPV6_RECVPKTINFO, 1) ||
        ::bind(socket.fd(), reinterpret_cast<const sockaddr*>(&here), sizeof here) != 0)
        return Descriptor();
    return socket;
}

std::string sender_text(const sockaddr_in& from) {
    std::array<char, INET_ADDRSTRLEN> text{};
    ::inet_ntop(AF_INET, &from.sin_addr, text.data(), text.size());
    return text.data();
}

/// An address that only this link knows needs the interface: by its name where that stands in an
/// endpoint.
std::string sender_text(const sockaddr_in6& from) {
    std::array<char, INET6_ADDRSTRLEN> text{};
    ::inet_ntop(AF_INET6, &from.sin6_addr, text.data(), text.size());
    std::string host = text.data();
    if (IN6_IS_ADDR_LINKLOCAL(&from.sin6_addr)) {
        std::array<char, IF_NAMESIZE> buffer{};
        std::string name;
        if (::if_indextoname(from.sin6_scope_id, buffer.data()))
            name = buffer.data();
        const bool fits = !name.empty() && std::isalpha(static_cast<unsigned char>(name[0])) &&
                          std::ranges::all_of(name, [](unsigned char c) {
                              return std::isalnum(c) || c == '-' || c == '_' || c == '.';
                          });
        host += "%" + (fits ? name : std::to_string(from.sin6_scope_id));
    }
    return "[" + host + "]";
}

bool is_for_all(const in_pktinfo& info) {
    return IN_MULTICAST(ntohl(info.ipi_addr.s_addr)) || info.ipi_addr.s_addr == INADDR_BROADCAST ||
           info.ipi_addr.s_addr != info.ipi_spec_dst.s_addr;
}

bool is_for_all(const in6_pktinfo& info) {
    return IN6_IS_ADDR_MULTICAST(&info.ipi6_addr);
}

/// Nothing: none is here. An empty one: it is not for us.
template <class From, class Info>
std::optional<Datagram> receive_one(const Descriptor& socket, int level, int type) {
    Datagram datagram{Bytes(beacon_bytes + 1), {}};
    From from{};
    iovec part{datagram.bytes.data(), datagram.bytes.size()};
    msghdr message{};
    message.msg_name = &from;
    message.msg_namelen = sizeof from;
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    Control<Info> control;
    control.attach(message);
    const ssize_t n = ::recvmsg(socket.fd(), &message, MSG_DONTWAIT);
    if (n < 0)
        return std::nullopt;
    datagram.bytes.resize(static_cast<std::size_t>(n));
    for (cmsghdr* header = CMSG_FIRSTHDR(&message); header; header = CMSG_NXTHDR(&message, header))
        if (header->cmsg_level == level && header->cmsg_type == type) {
            Info info{};
            std::memcpy(&info, CMSG_DATA(header), sizeof info);
            if (is_for_all(info)) {
                datagram.sender = sender_text(from);
                return datagram;
            }
        }
    return Datagram{};
}

} // namespace

Descriptor::~Descriptor() {
    if (fd_ >= 0)
        ::close(fd_);
}
Descriptor::Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
}

BeaconSender::BeaconSender(BeaconWays ways, Descriptor ipv4, Descriptor ipv6)
    : ways_(ways), ipv4_(std::move(ipv4)), ipv6_(std::move(ipv6)) {}

Result<BeaconSender> BeaconSender::open(const BeaconWays& ways) {
    Descriptor ipv4, ipv6;
    if (ways.ipv4) {
        ipv4 = open_socket(AF_INET);
        if (ipv4.fd() < 0 || !set_option(ipv4, SOL_SOCKET, SO_BROADCAST, 1) ||
            !set_option(ipv4, IPPROTO_IP, IP_MULTICAST_TTL, 1))
            return failed("UDP socket");
    }
    if (ways.ipv6) { // there need not be any
        ipv6 = open_socket(AF_INET6);
        if (ipv6.fd() >= 0)
            set_option(ipv6, IPPROTO_IPV6, IPV6_MULTICAST_HOPS, 1);
    }
    return BeaconSender(ways, std::move(ipv4), std::move(ipv6));
}

std::size_t BeaconSender::send(std::span<const std::byte> bytes) const {
    std::size_t sent = 0;
    for (const Way& way : ways_out()) {
        if (way.is_ipv6 && ipv6_.fd() >= 0 && ways_.multicast && way.multicast)
            sent += send_ipv6(ipv6_, bytes, way);
        if (way.is_ipv6 || ipv4_.fd() < 0)
            continue;
        if (ways_.broadcast && way.broadcast)
            sent += send_ipv4(ipv4_, bytes, way, *way.broadcast);
        if (ways_.multicast && way.multicast)
            sent += send_ipv4(ipv4_, bytes, way, group());
    }
    return sent;
}

BeaconReceiver::BeaconReceiver(Descriptor ipv4, Descriptor ipv6)
    : ipv4_(std::move(ipv4)), ipv6_(std::move(ipv6)) {}

Result<BeaconReceiver> BeaconReceiver::open() {
    auto ipv4 = bind_ipv4();
    if (!ipv4)
        return ipv4.error();
    BeaconReceiver receiver(*std::move(ipv4), bind_ipv6());
    receiver.join_groups();
    return receiver;
}

void BeaconReceiver::join_groups() const {
    for (const Way& way : ways_out()) { // those that are joined already say so
        if (way.is_ipv6 && ipv6_.fd() >= 0) {
            ipv6_mreq request{};
            request.ipv6mr_multiaddr = group6();
            request.ipv6mr_interface = static_cast<unsigned>(way.interface);
            set_option(ipv6_, IPPROTO_IPV6, IPV6_JOIN_GROUP, request);
        } else if (!way.is_ipv6) {
            ip_mreqn request{};
            request.imr_multiaddr = group();
            request.imr_ifindex = way.interface;
            set_option(ipv4_, IPPROTO_IP, IP_ADD_MEMBERSHIP, request);
        }
    }
}

std::optional<Datagram> BeaconReceiver::receive() const {
    auto datagram = receive_one<sockaddr_in, in_pktinfo>(ipv4_, IPPROTO_IP, IP_PKTINFO);
    if (!datagram && ipv6_.fd() >= 0)
        datagram = receive_one<sockaddr_in6, in6_pktinfo>(ipv6_, IPPROTO_IPV6, IPV6_PKTINFO);
    return datagram;
}

} // namespace fraja::discovery
