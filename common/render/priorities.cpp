#include "common/render/priorities.hpp"

#include <algorithm>
#include <unordered_set>

namespace fraja {
namespace {

std::uint64_t pair_key(SolidIndex above, SolidIndex below) {
    return std::uint64_t{static_cast<std::uint32_t>(above)} << 32 |
           static_cast<std::uint32_t>(below);
}

} // namespace

Priorities::Priorities(const std::vector<Priority>& pairs) {
    sorted_pairs_.reserve(pairs.size());
    for (const Priority& pair : pairs)
        sorted_pairs_.push_back(pair_key(pair.above, pair.below));
    std::sort(sorted_pairs_.begin(), sorted_pairs_.end());
}

bool Priorities::above(SolidIndex a, SolidIndex b) const {
    return std::binary_search(sorted_pairs_.begin(), sorted_pairs_.end(), pair_key(a, b));
}

std::vector<SolidIndex> each_once(const std::vector<SolidIndex>& members) {
    std::vector<SolidIndex> once;
    std::unordered_set<SolidIndex> seen;
    for (const SolidIndex member : members)
        if (seen.insert(member).second)
            once.push_back(member);
    return once;
}

} // namespace fraja
