# What `cmake --install` installs beside the programs, their library and their manual pages. Each program is a component of its
# own, but that the three of a client are one: broker, worker, client.

# A script for each program and shell, as the program prints it, under the name where shells look for it.
function(fraja_install_completion program component)
    set(folder ${CMAKE_BINARY_DIR}/completion)
    set(destination_bash ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
    set(destination_zsh ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions)
    set(destination_fish ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d)
    set(name_bash ${program})
    set(name_zsh _${program})
    set(name_fish ${program}.fish)
    foreach(shell bash zsh fish)
        set(script ${folder}/${shell}/${name_${shell}})
        add_custom_command(OUTPUT ${script}
            COMMAND ${CMAKE_COMMAND} -E make_directory ${folder}/${shell}
            COMMAND ${program} --completion ${shell} > ${script}
            DEPENDS ${program} COMMENT "Asking ${program} how ${shell} completes it" VERBATIM)
        set_property(GLOBAL APPEND PROPERTY FRAJA_COMPLETION ${script})
        install(FILES ${script} DESTINATION ${destination_${shell}} COMPONENT ${component})
    endforeach()
endfunction()

fraja_install_completion(fraja-broker broker)
fraja_install_completion(fraja-worker worker)
foreach(program fraja-submit fraja-watch fraja-ctl)
    fraja_install_completion(${program} client)
endforeach()
get_property(scripts GLOBAL PROPERTY FRAJA_COMPLETION)
add_custom_target(completion DEPENDS ${scripts})
add_dependencies(programs completion)

install(DIRECTORY scenes/ DESTINATION ${CMAKE_INSTALL_DATADIR}/fraja/scenes COMPONENT client
    FILES_MATCHING PATTERN "*.raj" PATTERN invalid EXCLUDE)
install(FILES README.md ARCHITECTURE.md SECURITY.md DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/fraja-client COMPONENT client)

# Services are those of the programs that they are called after. They say /usr/bin, where packages put these: under another
# prefix that is for the administrator to change.
foreach(component broker worker)
    file(GLOB units CONFIGURE_DEPENDS tools/systemd/fraja-${component}*.service)
    install(FILES ${units} DESTINATION lib/systemd/system COMPONENT ${component})
endforeach()

# Several workers of one machine: fraja-worker@NAME, each with a file of its own beside the one for all.
file(READ tools/systemd/fraja-worker.service unit)
foreach(change
        "Description=Fraja worker:|Description=Fraja worker %i:"
        "EnvironmentFile=-/etc/default/fraja|EnvironmentFile=-/etc/default/fraja\nEnvironmentFile=-/etc/default/fraja-%i"
        "--color never|--color never --name %H:%i")
    string(REPLACE "|" ";" change "${change}")
    list(POP_FRONT change from to)
    string(FIND "${unit}" "${from}" at)
    if(at EQUAL -1)
        message(FATAL_ERROR "tools/systemd/fraja-worker.service has no '${from}', of which fraja-worker@.service is made")
    endif()
    string(REPLACE "${from}" "${to}" unit "${unit}")
endforeach()
string(PREPEND unit "# One of several workers on this machine, fraja-worker@NAME: what is its own stands in /etc/default/fraja-NAME, such as\n"
    "# FRAJA_WORKER_OPTIONS='-j 8 --tag node=0'. Which processors it has: systemctl set-property fraja-worker@NAME AllowedCPUs=0-7\n#\n")
file(CONFIGURE OUTPUT systemd/fraja-worker@.service CONTENT "${unit}" @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/systemd/fraja-worker@.service DESTINATION lib/systemd/system COMPONENT worker)

# As Debian has them for each package; anywhere else they do no harm.
string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
find_program(FRAJA_GZIP gzip)
foreach(component broker worker client)
    set(documents ${CMAKE_INSTALL_DATADIR}/doc/fraja-${component})
    install(FILES tools/debian/copyright DESTINATION ${documents} COMPONENT ${component})
    if(FRAJA_GZIP)
        set(changelog ${CMAKE_BINARY_DIR}/debian/${component}/changelog)
        configure_file(tools/debian/changelog.in ${changelog})
        execute_process(COMMAND ${FRAJA_GZIP} --best --no-name --force ${changelog} COMMAND_ERROR_IS_FATAL ANY)
        install(FILES ${changelog}.gz DESTINATION ${documents} COMPONENT ${component})
    endif()
endforeach()
