// A folder of its own for one test.
#pragma once

#include "common/base/ids.hpp"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>

namespace fraja {

/// Gone with its test.
struct Folder {
    std::filesystem::path path =
        std::filesystem::temp_directory_path() / ("fraja-test-" + to_string(random_id<Nonce>()));
    Folder() { std::filesystem::create_directory(path); }
    ~Folder() { std::filesystem::remove_all(path); }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;

    std::filesystem::path operator/(std::string_view name) const { return path / name; }
    /// A file of these bytes.
    [[nodiscard]] std::filesystem::path write(std::string_view name, std::string_view bytes) const {
        std::ofstream(path / name, std::ios::binary) << bytes;
        return path / name;
    }
    [[nodiscard]] auto file_count() const {
        return std::distance(std::filesystem::directory_iterator(path),
                             std::filesystem::directory_iterator());
    }
};

} // namespace fraja
