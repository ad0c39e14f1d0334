#include "common/base/missing_file.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <iterator>
#include <string_view>
#include <system_error>
#include <vector>

namespace fraja {
namespace {

namespace fs = std::filesystem;

/// In their order, so that of several that are as near the same one is named every time.
std::vector<std::string> names_in(const fs::path& folder) {
    std::error_code error;
    std::vector<std::string> names;
    for (fs::directory_iterator entry(folder, error), end;
         !error && entry != end && names.size() < names_looked_at_max; entry.increment(error))
        if (std::error_code ignored; !entry->is_directory(ignored))
            names.push_back(entry->path().filename().string());
    std::ranges::sort(names);
    return names;
}

} // namespace

std::string missing_file(const fs::path& path, const fs::path& wanted) {
    const std::string opening = path.string() + ": there is no such file";
    const auto names = names_in(path.has_parent_path() ? path.parent_path() : fs::path("."));
    std::vector<std::string_view> all(names.begin(), names.end());
    std::vector<std::string_view> likely;
    std::ranges::copy_if(all, std::back_inserter(likely), [&](std::string_view name) {
        return fs::path(name).extension() == wanted;
    });
    for (const std::vector<std::string_view>* views : {&likely, &all})
        if (const auto meant = meant_name(path.filename().string(), *views))
            return opening + did_you_mean((path.parent_path() / *meant).string());
    std::error_code error;
    const fs::path here = fs::current_path(error);
    return opening + (path.is_absolute() ? "" : " in " + (error ? "this folder" : here.string()));
}

} // namespace fraja
