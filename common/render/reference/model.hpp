// The scene made ready: what Raja computes once and what its lookups need.
#pragma once

#include "common/render/priorities.hpp"
#include "common/render/reference/camera.hpp"
#include "common/render/reference/primitive.hpp"
#include "common/scene/scene.hpp"

#include <cstdint>
#include <memory>
#include <variant>
#include <vector>

namespace fraja::reference {

/// A Union or an Intersection.
struct Composite {
    enum class Kind : std::uint8_t { any_member, every_member };
    Kind kind;
    std::vector<TexturedFormIndex> members;
    /// More restarts (FORMAT.md, 8.4) than a search for a hit can need: a ray crosses no primitive
    /// form more than twice, but rounding could make it go on for ever.
    std::uint64_t restarts_max;
};

using PreparedTexturedForm = std::variant<BasicTexturedForm, Complement, Composite>;

struct PreparedAggregate {
    std::vector<SolidIndex> members; ///< each once, in the order of the scene
    Priorities priorities;
};

using PreparedSolid = std::variant<BasicSolid, PreparedAggregate>;

/// Immutable; shared by all threads. The tables are parallel to the scene's.
struct Model {
    explicit Model(std::shared_ptr<const Scene> scene_values);

    std::shared_ptr<const Scene> scene;
    PreparedCamera camera;
    std::vector<Primitive> primitives;
    std::vector<PreparedTexturedForm> textured_forms;
    std::vector<PreparedSolid> solids;
};

} // namespace fraja::reference
