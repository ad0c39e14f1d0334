# fraja_embed(<variable> NAMESPACE ... HEADER ... FILES ...): a source that the build makes of text files, which become
# part of the program. HEADER declares, in NAMESPACE, `struct Asset { std::string_view name, type, text; }` and
# `std::span<const Asset> <variable>()`. The source's path is stored in <variable>.
function(fraja_embed variable)
    cmake_parse_arguments(ARG "" "NAMESPACE;HEADER" "FILES" ${ARGN})
    set(paths)
    foreach(file IN LISTS ARG_FILES)
        list(APPEND paths ${CMAKE_CURRENT_SOURCE_DIR}/${file})
    endforeach()
    set(source ${CMAKE_CURRENT_BINARY_DIR}/${variable}.cpp)
    set(script ${PROJECT_SOURCE_DIR}/tools/cmake/embed_files.cmake)
    add_custom_command(OUTPUT ${source}
        COMMAND ${CMAKE_COMMAND} "-Dsource=${source}" "-Dfunction=${variable}" "-Dnamespace=${ARG_NAMESPACE}"
            "-Dheader=${ARG_HEADER}" "-Dfiles=${paths}" -P ${script}
        DEPENDS ${paths} ${script} VERBATIM)
    set(${variable} ${source} PARENT_SCOPE)
endfunction()
