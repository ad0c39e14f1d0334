// Reads Raja's scene files (.raj): FORMAT.md, sections 1, 2 and 13.
#pragma once

#include "common/base/result.hpp"
#include "common/scene/raj_limits.hpp"
#include "common/scene/scene.hpp"

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace fraja {

/// The scene that `text` describes, in canonical order (canonical_order.hpp). What follows the
/// scene's closing brace is not read. Never throws, whatever the bytes, but for lack of memory.
///
/// Errors: invalid_scene for what Raja refuses to read or fails to draw, limit_exceeded for more
/// than `limits` allow. Messages open with `file_name:line:column: `, both counted from 1, columns
/// in characters. What can be drawn but was hardly meant (a label defined again, a priority without
/// effect) is appended to `warnings`, in the same form, where there is one.
[[nodiscard]] Result<Scene> read_raj(std::string_view text, std::string_view file_name,
                                     const RajLimits& limits = {},
                                     std::vector<std::string>* warnings = nullptr);

/// The same for a file. Errors: also io, when there is none or it cannot be read; limit_exceeded
/// before a file beyond limits.bytes is read.
[[nodiscard]] Result<Scene> read_raj_file(const std::filesystem::path& path,
                                          const RajLimits& limits = {},
                                          std::vector<std::string>* warnings = nullptr);

/// The cameras of a travel, in the order of its frames: the file is a list of them, and of nothing
/// else, at least one. What follows its closing bracket is not read. Errors and limits as
/// read_raj_file()'s.
[[nodiscard]] Result<std::vector<Camera>>
read_raj_cameras(std::string_view text, std::string_view file_name, const RajLimits& limits = {});
[[nodiscard]] Result<std::vector<Camera>> read_raj_cameras_file(const std::filesystem::path& path,
                                                                const RajLimits& limits = {});

} // namespace fraja
