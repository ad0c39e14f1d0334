// Sightings: which brokers have announced themselves of late. Decides what of all that anybody
// sends is worth a try; has no socket and no clock.
#pragma once

#include "common/base/instant.hpp"
#include "common/discovery/beacon.hpp"

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace fraja::discovery {

/// Pause between two beacons of a broker.
inline constexpr Duration beacon_interval = std::chrono::seconds(1);
/// Who was not heard for so long is gone: some beacons may get lost.
inline constexpr Duration sighting_lifetime = 10 * beacon_interval;
/// Kept at a time. Beyond it those that are known stay: nobody drives them out by sending more.
inline constexpr std::size_t sightings_max = 64;
/// Of these by one sender's word.
inline constexpr std::size_t sightings_per_sender_max = 4;

class Sightings {
public:
    /// `farm`: whose brokers are looked for; nothing: those without keys.
    explicit Sightings(std::optional<Fingerprint> farm) : farm_(farm) {}

    enum class Verdict : std::uint8_t { taken, malformed, other_version, other_farm, too_many };
    /// A datagram and the address that it comes from, as Endpoint's host.
    Verdict hear(Instant now, std::span<const std::byte> bytes, const std::string& sender);
    /// Forgets who is gone.
    void expire(Instant now);
    /// When that has something to do.
    [[nodiscard]] Instant next_deadline() const;

    /// Endpoints, in the order in which they were first heard.
    [[nodiscard]] std::vector<std::string> endpoints() const;
    /// So many datagrams have had that verdict.
    [[nodiscard]] std::uint64_t count(Verdict verdict) const {
        return counts_[static_cast<std::size_t>(verdict)];
    }

private:
    struct Sighting {
        std::string endpoint, sender;
        Instant heard;
    };
    [[nodiscard]] Verdict judge(Instant now, std::span<const std::byte> bytes,
                                const std::string& sender);

    std::optional<Fingerprint> farm_;
    std::vector<Sighting> all_;
    std::array<std::uint64_t, 5> counts_{};
};

} // namespace fraja::discovery
