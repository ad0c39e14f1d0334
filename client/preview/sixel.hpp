// A picture in sixels, by libchafa, where that is installed.
#pragma once

#include "common/base/result.hpp"
#include "common/image_io/picture_file.hpp"

#include <string>

namespace fraja::client {

/// Whether libchafa is there to be loaded. It is, at the first question, for good.
[[nodiscard]] Result<void> check_sixel();

/// From the cursor on, one pixel of the picture for each of the display. Errors: as check_sixel().
[[nodiscard]] Result<std::string> sixel_image(const LevelsPicture& levels);

} // namespace fraja::client
