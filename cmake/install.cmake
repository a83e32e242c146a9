# `cmake --install`: the command, the C library with its header, and what finds them (pkg-config, CMake).
include(CMakePackageConfigHelpers)

install(TARGETS atomcam RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
install(
  TARGETS atomcam_c
  EXPORT atomcamTargets
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(FILES src/capi/atomcam.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(DIRECTORY examples/c DESTINATION ${CMAKE_INSTALL_DOCDIR}/examples)

set(config_folder ${CMAKE_INSTALL_LIBDIR}/cmake/atomcam)
file(WRITE ${PROJECT_BINARY_DIR}/atomcamConfig.cmake "include(\${CMAKE_CURRENT_LIST_DIR}/atomcamTargets.cmake)\n")
write_basic_package_version_file(${PROJECT_BINARY_DIR}/atomcamConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/atomcamConfig.cmake ${PROJECT_BINARY_DIR}/atomcamConfigVersion.cmake
        DESTINATION ${config_folder})
install(
  EXPORT atomcamTargets
  NAMESPACE atomcam::
  DESTINATION ${config_folder})

# The prefix follows from where the file lies, so an installed tree may be moved.
file(RELATIVE_PATH to_prefix /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
configure_file(cmake/atomcam.pc.in ${PROJECT_BINARY_DIR}/atomcam.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/atomcam.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
