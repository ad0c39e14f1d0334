// The topics of the stream. All are short: libzmq 4.3.4 never subscribes topics of 246-255 bytes.
#pragma once

#include "common/base/ids.hpp"

#include <optional>
#include <string>
#include <string_view>

namespace fraja::protocol {

/// 'J' and the job's 16 bytes: its TileDone and JobState messages.
[[nodiscard]] inline std::string job_topic(const JobId& job) {
    return "J" + std::string(job.bytes.begin(), job.bytes.end());
}
/// 'N' and a nonce: subscribing to it makes the broker publish a Barrier there.
[[nodiscard]] inline std::string barrier_topic(const Nonce& nonce) {
    return "N" + std::string(nonce.bytes.begin(), nonce.bytes.end());
}
/// FarmState messages.
inline constexpr std::string_view farm_topic = "F";

/// The id behind a topic of that letter, if it is one.
template <class Id>
[[nodiscard]] std::optional<Id> topic_id(char letter, std::string_view topic) {
    Id id;
    if (topic.size() != 1 + id.bytes.size() || topic[0] != letter)
        return std::nullopt;
    for (std::size_t i = 0; i < id.bytes.size(); ++i)
        id.bytes[i] = static_cast<std::uint8_t>(topic[i + 1]);
    return id;
}

} // namespace fraja::protocol
