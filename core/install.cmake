# What the authors of plugins outside of the tree need (component `sdk`): headers as they are included here
# (#include "core/plugin_sdk.h" with -I include/teres) and a CMake package.
include(CMakePackageConfigHelpers)
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/teres)
configure_package_config_file(core/teres-config.cmake.in ${PROJECT_BINARY_DIR}/teres-config.cmake
  INSTALL_DESTINATION ${package_dir} PATH_VARS CMAKE_INSTALL_INCLUDEDIR CMAKE_INSTALL_LIBDIR)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/teres-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/teres-config.cmake ${PROJECT_BINARY_DIR}/teres-config-version.cmake
  DESTINATION ${package_dir} COMPONENT sdk)
install(FILES core/plugin.h core/plugin_sdk.h core/result.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/teres/core COMPONENT sdk)
install(DIRECTORY core/extensions DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/teres/core COMPONENT sdk FILES_MATCHING PATTERN "*.h")

# Settings and the bundled recording, found by `teres run` beside the program.
install(DIRECTORY config/ DESTINATION ${CMAKE_INSTALL_DATADIR}/teres/config PATTERN appliance EXCLUDE)
