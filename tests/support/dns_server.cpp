#include "tests/support/dns_server.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <cstring>
#include <netinet/in.h>
#include <optional>
#include <poll.h>
#include <span>
#include <string_view>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace fraja {
namespace {

constexpr std::size_t header_bytes = 12;
constexpr int connection_timeout_ms = 10'000;

void put16(Bytes& to, unsigned value) {
    to.push_back(static_cast<std::byte>(value >> 8 & 0xff));
    to.push_back(static_cast<std::byte>(value & 0xff));
}

void put_name(Bytes& to, std::string_view name) {
    if (name == ".")
        name = {};
    while (!name.empty()) {
        const std::string_view label = name.substr(0, name.find('.'));
        to.push_back(static_cast<std::byte>(label.size()));
        for (const char c : label)
            to.push_back(static_cast<std::byte>(c));
        name.remove_prefix(std::min(label.size() + 1, name.size()));
    }
    to.push_back(std::byte{0});
}

/// Of a question: its name, and where it ends.
std::optional<std::pair<std::string, std::size_t>> name_in(const Bytes& question) {
    std::string name;
    std::size_t at = header_bytes;
    while (at < question.size() && question[at] != std::byte{0}) {
        const auto size = static_cast<std::size_t>(question[at]);
        if (at + size >= question.size())
            return std::nullopt;
        name += (name.empty() ? "" : ".");
        name += as_text(std::span(question).subspan(at + 1, size));
        at += size + 1;
    }
    if (at + 5 > question.size())
        return std::nullopt;
    return std::pair(name, at + 5);
}

sockaddr_in loopback(std::uint16_t port) {
    sockaddr_in here{};
    here.sin_family = AF_INET;
    here.sin_port = htons(port);
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return here;
}

bool bind_to(int fd, std::uint16_t port) {
    const sockaddr_in here = loopback(port);
    return ::bind(fd, reinterpret_cast<const sockaddr*>(&here), sizeof here) == 0;
}

std::uint16_t port_of(int fd) {
    sockaddr_in here{};
    socklen_t size = sizeof here;
    FRAJA_ASSERT(::getsockname(fd, reinterpret_cast<sockaddr*>(&here), &size) == 0);
    return ntohs(here.sin_port);
}

bool receive_all(int fd, std::span<std::byte> to) {
    while (!to.empty()) {
        pollfd readable{fd, POLLIN, 0};
        if (::poll(&readable, 1, connection_timeout_ms) != 1)
            return false;
        const ssize_t n = ::recv(fd, to.data(), to.size(), 0);
        if (n <= 0)
            return false;
        to = to.subspan(static_cast<std::size_t>(n));
    }
    return true;
}

} // namespace

Bytes srv_question(const std::string& name) {
    Bytes question;
    for (const unsigned word : {0x1234u, 0x0100u, 1u, 0u, 0u, 0u})
        put16(question, word);
    put_name(question, name);
    put16(question, 33); // SRV
    put16(question, 1);  // IN
    return question;
}

Bytes dns_answer(const Bytes& question, const DnsReply& reply, bool by_tcp) {
    const auto name = name_in(question);
    if (!name || reply.silent)
        return {};
    const bool is_cut = reply.truncated && !by_tcp;
    Bytes answer(question.begin(), question.begin() + 2);
    put16(answer, 0x8180u | (is_cut ? 0x0200u : 0u) | static_cast<unsigned>(reply.code));
    put16(answer, 1);
    put16(answer, is_cut ? 0u : static_cast<unsigned>(reply.records.size()));
    put16(answer, 0);
    put16(answer, 0);
    answer.insert(answer.end(), question.begin() + header_bytes,
                  question.begin() + static_cast<std::ptrdiff_t>(name->second));
    if (is_cut)
        return answer;
    for (const SrvRow& row : reply.records) {
        put16(answer, 0xc000u | header_bytes); // the question's name
        put16(answer, 33);
        put16(answer, 1);
        put16(answer, 0);
        put16(answer, 60); // TTL
        Bytes data;
        put16(data, row.priority);
        put16(data, row.weight);
        put16(data, row.port);
        put_name(data, row.target);
        put16(answer, static_cast<unsigned>(data.size()));
        answer.insert(answer.end(), data.begin(), data.end());
    }
    return answer;
}

DnsServer::DnsServer(std::uint16_t port) : port_(port) {
    for (bool bound = false; !bound;) { // the system's choice for UDP may be taken for TCP
        udp_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
        tcp_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        FRAJA_ASSERT(bind_to(udp_, port));
        port_ = port_of(udp_);
        bound = bind_to(tcp_, port_) && ::listen(tcp_, 16) == 0;
        FRAJA_ASSERT(bound || port == 0);
        if (!bound) {
            ::close(udp_);
            ::close(tcp_);
        }
    }
    stop_ = ::eventfd(0, EFD_CLOEXEC);
    thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
}

DnsServer::~DnsServer() {
    thread_.request_stop();
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto written = ::write(stop_, &one, sizeof one);
    thread_.join();
    for (const int fd : {udp_, tcp_, stop_})
        ::close(fd);
}

void DnsServer::set(const std::string& name, DnsReply reply) {
    const std::lock_guard lock(mutex_);
    replies_[name] = std::move(reply);
}

std::size_t DnsServer::question_count() const {
    const std::lock_guard lock(mutex_);
    return question_count_;
}

Bytes DnsServer::answer(const Bytes& question, bool by_tcp) {
    const auto name = name_in(question);
    const std::lock_guard lock(mutex_);
    ++question_count_;
    const auto known = name ? replies_.find(name->first) : replies_.end();
    return dns_answer(question, known == replies_.end() ? DnsReply{.code = 3} : known->second,
                      by_tcp);
}

void DnsServer::serve(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
        std::array<pollfd, 3> entries = {
            {{udp_, POLLIN, 0}, {tcp_, POLLIN, 0}, {stop_, POLLIN, 0}}};
        if (::poll(entries.data(), entries.size(), -1) <= 0)
            continue;
        if (entries[0].revents != 0) {
            Bytes question(512);
            sockaddr_in from{};
            socklen_t size = sizeof from;
            const ssize_t n = ::recvfrom(udp_, question.data(), question.size(), 0,
                                         reinterpret_cast<sockaddr*>(&from), &size);
            question.resize(static_cast<std::size_t>(std::max<ssize_t>(n, 0)));
            if (const Bytes bytes = answer(question, false); !bytes.empty())
                ::sendto(udp_, bytes.data(), bytes.size(), 0,
                         reinterpret_cast<const sockaddr*>(&from), size);
        }
        if (entries[1].revents != 0)
            serve_connection();
    }
}

void DnsServer::serve_connection() {
    const int fd = ::accept4(tcp_, nullptr, nullptr, SOCK_CLOEXEC);
    Bytes size(2);
    if (receive_all(fd, size)) {
        Bytes question((static_cast<std::size_t>(size[0]) << 8) +
                       static_cast<std::size_t>(size[1]));
        if (receive_all(fd, question)) {
            const Bytes bytes = answer(question, true);
            Bytes message;
            put16(message, static_cast<unsigned>(bytes.size()));
            message.insert(message.end(), bytes.begin(), bytes.end());
            ::send(fd, message.data(), message.size(), MSG_NOSIGNAL);
        }
    }
    ::close(fd);
}

} // namespace fraja
