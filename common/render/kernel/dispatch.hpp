// Which of the kernels in this binary runs on this machine.
#pragma once

#include "common/base/result.hpp"
#include "common/render/kernel/tables.hpp"

#include <span>
#include <string_view>

namespace fraja::kernel {

/// Those that this machine can run, the best one last. At least one.
[[nodiscard]] std::span<const KernelEntry* const> usable_entries();

/// The entry of that name, x86-64-v3; the best one for an empty name.
[[nodiscard]] Result<const KernelEntry*> choose_entry(std::string_view isa);

/// By the environment's FRAJA_ISA, read once.
[[nodiscard]] Result<const KernelEntry*> chosen_entry();

} // namespace fraja::kernel
