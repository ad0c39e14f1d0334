// The kernel that users get: fast, and right where Raja's own arithmetic is not.
#pragma once

#include "common/render/kernel/solids.hpp"
#include "common/render/kernel/tables.hpp"
#include "common/render/render.hpp"

#include <memory>
#include <string>

namespace fraja::kernel {

/// Nothing for the rare scene it has no program for (Program::compile).
[[nodiscard]] std::shared_ptr<const CompiledScene> compile(std::shared_ptr<const Scene> scene);

/// Likewise with an entry of usable_entries(), and other limits: for tests.
[[nodiscard]] std::shared_ptr<const CompiledScene> compile_for(const KernelEntry& entry,
                                                               std::shared_ptr<const Scene> scene,
                                                               const SolidLimits& limits = {});

/// The instruction set in use: the best of this machine's, or what FRAJA_ISA names. One that is
/// unknown, or that this machine lacks, is the error to show before anything is drawn.
[[nodiscard]] Result<std::string> instruction_set();

} // namespace fraja::kernel
