// The scenes of the project as files hold them.
#pragma once

#include "common/base/bytes.hpp"
#include "tests/support/file_bytes.hpp"

#include <string>

namespace fraja {

/// The file's content; the test fails when it is not there. `name`: "cone.raj".
inline Bytes scene_text(const std::string& name) {
    return to_bytes(bytes_of(FRAJA_SOURCE_DIR "/scenes/" + name));
}

} // namespace fraja
