#include "common/base/version.hpp"

#include "fraja_revision.hpp" // made by the build

namespace fraja {

std::string_view isa_level() {
    return
#if defined(__AVX512F__)
        "x86-64-v4";
#elif defined(__AVX2__)
        "x86-64-v3";
#elif defined(__SSE4_2__)
        "x86-64-v2";
#elif defined(__x86_64__)
        "x86-64";
#elif defined(__aarch64__)
        "arm64";
#else
        "generic";
#endif
}

std::string_view revision() {
    return FRAJA_REVISION;
}

std::string build_line(std::string_view program) {
    return std::string(program) + " " + std::string(version) + ", revision " +
           std::string(revision());
}

std::string version_line(std::string_view program, std::string_view isa) {
    return build_line(program) + ", " + std::string(isa);
}

} // namespace fraja
