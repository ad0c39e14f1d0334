#include "common/render/kernel/dispatch.hpp"

#include <algorithm>
#include <cstdlib>
#include <string>
#include <vector>

extern "C" {
#if defined(__x86_64__)
extern const fraja::kernel::KernelEntry fraja_kernel_x86_64_v2;
extern const fraja::kernel::KernelEntry fraja_kernel_x86_64_v3;
extern const fraja::kernel::KernelEntry fraja_kernel_x86_64_v4;
#else
extern const fraja::kernel::KernelEntry fraja_kernel_native;
#endif
}

namespace fraja::kernel {
namespace {

#if defined(__x86_64__)
struct Levels {
    bool v2, v3, v4;
};
Levels levels() {
#if defined(__clang__) // does not know them by name
    const bool v2 = __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("popcnt");
    const bool v3 = v2 && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
                    __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
    const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                    __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                    __builtin_cpu_supports("avx512vl");
    return {v2, v3, v4};
#else
    return {__builtin_cpu_supports("x86-64-v2") != 0, __builtin_cpu_supports("x86-64-v3") != 0,
            __builtin_cpu_supports("x86-64-v4") != 0};
#endif
}
#endif

std::vector<const KernelEntry*> find_usable() {
#if defined(__x86_64__)
    const Levels level = levels();
    std::vector<const KernelEntry*> entries;
    if (level.v2)
        entries.push_back(&fraja_kernel_x86_64_v2);
    if (level.v3)
        entries.push_back(&fraja_kernel_x86_64_v3);
    if (level.v4)
        entries.push_back(&fraja_kernel_x86_64_v4);
    return entries;
#else
    return {&fraja_kernel_native};
#endif
}

} // namespace

std::span<const KernelEntry* const> usable_entries() {
    static const std::vector<const KernelEntry*> entries = find_usable();
    return entries;
}

Result<const KernelEntry*> choose_entry(std::string_view isa) {
    const auto entries = usable_entries();
    if (entries.empty())
        return Error{ErrorCode::invalid_argument,
                     "this processor is older than x86-64-v2, which the kernel needs; "
                     "use --kernel reference"};
    if (isa.empty())
        return entries.back();
    const auto at = std::find_if(entries.begin(), entries.end(), [&](const KernelEntry* e) {
        const std::string_view name = e->isa; // x86-64-v3, or v3
        return isa == name || isa == name.substr(name.rfind('-') + 1);
    });
    if (at != entries.end())
        return *at;
    std::string usable;
    for (const KernelEntry* entry : entries)
        usable += std::string(usable.empty() ? "" : ", ") + entry->isa;
    return Error{ErrorCode::invalid_argument, "FRAJA_ISA=" + std::string(isa) +
                                                  " is not an instruction set of this machine's; "
                                                  "these are: " +
                                                  usable};
}

Result<const KernelEntry*> chosen_entry() {
    static const Result<const KernelEntry*> chosen = [] {
        const char* isa = std::getenv("FRAJA_ISA");
        return choose_entry(isa ? isa : "");
    }();
    return chosen;
}

} // namespace fraja::kernel
