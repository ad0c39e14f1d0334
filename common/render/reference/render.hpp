// The reference kernel: Raja's own arithmetic, plain and scalar, written straight from FORMAT.md.
#pragma once

#include "common/render/render.hpp"

#include <memory>

namespace fraja::reference {

[[nodiscard]] std::shared_ptr<const CompiledScene> compile(std::shared_ptr<const Scene> scene);

} // namespace fraja::reference
