# fraja_room(<name> [SOURCES ...] [HEADERS ...] [PUBLIC ...] [PRIVATE ...])
#
# One room: the library fraja_<name> (alias fraja::<name>) of the files listed. The target
# all_verify_interface_header_sets compiles each of HEADERS alone, but those that their own source includes first: the
# room's build, unless it is a unity build, has done so.
# PUBLIC rooms show in this room's headers, PRIVATE ones only in its sources.
function(fraja_room name)
    cmake_parse_arguments(ARG "" "" "SOURCES;HEADERS;PUBLIC;PRIVATE" ${ARGN})
    set(target fraja_${name})
    if(ARG_SOURCES)
        add_library(${target} STATIC ${ARG_SOURCES})
        set(scope PUBLIC)
        target_link_libraries(${target} PUBLIC ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE} fraja_flags)
    else()
        add_library(${target} INTERFACE)
        set(scope INTERFACE)
        target_link_libraries(${target} INTERFACE ${ARG_PUBLIC})
        target_compile_features(${target} INTERFACE cxx_std_20)
    endif()
    add_library(fraja::${name} ALIAS ${target})
    target_include_directories(${target} ${scope} ${PROJECT_SOURCE_DIR})
    if(ARG_HEADERS)
        target_sources(${target} ${scope} FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR} FILES ${ARG_HEADERS})
        fraja_compiled_alone(compiled ${ARG_SOURCES})
        set(others ${ARG_HEADERS})
        list(REMOVE_ITEM others ${compiled})
        if(others)
            target_sources(${target} ${scope} FILE_SET others TYPE HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR} FILES ${others})
            set_target_properties(${target} PROPERTIES
                VERIFY_INTERFACE_HEADER_SETS ON INTERFACE_HEADER_SETS_TO_VERIFY others)
        endif()
    endif()
endfunction()

# fraja_compiled_alone(<variable> <source> ...): the headers that are the first thing which their own source includes.
function(fraja_compiled_alone variable)
    set(headers)
    foreach(source IN LISTS ARGN)
        string(REGEX REPLACE "\\.cpp$" ".hpp" header ${source})
        file(RELATIVE_PATH path ${PROJECT_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR}/${header})
        file(STRINGS ${source} first REGEX "^#include" LIMIT_COUNT 1)
        if(first STREQUAL "#include \"${path}\"")
            list(APPEND headers ${header})
        endif()
    endforeach()
    set(${variable} ${headers} PARENT_SCOPE)
endfunction()

# fraja_cold(<source> ...): sources that run once, as those that read command lines: CLI11 takes long to optimise.
function(fraja_cold)
    set_source_files_properties(${ARGN} PROPERTIES COMPILE_OPTIONS "$<$<CONFIG:Release>:-O1>;$<$<CONFIG:RelWithDebInfo>:-O0>")
endfunction()

# fraja_test_settings(<target>): how tests, and libraries of theirs, are compiled. What is tested runs as users run it; the
# tests themselves are to be compiled soon, but those of rays compute much. Most of a test's source is what it includes:
# but for the dev preset, some are compiled as one.
function(fraja_test_settings target)
    get_target_property(links ${target} LINK_LIBRARIES)
    target_link_libraries(${target} PRIVATE fraja_flags)
    target_include_directories(${target} PRIVATE ${PROJECT_SOURCE_DIR})
    target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
    if(NOT "fraja::render" IN_LIST links)
        target_compile_options(${target} PRIVATE $<$<CONFIG:RelWithDebInfo>:-O0>)
    endif()
    if(FRAJA_SANITIZE MATCHES "undefined" AND NOT FRAJA_FUZZ) # what is tested is looked at
        target_compile_options(${target} PRIVATE -fno-sanitize=undefined)
    endif()
    if(CMAKE_BUILD_TYPE STREQUAL "Release") # what these lack of includes only the dev preset sees
        set_target_properties(${target} PROPERTIES UNITY_BUILD ON)
        target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
    endif()
    target_compile_definitions(${target} PRIVATE DOCTEST_CONFIG_SUPER_FAST_ASSERTS
        FRAJA_SOURCE_DIR="${PROJECT_SOURCE_DIR}" FRAJA_BIN_DIR="${CMAKE_RUNTIME_OUTPUT_DIRECTORY}")
    if(FRAJA_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Debug") # a ray costs ten times as much
        target_compile_definitions(${target} PRIVATE FRAJA_INSTRUMENTED)
    endif()
endfunction()

# fraja_test(<name> SOURCES ... LINKS ... [LABELS ...] [TIMEOUT s] [PROCESSORS n] [FIRST]): a doctest program; each TEST_CASE becomes one ctest test.
# FIRST: before the others, as some take long, and a long one that is left at the end has CPUs wait for it.
set(FRAJA_FIRST COST 1000) # the properties of such a test
function(fraja_test name)
    cmake_parse_arguments(ARG "FIRST" "TIMEOUT;PROCESSORS" "SOURCES;LINKS;LABELS" ${ARGN})
    set(target ${name}_test)
    if(NOT TARGET fraja_test_main) # doctest itself is compiled once
        add_library(fraja_test_main OBJECT ${PROJECT_SOURCE_DIR}/tests/support/main.cpp)
        target_link_libraries(fraja_test_main PUBLIC doctest::doctest PRIVATE fraja_flags)
    endif()
    add_executable(${target} ${ARG_SOURCES})
    target_link_libraries(${target} PRIVATE ${ARG_LINKS} fraja_test_main)
    fraja_test_settings(${target})
    set_target_properties(${target} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
    if(NOT ARG_TIMEOUT)
        set(ARG_TIMEOUT 300)
    endif()
    set(properties TIMEOUT ${ARG_TIMEOUT} SKIP_REGULAR_EXPRESSION "TEST SKIPPED") # as tests/support/network.hpp says it
    if(ARG_PROCESSORS)
        list(APPEND properties PROCESSORS ${ARG_PROCESSORS})
    endif()
    if(ARG_FIRST)
        list(APPEND properties ${FRAJA_FIRST})
    endif()
    if(ARG_LABELS)
        list(APPEND properties LABELS ${ARG_LABELS})
    endif()
    doctest_discover_tests(${target} TEST_PREFIX "${name}: " PROPERTIES ${properties})
endfunction()
