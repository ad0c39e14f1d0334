#include "worker/options.hpp"

#include "common/base/allowance.hpp"
#include "common/base/text.hpp"
#include "common/net/endpoint.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <unistd.h>
#include <utility>

namespace fraja::worker {
namespace {

Error invalid(std::string message) {
    return {ErrorCode::invalid_argument, std::move(message)};
}

/// "3500", "3.5k"; 0 where it is no such number.
double parse_speed(std::string_view text) {
    constexpr std::pair<char, double> units[] = {{'k', 1e3}, {'M', 1e6}, {'G', 1e9}};
    double unit = 1;
    for (const auto& [letter, factor] : units)
        if (text.ends_with(letter)) {
            text.remove_suffix(1);
            unit = factor;
            break;
        }
    if (text.empty() || text.find_first_not_of("0123456789.") != std::string_view::npos)
        return 0; // nor "inf", "nan", "-1", which from_chars would read
    double value = 0;
    const char* end = text.data() + text.size();
    const auto read = std::from_chars(text.data(), end, value, std::chars_format::fixed);
    if (read.ec != std::errc{} || read.ptr != end)
        return 0;
    return value * unit;
}

Result<void> validate_emulated(const WorkerOptions& o) {
    for (const EmulatedWorkers& e : o.emulated)
        if (e.count == 0 || !(e.rays_per_s >= emulated_rays_per_s_min) ||
            !(e.rays_per_s <= emulated_rays_per_s_max))
            return invalid("--emulate: COUNT is at least 1, SPEED 0.001 to 1000000G");
    if (emulated_count(o) > emulated_workers_max)
        return invalid("--emulate: at most " + std::to_string(emulated_workers_max) +
                       " workers in one process");
    if (o.emulated.empty())
        return {};
    if (o.tags.size() + 1 > protocol::tags_max)
        return invalid("--tag: at most " + std::to_string(protocol::tags_max - 1) +
                       " of them with --emulate");
    if (o.name.size() + 1 + std::to_string(emulated_count(o)).size() > protocol::name_bytes_max)
        return invalid("--name: with /" + std::to_string(emulated_count(o)) + " at most " +
                       std::to_string(protocol::name_bytes_max) + " bytes");
    return {};
}

} // namespace

Result<void> validate(const WorkerOptions& o) {
    if (o.brokers.empty() && o.listen.empty())
        return invalid("--broker: at least one endpoint is needed");
    if (!o.brokers.empty() && !o.listen.empty())
        return invalid("--listen and --broker exclude each other: a worker waits to be called, or "
                       "calls");
    if (o.insecure && o.listen.empty())
        return invalid("--insecure is for --listen: whoever connects to a broker is not reached "
                       "by anybody");
    if (!o.allow.empty() && o.listen.empty())
        return invalid("--allow is for --listen: whoever connects to a broker is not reached by "
                       "anybody");
    if (!o.listen.empty())
        if (const auto where =
                listening_endpoints(o.listen, o.insecure || !o.allow.empty(), session_count(o));
            !where)
            return where.error();
    if (o.threads == 0 || o.threads > threads_max)
        return invalid("--threads " + std::to_string(o.threads) + ": 1 to " +
                       std::to_string(threads_max));
    if (o.name.empty() || o.name.size() > protocol::name_bytes_max)
        return invalid("--name: 1 to " + std::to_string(protocol::name_bytes_max) + " bytes");
    if (o.tags.size() > protocol::tags_max)
        return invalid("--tag: at most " + std::to_string(protocol::tags_max) + " of them");
    for (const std::string& tag : o.tags)
        if (tag.empty() || tag.starts_with('=') || tag.size() > protocol::name_bytes_max)
            return invalid("--tag '" + tag.substr(0, protocol::name_bytes_max) +
                           "': K or K=V of at most " + std::to_string(protocol::name_bytes_max) +
                           " bytes");
    return validate_emulated(o);
}

std::uint64_t session_count(const WorkerOptions& o) {
    const std::uint64_t workers = o.emulated.empty() ? 1 : emulated_count(o);
    return o.listen.empty() ? workers * o.brokers.size() : workers;
}

Result<std::vector<std::string>> listening_endpoints(const std::string& listen, bool insecure,
                                                     std::uint64_t count) {
    const std::string option = "--listen " + listen + ": ";
    auto parsed = net::parse_endpoint(listen, 0);
    if (!parsed)
        return invalid("--listen: " + parsed.error().message);
    net::Endpoint endpoint = *std::move(parsed);
    if (endpoint.transport != net::Endpoint::Transport::tcp)
        return invalid(option + "where to listen is written as tcp://HOST:PORT");
    if (endpoint.port != 0 && endpoint.port + count - 1 > UINT16_MAX)
        return invalid(option + std::to_string(count) +
                       " workers need as many ports, and the last is 65535");
    std::vector<std::string> all;
    for (std::uint64_t i = 0; i < count; ++i) {
        auto bindable = net::endpoint_to_bind(net::to_string(endpoint), 0, insecure);
        if (!bindable)
            return invalid("--listen: " + bindable.error().message);
        all.push_back(*std::move(bindable));
        if (endpoint.port != 0)
            ++endpoint.port;
    }
    return all;
}

Result<EmulatedWorkers> parse_emulated_workers(std::string_view text) {
    const std::size_t at = text.find('@');
    const auto count = parse_count(text.substr(0, at));
    const double speed = at == std::string_view::npos ? 0 : parse_speed(text.substr(at + 1));
    const std::string shown = "--emulate " + printable(clipped(text, 100));
    if (!count || speed == 0)
        return invalid(shown + ": COUNT@SPEED is needed, such as 16@3.5k: 16 workers, each thread "
                               "of which traces 3500 rays a second");
    if (*count == 0 || *count > emulated_workers_max)
        return invalid(shown + ": 1 to " + std::to_string(emulated_workers_max) + " workers");
    if (speed < emulated_rays_per_s_min || speed > emulated_rays_per_s_max)
        return invalid(shown + ": 0.001 to 1000000G rays a second");
    return EmulatedWorkers{static_cast<std::uint32_t>(*count), speed};
}

std::uint64_t emulated_count(const WorkerOptions& options) {
    std::uint64_t count = 0;
    for (const EmulatedWorkers& e : options.emulated)
        count += e.count;
    return count;
}

std::uint32_t usable_cpu_count() {
    return std::min(usable_processors().usable, threads_max);
}

std::string default_worker_name() {
    std::array<char, 128> host{};
    if (gethostname(host.data(), host.size() - 1) != 0)
        host = {"worker"};
    return std::string(host.data()) + ":" + std::to_string(getpid());
}

} // namespace fraja::worker
