#include "tests/support/network.hpp"

#include <cerrno>
#include <chrono>
#include <exception>
#include <fcntl.h>
#include <fstream>
#include <sched.h>
#include <system_error>
#include <thread>
#include <unistd.h>
#include <utility>

namespace fraja {
namespace {

constexpr auto ip_timeout = std::chrono::seconds(60);
constexpr const char* nobodys_mac =
    "02:77:00:00:ff:ff"; ///< a switch sends it everywhere, for nobody

Error failed(const std::string& what) {
    return {ErrorCode::io, what + ": " + std::error_code(errno, std::generic_category()).message()};
}

/// A namespace lives as long as somebody has it open.
class Namespace {
public:
    explicit Namespace(int fd) : fd_(fd) {}
    ~Namespace() {
        if (fd_ >= 0)
            ::close(fd_);
    }
    Namespace(Namespace&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
    Namespace& operator=(Namespace&& other) noexcept {
        std::swap(fd_, other.fd_);
        return *this;
    }
    [[nodiscard]] int fd() const { return fd_; }
    /// As other processes may open it, while this one lives.
    [[nodiscard]] std::string path() const {
        return "/proc/" + std::to_string(::getpid()) + "/fd/" + std::to_string(fd_);
    }

private:
    int fd_;
};

/// Only the thread that makes it enters it.
Result<Namespace> make_namespace() {
    Result<Namespace> made = Error{ErrorCode::io, {}};
    std::jthread([&made] {
        if (::unshare(CLONE_NEWNET) != 0)
            made = failed("unshare a network namespace");
        else if (const int fd = ::open("/proc/thread-self/ns/net", O_RDONLY | O_CLOEXEC); fd < 0)
            made = failed("/proc/thread-self/ns/net");
        else
            made = Namespace(fd);
    }).join();
    return made;
}

void write_to(const char* file, const std::string& text) {
    std::ofstream(file) << text;
}

/// Where only root may make networks, one may become root of a namespace without any.
Result<void> become_root() {
    const uid_t user = ::geteuid();
    const gid_t group = ::getegid();
    if (user == 0)
        return {};
    if (::unshare(CLONE_NEWUSER) != 0)
        return failed("unshare a user namespace");
    write_to("/proc/self/setgroups", "deny");
    write_to("/proc/self/uid_map", "0 " + std::to_string(user) + " 1");
    write_to("/proc/self/gid_map", "0 " + std::to_string(group) + " 1");
    return {};
}

Command in(const Namespace& place, Command command) {
    const std::vector<std::string> enter = {"nsenter", "--net=" + place.path(), "--"};
    command.argv.insert(command.argv.begin(), enter.begin(), enter.end());
    return command;
}

/// A shell's commands, until one fails.
Result<void> run_in(const Namespace& place, const std::string& script) {
    const auto result = run(in(place, {{"/bin/sh", "-ec", script}}), ip_timeout);
    if (!result)
        return result.error();
    if (result->exit == 0)
        return {};
    return Error{ErrorCode::io, script + ": " + result->err};
}

std::string port_of(std::size_t host) {
    return "port" + std::to_string(host);
}
std::string bridge_of(std::size_t group) {
    return "bridge" + std::to_string(group);
}
std::string link_address6(std::size_t host) {
    return "fe80::" + std::to_string(host + 1);
}

/// As many bridges as there may be groups.
std::string switch_script(std::size_t host_count) {
    std::string script;
    for (std::size_t i = 0; i < host_count; ++i)
        script += "ip link add " + bridge_of(i) +
                  " type bridge stp_state 0 forward_delay 0 mcast_snooping 0\n"
                  "ip link set " +
                  bridge_of(i) + " up\n";
    return script;
}

/// Links come up by and by: what is sent before that is lost.
std::string until(const std::string& condition) {
    return "until " + condition + "; do sleep 0.01; done\n";
}

/// Addresses are set by hand: those that the kernel makes are of no use for a second, as it looks
/// whether somebody else has them.
std::string host_script(std::size_t host) {
    return "ip link set lo up\n"
           "ip link set eth0 addrgenmode none\n"
           "ip address add " +
           TestNetwork::address(host) + "/24 broadcast + dev eth0\n" + //
           "ip address add " + TestNetwork::address6(host) + "/64 dev eth0 nodad\n" +
           "ip address add " + link_address6(host) + "/64 dev eth0 nodad\n" +
           "ip link set eth0 up\n" + until("ip link show eth0 | grep -q LOWER_UP");
}

} // namespace

struct TestNetwork::State {
    Namespace middle; // the switch
    std::vector<Namespace> hosts;
};

TestNetwork::TestNetwork(std::unique_ptr<State> state) : state_(std::move(state)) {}
TestNetwork::~TestNetwork() = default;
TestNetwork::TestNetwork(TestNetwork&&) noexcept = default;
TestNetwork& TestNetwork::operator=(TestNetwork&&) noexcept = default;

Result<TestNetwork> TestNetwork::make(std::size_t host_count) {
    FRAJA_ASSERT(host_count > 0 && host_count <= hosts_max);
    if (const auto root = become_root(); !root)
        return root.error();
    auto middle = make_namespace();
    if (!middle)
        return middle.error();
    auto state = std::make_unique<State>(State{*std::move(middle), {}});
    if (auto done = run_in(state->middle, switch_script(host_count)); !done)
        return done.error();
    for (std::size_t i = 0; i < host_count; ++i) {
        auto host = make_namespace();
        if (!host)
            return host.error();
        state->hosts.push_back(*std::move(host));
        if (auto done = run_in(state->middle, "ip link add " + port_of(i) +
                                                  " type veth peer name eth0 netns " +
                                                  state->hosts[i].path() + "\n" + "ip link set " +
                                                  port_of(i) + " master " + bridge_of(0) + " up\n");
            !done)
            return done.error();
        if (auto done = run_in(state->hosts[i], host_script(i)); !done)
            return done.error();
        if (auto done = run_in(state->middle, until("ip -details link show " + port_of(i) +
                                                    " | grep -q 'state forwarding'"));
            !done)
            return done.error();
    }
    return TestNetwork(std::move(state));
}

std::string TestNetwork::address(std::size_t host) {
    return "10.77.0." + std::to_string(host + 1);
}

std::string TestNetwork::address6(std::size_t host) {
    return "fd77::" + std::to_string(host + 1);
}

Command TestNetwork::on(std::size_t host, Command command) const {
    return in(state_->hosts.at(host), std::move(command));
}

void TestNetwork::visit(std::size_t host, const std::function<void()>& deed) const {
    const int fd = state_->hosts.at(host).fd();
    bool there = false;
    std::exception_ptr thrown; // by a check of the test's that failed
    std::jthread([&] {
        if (there = ::setns(fd, CLONE_NEWNET) == 0; !there)
            return;
        try {
            deed();
        } catch (...) {
            thrown = std::current_exception();
        }
    }).join();
    FRAJA_ASSERT(there);
    if (thrown)
        std::rethrow_exception(thrown);
}

void TestNetwork::divide(const std::vector<std::vector<std::size_t>>& groups) {
    std::vector<std::size_t> group_of(state_->hosts.size(), state_->hosts.size());
    for (std::size_t group = 0; group < groups.size(); ++group)
        for (const std::size_t host : groups[group])
            group_of.at(host) = group;
    std::string script;
    for (std::size_t host = 0; host < group_of.size(); ++host)
        script += "ip link set " + port_of(host) +
                  (group_of[host] < groups.size() ? " master " + bridge_of(group_of[host])
                                                  : std::string(" nomaster")) +
                  "\n";
    const auto done = run_in(state_->middle, script);
    FRAJA_ASSERT(done.has_value());
}

void TestNetwork::join() {
    std::vector<std::size_t> all;
    for (std::size_t host = 0; host < state_->hosts.size(); ++host)
        all.push_back(host);
    divide({all});
}

void TestNetwork::cut(std::size_t from, std::size_t to) {
    std::string script;
    for (const std::string& at : {address(to), address6(to), link_address6(to)})
        script +=
            "ip neighbour replace " + at + " lladdr " + nobodys_mac + " nud permanent dev eth0\n";
    const auto done = run_in(state_->hosts.at(from), script);
    FRAJA_ASSERT(done.has_value());
}

void TestNetwork::mend(std::size_t from, std::size_t to) {
    std::string script;
    for (const std::string& at : {address(to), address6(to), link_address6(to)})
        script += "ip neighbour delete " + at + " dev eth0\n";
    const auto done = run_in(state_->hosts.at(from), script);
    FRAJA_ASSERT(done.has_value());
}

} // namespace fraja
