// What each @label of a .raj text means at present (FORMAT.md 1.3).
#pragma once

#include "common/scene/raj_builder.hpp"
#include "common/scene/raj_diagnostics.hpp"
#include "common/scene/raj_limits.hpp"

#include <cstdint>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace fraja::raj {

/// A label is somebody's choice, and whoever chooses many that collide makes a plain hash table
/// quadratic. This hash is a polynomial at a random point, so nobody can.
class LabelHash {
public:
    LabelHash();
    [[nodiscard]] std::size_t operator()(std::string_view label) const;

private:
    std::uint64_t point_;
};

class Labels {
public:
    /// Both must outlive this, and so must the text that labels are given in.
    Labels(const RajLimits& limits, Diagnostics& diagnostics)
        : limits_(limits), diagnostics_(diagnostics) {}

    /// An object of that label begins: until it ends, the label keeps its former meaning, if any.
    void open(std::string_view label) { open_.push_back(label); }
    /// The object opened last has ended, and from here on the label means it. False when there are
    /// too many labels.
    [[nodiscard]] bool close(std::string_view label, const Value& object);

    /// What the label means. False, and refused, when it is not known at `place`.
    [[nodiscard]] bool find(std::string_view label, Place place, Value& value) const;

private:
    const RajLimits& limits_;
    Diagnostics& diagnostics_;
    std::unordered_map<std::string_view, std::uint32_t, LabelHash>
        numbers_;                         ///< places in the next two
    std::vector<std::string_view> names_; ///< in order of definition
    std::vector<Value> values_;
    std::vector<std::string_view> open_;
};

} // namespace fraja::raj
