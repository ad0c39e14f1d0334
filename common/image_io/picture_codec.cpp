#include "common/image_io/picture_codec.hpp"

#include "common/image_io/replace_file.hpp"

#include <dlfcn.h>

namespace fraja {
namespace {

namespace fs = std::filesystem;

Result<const PictureCodec*> load() {
    std::error_code ec;
    const fs::path program = fs::read_symlink("/proc/self/exe", ec);
    if (!program.is_absolute())
        return io_error("/proc/self/exe", ec ? ec.message() : "is no absolute path");
    const fs::path library = (program.parent_path() / FRAJA_PICTURE_CODEC_FILE).lexically_normal();
    const auto failed = [&](const std::string& why) {
        return io_error(library, why + " (without this library, which belongs to the program, no "
                                       "picture can be read or written)");
    };
    if (!fs::exists(library, ec))
        return failed(ec ? ec.message() : "there is no such file");
    void* const handle = ::dlopen(library.c_str(), RTLD_LAZY | RTLD_LOCAL);
    if (!handle)
        return failed(::dlerror());
    const auto entry =
        reinterpret_cast<const PictureCodec* (*)()>(::dlsym(handle, FRAJA_PICTURE_CODEC_ENTRY));
    if (!entry)
        return failed("is of another version than " + program.filename().string());
    return entry();
}

} // namespace

Result<const PictureCodec*> picture_codec() {
    static const Result<const PictureCodec*> codec = load();
    return codec;
}

} // namespace fraja
