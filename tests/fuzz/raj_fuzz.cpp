// The reader of .raj: any text, as a scene and as a travel. What reads is written and read again;
// what is small is compiled.
#include "common/base/assert.hpp"
#include "common/render/render.hpp"
#include "common/scene/raj_reader.hpp"
#include "common/scene/raj_writer.hpp"

#include <cstddef>
#include <cstdint>

using namespace fraja;

namespace {

/// Few ways through a scene of labels: a run takes a millisecond at most.
constexpr RajLimits limits{.bytes = 1 << 16, .token_bytes = 500, .expanded_parts = 2'000};
constexpr std::size_t compiled_parts_max = 60;

void read_travel(const std::string& text) {
    const auto cameras = read_raj_cameras(text, "fuzz.raj", limits);
    if (cameras)
        FRAJA_ASSERT(!cameras->empty());
    else
        FRAJA_ASSERT(cameras.error().message.starts_with("fuzz.raj:"));
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::string text(data, data + size);
    read_travel(text);
    std::vector<std::string> warnings;
    const auto scene = read_raj(text, "fuzz.raj", limits, &warnings);
    for (const std::string& warning : warnings)
        FRAJA_ASSERT(warning.starts_with("fuzz.raj:"));
    if (!scene) {
        FRAJA_ASSERT(scene.error().message.starts_with("fuzz.raj:"));
        return 0;
    }
    const auto again = read_raj(write_raj(*scene), "again.raj");
    FRAJA_ASSERT(again.has_value());
    FRAJA_ASSERT(*again == *scene);
    if (scene->solids.size() + scene->textured_forms.size() > compiled_parts_max)
        return 0;
    const auto shared = std::make_shared<const Scene>(*scene);
    for (const Kernel kernel : {Kernel::fast, Kernel::reference})
        FRAJA_ASSERT(compile_scene(shared, kernel) != nullptr);
    return 0;
}
