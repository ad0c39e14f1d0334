#include "common/render/kernel/render.hpp"
#include "common/render/reference/render.hpp"
#include "common/render/render.hpp"

namespace fraja {

std::shared_ptr<const CompiledScene> compile_scene(std::shared_ptr<const Scene> scene,
                                                   Kernel kernel) {
    switch (kernel) {
    case Kernel::reference:
        return reference::compile(std::move(scene));
    case Kernel::fast:
        if (auto compiled = kernel::compile(scene))
            return compiled;
        return reference::compile(std::move(scene)); // right, but slow
    }
    FRAJA_ASSERT(false && "a kernel that does not exist");
    return nullptr;
}

} // namespace fraja
