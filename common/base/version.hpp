// The version of this build.
#pragma once

#include <string>
#include <string_view>

namespace fraja {

/// "0.1.0": the release, from the project's CMakeLists.txt.
inline constexpr std::string_view version = FRAJA_VERSION;

/// git's at the time of the build: "0123456789ab", with "+changes" where the tree had some;
/// "unknown" without git.
[[nodiscard]] std::string_view revision();

/// The level of the instruction set that this build needs everywhere.
[[nodiscard]] std::string_view isa_level();

/// "Fraja 0.1.0, revision 0123456789ab": which build of a program this is.
[[nodiscard]] std::string build_line(std::string_view program);

/// What --version prints: "fraja-worker 0.1.0, revision 0123456789ab, x86-64-v3"; last the level of
/// the instruction set in use: a program that renders has one of its own.
[[nodiscard]] std::string version_line(std::string_view program,
                                       std::string_view isa = isa_level());

} // namespace fraja
