// The scenes of the project as files hold them.
#pragma once

#include "common/base/bytes.hpp"

#include <doctest/doctest.h>
#include <fstream>
#include <iterator>
#include <string>

namespace fraja {

/// The file's content; the test fails when it is not there. `name`: "cone.raj".
inline Bytes scene_text(const std::string& name) {
    std::ifstream file(FRAJA_SOURCE_DIR "/scenes/" + name, std::ios::binary);
    REQUIRE(file);
    return to_bytes(std::string(std::istreambuf_iterator<char>(file), {}));
}

} // namespace fraja
