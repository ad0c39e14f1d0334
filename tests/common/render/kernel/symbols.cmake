# Fails unless ENTRY is the only symbol, weak ones included, that OBJECT shows to the linker.
execute_process(COMMAND ${NM} --defined-only --extern-only --format=posix ${OBJECT}
    OUTPUT_VARIABLE symbols OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "[^\n]+" lines "${symbols}")
list(LENGTH lines count)
if(NOT count EQUAL 1 OR NOT symbols MATCHES "^${ENTRY} ")
    message(FATAL_ERROR "${OBJECT} shows these symbols, and only ${ENTRY} may be among them:\n${symbols}")
endif()
