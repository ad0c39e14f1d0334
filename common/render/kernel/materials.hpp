// Textures as materials.
#pragma once

#include "common/render/kernel/tables.hpp"
#include "common/scene/scene.hpp"

#include <cstdint>
#include <vector>

namespace fraja::kernel {

/// Textures that look alike are one material, so that their hits are shaded together.
struct Materials {
    std::vector<Material> table;
    std::vector<std::uint32_t> of_texture; ///< by texture, its place in `table`

    [[nodiscard]] std::uint32_t operator[](TextureIndex texture) const {
        return of_texture[as_size(texture)];
    }
};

[[nodiscard]] Materials collect_materials(const Scene& scene);

} // namespace fraja::kernel
