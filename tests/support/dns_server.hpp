// A DNS server of a test's own, which knows SRV records and faults.
#pragma once

#include "common/base/bytes.hpp"

#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace fraja {

struct SrvRow {
    std::uint16_t priority = 0, weight = 0, port = 0;
    std::string target;
};

/// What is answered to questions for a name.
struct DnsReply {
    std::vector<SrvRow> records = {};
    int code = 0;           ///< RCODE: 2 the server fails, 3 there is no such name
    bool truncated = false; ///< by UDP no record comes, but that there are more
    bool silent = false;    ///< nothing is answered
};

/// The answer to that question, as on the wire. Empty: there is none.
[[nodiscard]] Bytes dns_answer(const Bytes& question, const DnsReply& reply, bool by_tcp);
/// A question for the SRV records of that name.
[[nodiscard]] Bytes srv_question(const std::string& name);

/// Answers in a thread of its own, by UDP and TCP.
class DnsServer {
public:
    /// On loopback, of whoever makes it (tests/support/network.hpp); 0: the system chooses.
    explicit DnsServer(std::uint16_t port = 0);
    ~DnsServer();
    DnsServer(const DnsServer&) = delete;
    DnsServer& operator=(const DnsServer&) = delete;

    /// From now on. Names that it was not told of do not exist.
    void set(const std::string& name, DnsReply reply);
    /// So many questions have come.
    [[nodiscard]] std::size_t question_count() const;
    /// ADDRESS:PORT.
    [[nodiscard]] std::string address() const { return "127.0.0.1:" + std::to_string(port_); }

private:
    void serve(const std::stop_token& stop);
    [[nodiscard]] Bytes answer(const Bytes& question, bool by_tcp);
    void serve_connection();

    int udp_ = -1, tcp_ = -1, stop_ = -1;
    std::uint16_t port_;
    mutable std::mutex mutex_;
    std::map<std::string, DnsReply> replies_;
    std::size_t question_count_ = 0;
    std::jthread thread_;
};

} // namespace fraja
