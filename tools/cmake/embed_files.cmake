# Writes the source that fraja_embed() promises. -Dsource -Dfunction -Dnamespace -Dheader -Dfiles
set(types "html=text/html" "css=text/css" "js=text/javascript" "svg=image/svg+xml")
set(entries)
foreach(file IN LISTS files)
    get_filename_component(name ${file} NAME)
    get_filename_component(extension ${file} LAST_EXT)
    string(SUBSTRING ${extension} 1 -1 extension)
    set(type ${types})
    list(FILTER type INCLUDE REGEX "^${extension}=")
    string(REGEX REPLACE "^[a-z]+=" "" type "${type}")
    if(NOT type)
        message(FATAL_ERROR "${file}: embed_files.cmake knows no type for .${extension}")
    endif()
    file(READ ${file} text)
    string(APPEND entries "    {\"${name}\", \"${type}; charset=utf-8\", R\"~~fraja~~(${text})~~fraja~~\"},\n")
endforeach()
file(WRITE ${source} "// Made by tools/cmake/embed_files.cmake.
#include \"${header}\"

#include <array>

namespace ${namespace} {
namespace {

constexpr auto assets = std::to_array<Asset>({
${entries}});

} // namespace

std::span<const Asset> ${function}() {
    return assets;
}

} // namespace ${namespace}
")
