// Which member of an Aggregate displaces which.
#pragma once

#include "common/scene/scene.hpp"

#include <cstdint>
#include <vector>

namespace fraja {

class Priorities {
public:
    Priorities() = default;
    explicit Priorities(const std::vector<Priority>& pairs);
    /// Whether the scene says `a >> b` itself: a priority is not transitive. Two solids may have
    /// priority over each other.
    [[nodiscard]] bool above(SolidIndex a, SolidIndex b) const;
    [[nodiscard]] bool empty() const { return sorted_pairs_.empty(); }

private:
    std::vector<std::uint64_t> sorted_pairs_;
};

/// The members of an Aggregate, each once, in the order of the scene: a solid listed twice is the
/// same solid, and would overlap itself.
[[nodiscard]] std::vector<SolidIndex> each_once(const std::vector<SolidIndex>& members);

} // namespace fraja
