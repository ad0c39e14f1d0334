# fraja_kernel_objects(<room>): compiles the room's kernel/isa.cpp once per instruction set and adds the objects.
#
# Inline functions of the standard library are weak symbols: of those in several objects the linker keeps one, and it
# may keep the one with instructions this machine lacks. So each object is closed: all its symbols become local but the
# kernel's entry (a test looks, kernel_symbols).

# GNU's: the linker that comes with Clang cannot merge groups.
find_program(FRAJA_GNU_LD NAMES ld.bfd ld REQUIRED)

function(fraja_kernel_object room isa)
    string(REPLACE "-" "_" suffix ${isa})
    set(entry fraja_kernel_${suffix})
    set(objects ${entry}_objects)
    add_library(${objects} OBJECT kernel/isa.cpp)
    target_link_libraries(${objects} PRIVATE fraja_flags)
    target_include_directories(${objects} PRIVATE ${PROJECT_SOURCE_DIR})
    target_compile_definitions(${objects} PRIVATE FRAJA_KERNEL_ENTRY=${entry} FRAJA_KERNEL_ISA="${isa}")
    if(NOT isa STREQUAL "native")
        target_compile_options(${objects} PRIVATE -march=${isa})
    endif()
    # That wide numbers are passed otherwise with AVX than without does not matter within one object.
    target_compile_options(${objects} PRIVATE $<$<CXX_COMPILER_ID:Clang>:-Wno-psabi>)
    # Unoptimised, wide numbers live in memory, and a picture takes minutes.
    target_compile_options(${objects} PRIVATE $<$<CONFIG:Debug>:-O2>)
    set(closed ${CMAKE_CURRENT_BINARY_DIR}/${entry}.o)
    add_custom_command(OUTPUT ${closed}
        COMMAND ${FRAJA_GNU_LD} -r --force-group-allocation -o ${closed}.open $<TARGET_OBJECTS:${objects}>
        COMMAND ${CMAKE_OBJCOPY} --keep-global-symbol=${entry} ${closed}.open ${closed}
        DEPENDS ${objects} $<TARGET_OBJECTS:${objects}>
        COMMENT "Closing the kernel for ${isa}" VERBATIM COMMAND_EXPAND_LISTS)
    set_source_files_properties(${closed} PROPERTIES EXTERNAL_OBJECT ON GENERATED ON)
    target_sources(fraja_${room} PRIVATE ${closed})
    set_property(TARGET fraja_${room} APPEND PROPERTY FRAJA_CLOSED_KERNELS ${closed})
endfunction()

function(fraja_kernel_objects room)
    if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
        foreach(isa x86-64-v2 x86-64-v3 x86-64-v4)
            fraja_kernel_object(${room} ${isa})
        endforeach()
    else()
        fraja_kernel_object(${room} native)
    endif()
endfunction()
