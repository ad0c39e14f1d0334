// A film as few levels, to be looked at in a terminal.
#pragma once

#include "common/image/film.hpp"
#include "common/image_io/picture_file.hpp"

namespace fraja::client {

/// The film's region in another size: each pixel is the mean of the 8-bit levels (those of a .png)
/// that lie below it, by area; where it is enlarged, that is the nearest. Neither may be empty
/// (asserted).
[[nodiscard]] LevelsPicture shrink(const Film& film, Extent size);

} // namespace fraja::client
