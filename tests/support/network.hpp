// A network of a test's own: hosts that are namespaces of the kernel, joined by a switch that can
// be divided.
#pragma once

#include "common/base/result.hpp"
#include "tests/support/process.hpp"

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace fraja {

/// Hosts 0 to count - 1, each with a loopback and one Ethernet interface, `eth0`, on a common
/// switch. There is no way out of it, not even a default route, and nothing of it shows outside or
/// outlives this object or the test.
///
/// Needs the program ip (package iproute2), and root or a system that lets anybody make user
/// namespaces: then the test's process becomes root of one, for good. Use from one thread only.
class TestNetwork {
public:
    static constexpr std::size_t hosts_max = 16;

    /// Errors: io, when that is not permitted here, with the reason. Aborts on a count of 0 or
    /// above `hosts_max`.
    [[nodiscard]] static Result<TestNetwork> make(std::size_t host_count);
    ~TestNetwork();
    TestNetwork(TestNetwork&&) noexcept;
    TestNetwork& operator=(TestNetwork&&) noexcept;

    /// Of eth0, as 10.77.0.1 (of host 0) in a network of 24 bits.
    [[nodiscard]] static std::string address(std::size_t host);
    /// The same in IPv6, as fd77::1, beside fe80::1; 64 bits.
    [[nodiscard]] static std::string address6(std::size_t host);

    /// The command as one that runs on that host. The process is that of the program itself.
    [[nodiscard]] Command on(std::size_t host, Command command) const;
    /// Calls `deed` in a thread that is on that host: sockets that it opens stay there. Returns
    /// when it is done.
    void visit(std::size_t host, const std::function<void()>& deed) const;

    /// From now on frames pass within a group alone; who is in none is alone. Nobody is told: what
    /// is sent across is lost, and links stay up.
    void divide(const std::vector<std::vector<std::size_t>>& groups);
    /// All in one group, as at the beginning.
    void join();

    /// What `from` sends to the addresses of `to` is lost, one way; broadcast and multicast pass.
    void cut(std::size_t from, std::size_t to);
    void mend(std::size_t from, std::size_t to);

private:
    struct State;
    explicit TestNetwork(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

/// What a test prints when it can do nothing here: ctest then counts it as skipped.
inline constexpr const char* skipped_words = "TEST SKIPPED: ";

} // namespace fraja
