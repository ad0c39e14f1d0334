// Settings in words: for people, and for the files that pictures are.
#pragma once

#include "common/image_io/picture_file.hpp"
#include "common/protocol/messages.hpp"

#include <string>
#include <vector>

namespace fraja::client {

[[nodiscard]] std::string to_string(protocol::KernelChoice kernel);
[[nodiscard]] std::string to_string(protocol::PixelFilter filter);
/// For people: "640x480", or "640x480, of it 0,0,32,32".
[[nodiscard]] std::string extent_text(const protocol::PictureSettings& settings);
/// For people: what decides the pixels beside scene and size.
[[nodiscard]] std::string settings_text(const protocol::PictureSettings& settings);
/// The same, and the size, as fraja-submit takes it: "-r 640x480 -d 5 -a 4".
[[nodiscard]] std::string settings_options(const protocol::PictureSettings& settings);

/// What it takes to make a job's picture again, `more_options` beside its settings, and what making
/// it took: rays, times, and when; and of one that is not done how far it is.
/// Where SOURCE_DATE_EPOCH is set in the environment only what decides the pixels, so that two
/// renders of one picture give the same file.
[[nodiscard]] std::vector<PictureAttribute>
picture_attributes(const protocol::JobState& job, const std::string& more_options = {});

} // namespace fraja::client
