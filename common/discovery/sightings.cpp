#include "common/discovery/sightings.hpp"

#include <algorithm>

namespace fraja::discovery {

Sightings::Verdict Sightings::hear(Instant now, std::span<const std::byte> bytes,
                                   const std::string& sender) {
    const Verdict verdict = judge(now, bytes, sender);
    ++counts_[static_cast<std::size_t>(verdict)];
    return verdict;
}

Sightings::Verdict Sightings::judge(Instant now, std::span<const std::byte> bytes,
                                    const std::string& sender) {
    const auto beacon = decode_beacon(bytes);
    if (!beacon)
        return beacon.error().code == ErrorCode::version_mismatch ? Verdict::other_version
                                                                  : Verdict::malformed;
    if (beacon->farm != farm_)
        return Verdict::other_farm;
    expire(now);
    const std::string endpoint = endpoint_of(*beacon, sender);
    if (const auto known = std::ranges::find(all_, endpoint, &Sighting::endpoint);
        known != all_.end()) {
        known->heard = now;
        return Verdict::taken;
    }
    if (all_.size() >= sightings_max || std::ranges::count(all_, sender, &Sighting::sender) >=
                                            static_cast<std::ptrdiff_t>(sightings_per_sender_max))
        return Verdict::too_many;
    all_.push_back({endpoint, sender, now});
    return Verdict::taken;
}

void Sightings::expire(Instant now) {
    std::erase_if(all_, [now](const Sighting& s) { return now >= s.heard + sighting_lifetime; });
}

Instant Sightings::next_deadline() const {
    Instant first = Instant::never();
    for (const Sighting& s : all_)
        first = std::min(first, s.heard + sighting_lifetime);
    return first;
}

std::vector<std::string> Sightings::endpoints() const {
    std::vector<std::string> endpoints;
    for (const Sighting& s : all_)
        endpoints.push_back(s.endpoint);
    return endpoints;
}

} // namespace fraja::discovery
