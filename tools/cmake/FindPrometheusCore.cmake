# prometheus-cpp's serializer, without what its CMake package asks for (a web server, curl): found through pkg-config,
# offered as prometheus::core.
find_package(PkgConfig QUIET)
if(PkgConfig_FOUND)
    pkg_check_modules(PrometheusCore QUIET IMPORTED_TARGET prometheus-cpp-core)
endif()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(PrometheusCore REQUIRED_VARS PrometheusCore_LIBRARIES VERSION_VAR PrometheusCore_VERSION)
if(PrometheusCore_FOUND AND NOT TARGET prometheus::core)
    add_library(prometheus::core ALIAS PkgConfig::PrometheusCore)
endif()
