# Debian packages, made by tools/package: fraja-broker, fraja-worker, fraja-client. Three, since a machine that renders needs
# five libraries, and one that writes pictures needs OpenImageIO, which brings some three hundred packages. dpkg-shlibdeps
# says what each needs.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME fraja)
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "") # each package has its own
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_CONTACT ${FRAJA_MAINTAINER})
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL broker worker client)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
    OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)

set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS OFF)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(whole "Ray-traced pictures on many machines: a broker deals out the tiles of a picture
to workers wherever they are, and clients submit scenes, watch tiles arrive and
write the pictures. Machines may join, leave and die meanwhile.
.")
foreach(component broker worker client)
    string(TOUPPER ${component} upper)
    set(CPACK_DEBIAN_${upper}_PACKAGE_NAME fraja-${component})
endforeach()
set(CPACK_COMPONENT_BROKER_DESCRIPTION "broker of the ray tracer Fraja\n${whole}\nThis is the broker.")
set(CPACK_COMPONENT_WORKER_DESCRIPTION "worker of the ray tracer Fraja\n${whole}\nThis is what renders: for every machine that is to help.")
set(CPACK_COMPONENT_CLIENT_DESCRIPTION "clients of the ray tracer Fraja, and scenes\n${whole}\nThese are fraja-submit, which also renders without a broker, fraja-watch and
fraja-ctl.")
set(CPACK_DEBIAN_CLIENT_PACKAGE_RECOMMENDS "fraja-broker, fraja-worker")

# A service is neither enabled nor started by being installed: a broker opens ports, a worker takes every CPU.
foreach(component broker worker)
    string(TOUPPER ${component} upper)
    set(scripts ${CMAKE_BINARY_DIR}/debian/${component})
    foreach(script postinst prerm postrm)
        configure_file(tools/debian/${script}.in ${scripts}/${script} @ONLY
            FILE_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
    endforeach()
    file(GLOB unit tools/systemd/fraja-${component}.service)
    if(unit)
        set(CPACK_DEBIAN_${upper}_PACKAGE_CONTROL_EXTRA "${scripts}/postinst;${scripts}/prerm;${scripts}/postrm")
    endif()
endforeach()
include(CPack)
