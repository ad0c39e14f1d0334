// Doctor: what commonly goes wrong between a machine and its farm, looked for; and the cure.
#pragma once

#include "client/options.hpp"
#include "common/discovery/finder.hpp"
#include "common/net/signals.hpp"
#include "common/protocol/messages.hpp"

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

namespace fraja::client {

struct Finding {
    enum class Grade : std::uint8_t {
        good,
        doubtful, ///< works, but perhaps not as it is meant to
        bad,      ///< does not work
    };
    Grade grade{};
    std::string subject, text;
    std::string cure;       ///< what to do; empty where nothing need be done
    bool no_broker = false; ///< none was reached there
    friend bool operator==(const Finding&, const Finding&) = default;
};

/// Clocks that are further apart make logs and expiry dates hard to compare.
inline constexpr Duration clock_skew_max = std::chrono::seconds(5);
/// A broker serves so many peers with fewer descriptors than it would like; a client needs few.
inline constexpr std::uint64_t descriptors_few = 4096;
inline constexpr std::uint64_t disk_bytes_few = std::uint64_t{1} << 30;

/// This machine: settings files, as each program reads them, processors, descriptors, pictures,
/// room on the disks. `refused_over`: what is wrong with the settings as far as that is known; may
/// be empty.
[[nodiscard]] std::vector<Finding> examine_machine(const std::string& refused_over = {});

/// What a farm says of itself. `unix_time`: this machine's clock, since 1970.
[[nodiscard]] std::vector<Finding> examine_farm(const protocol::FarmState& farm,
                                                Duration unix_time);

/// What a source (common/discovery) tells now, or that it tells nothing for a while.
[[nodiscard]] discovery::Findings find_brokers(const std::string& source,
                                               const SharedOptions& shared);

struct BrokersExamined {
    std::vector<Finding> findings;
    Outcome outcome; ///< where it was interrupted or terminated: the findings say nothing then
};
/// Each broker of the options: its name, its port, its version, its stream, its farm. One that is
/// reached at several endpoints is looked at once. `signals` may be null.
[[nodiscard]] BrokersExamined examine_brokers(const SharedOptions& shared,
                                              const net::SignalWatch* signals);

/// A line for each finding, and one for its cure; those of the brokers apart.
[[nodiscard]] std::string findings_page(const std::vector<Finding>& machine,
                                        const std::vector<Finding>& brokers);

} // namespace fraja::client
