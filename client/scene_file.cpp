#include "client/scene_file.hpp"

#include "common/base/missing_file.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "common/scene/raj_reader.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <fstream>

namespace fraja::client {
namespace {

constexpr std::size_t looked_at_bytes = 4096; // to tell what is no text

/// Pictures, programs, archives: no text has a zero.
bool is_binary(const Blob& text) {
    const std::string_view start = as_text(text).substr(0, looked_at_bytes);
    return start.find('\0') != std::string_view::npos;
}

Result<Bytes> read_bytes(const std::filesystem::path& path, std::uint64_t bytes_max) {
    std::error_code error;
    if (std::filesystem::is_directory(path, error))
        return Error{ErrorCode::io, path.string() + ": this is a directory; a scene is a file, as "
                                                    "scenes/cone.raj"};
    std::ifstream file(path, std::ios::binary);
    if (!file && errno == ENOENT)
        return Error{ErrorCode::io, missing_file(path, ".raj")};
    if (!file)
        return Error{ErrorCode::io, path.string() + ": " + std::strerror(errno)};
    Bytes bytes;
    std::vector<char> block(std::size_t{1} << 16); // not by size: it may be a pipe
    while (file.read(block.data(), static_cast<std::streamsize>(block.size())) ||
           file.gcount() > 0) {
        const auto* begin = reinterpret_cast<const std::byte*>(block.data());
        bytes.insert(bytes.end(), begin, begin + file.gcount());
        if (bytes.size() > bytes_max)
            return Error{ErrorCode::limit_exceeded, path.string() + ": a scene has at most " +
                                                        std::to_string(bytes_max) + " bytes"};
    }
    if (file.bad())
        return Error{ErrorCode::io, path.string() + ": cannot be read to its end"};
    return bytes;
}

} // namespace

Result<SceneFile> read_scene_file(const std::filesystem::path& path) {
    const RajLimits limits;
    auto bytes = read_bytes(path, std::min<std::uint64_t>(limits.bytes, protocol::scene_bytes_max));
    if (!bytes)
        return bytes.error();
    SceneFile file;
    file.text = Blob(*std::move(bytes));
    if (is_binary(file.text))
        return Error{ErrorCode::invalid_scene,
                     path.string() + ": this is no scene: a .raj file is text, and opens with "
                                     "raja.renderer.Scene {"};
    if (const auto scene = read_raj(as_text(file.text), path.string(), limits, &file.warnings);
        !scene) {
        Error error = scene.error();
        if (error.message.starts_with(path.string() + ":1:1: ")) // not a word of it is right
            error.message += "; is this a scene? A .raj file opens with raja.renderer.Scene {";
        return error;
    }
    file.hash = protocol::content_hash(file.text);
    return file;
}

Result<void> check_apart(const std::filesystem::path& output, const std::filesystem::path& input) {
    std::error_code ignored; // what is not there is not lost
    if (!std::filesystem::is_regular_file(output, ignored) ||
        !std::filesystem::equivalent(output, input, ignored))
        return {};
    return Error{ErrorCode::invalid_argument,
                 "the picture would replace what it is made of: " + output.string() +
                     (output == input ? "" : " is " + input.string()) +
                     "; choose another file with -o"};
}

} // namespace fraja::client
