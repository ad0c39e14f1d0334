# cmake -DSCDOC=<scdoc> -DGZIP=<gzip> -DVERSION=<version> [-DPROGRAM=<program>] -DSOURCE=<page.scd.in> -DOUT=<page>
#     -P write_page.cmake
# puts what the program says of its commands and options into the page's prose, and has scdoc write <page>.gz.
cmake_minimum_required(VERSION 3.25)
file(READ ${SOURCE} text)
if(PROGRAM)
    execute_process(COMMAND ${PROGRAM} --manual OUTPUT_VARIABLE sections COMMAND_ERROR_IS_FATAL ANY)
    string(REPLACE "@SECTIONS@" "${sections}" text "${text}")
endif()
string(REPLACE "@VERSION@" "${VERSION}" text "${text}")
file(WRITE ${OUT}.scd "${text}")
execute_process(COMMAND ${SCDOC} INPUT_FILE ${OUT}.scd OUTPUT_FILE ${OUT} COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${GZIP} --best --no-name --force ${OUT} COMMAND_ERROR_IS_FATAL ANY)
