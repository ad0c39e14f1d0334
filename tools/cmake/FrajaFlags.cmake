# fraja_flags: the warnings, the language and the floating-point rules every target is built with.
option(FRAJA_WERROR "Treat warnings as errors (CI does)" OFF)
set(FRAJA_SANITIZE "" CACHE STRING "Sanitizers to build with: address,undefined or thread")
set(FRAJA_MAINTAINER "Fraja maintainers <maintainers@fraja.invalid>" CACHE STRING "Who answers for packages")
set(FRAJA_TESTS all CACHE STRING "Which tests to build: all, or optimised (what computes, draws or runs as processes)")
option(FRAJA_FUZZ "Link tests/fuzz with Clang's libFuzzer (preset fuzz)" OFF)

add_library(fraja_flags INTERFACE)
target_compile_features(fraja_flags INTERFACE cxx_std_20)
target_compile_options(fraja_flags INTERFACE
    -Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wshadow -Wold-style-cast
    -ffp-contract=off) # a fused multiply-add would change the picture's bits
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
    # GCC 12 sees overlaps in "text" + std::string(...) that are not there: GCC bug 105651.
    target_compile_options(fraja_flags INTERFACE -Wno-restrict)
endif()
if(CMAKE_UNITY_BUILD) # what is right in its own file: builds without unity see to these
    target_compile_options(fraja_flags INTERFACE -Wno-shadow $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
endif()
if(FRAJA_WERROR)
    target_compile_options(fraja_flags INTERFACE -Werror)
endif()
if(FRAJA_SANITIZE)
    target_compile_options(fraja_flags INTERFACE -fsanitize=${FRAJA_SANITIZE} -fno-omit-frame-pointer)
    target_link_options(fraja_flags INTERFACE -fsanitize=${FRAJA_SANITIZE})
    find_program(FRAJA_MOLD mold)
    if(FRAJA_MOLD) # GNU's linker takes seven times as long
        target_link_options(fraja_flags INTERFACE -fuse-ld=mold)
    endif()
    if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU") # what sanitizers put between looks uninitialised to GCC
        target_compile_options(fraja_flags INTERFACE -Wno-maybe-uninitialized)
    endif()
    if(FRAJA_SANITIZE MATCHES "undefined")
        target_compile_options(fraja_flags INTERFACE -fno-sanitize-recover=all)
        if(NOT FRAJA_FUZZ) # pointers that lead nowhere are found by the other one, at half the time to compile
            target_compile_options(fraja_flags INTERFACE -fno-sanitize=null,alignment,object-size,vptr)
        endif()
    endif()
endif()
if(FRAJA_FUZZ)
    target_compile_options(fraja_flags INTERFACE
        -fsanitize-ignorelist=${PROJECT_SOURCE_DIR}/tools/sanitizers/fuzz.ignore)
endif()

set(CMAKE_INTERPROCEDURAL_OPTIMIZATION OFF)
find_program(FRAJA_CCACHE ccache)
if(FRAJA_CCACHE)
    set(CMAKE_CXX_COMPILER_LAUNCHER ${FRAJA_CCACHE})
endif()
