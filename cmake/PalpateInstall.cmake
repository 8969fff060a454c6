# What is installed, and for whom. Components are the Debian packages of PalpatePackage.cmake, but for `python`, which
# belongs to a target palpate_python where there is one.
include(CMakePackageConfigHelpers)

set(PALPATE_CMAKE_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/palpate)
install(TARGETS palpate_library_haptics EXPORT palpateTargets
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT libpalpate-haptics0 NAMELINK_COMPONENT libpalpate-dev)
install(TARGETS palpate_library EXPORT palpateTargets
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT libpalpate0 NAMELINK_COMPONENT libpalpate-dev)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/palpate DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT libpalpate-dev)

# find_package(palpate)
install(EXPORT palpateTargets NAMESPACE palpate:: DESTINATION ${PALPATE_CMAKE_DIR} COMPONENT libpalpate-dev)
file(WRITE ${PROJECT_BINARY_DIR}/palpateConfig.cmake
     "# Targets: palpate::haptics (the haptic loop alone) and palpate::palpate (everything).
include(\${CMAKE_CURRENT_LIST_DIR}/palpateTargets.cmake)\n")
# Before 1.0 a minor version may differ from the one before.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/palpateConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/palpateConfig.cmake ${PROJECT_BINARY_DIR}/palpateConfigVersion.cmake
        DESTINATION ${PALPATE_CMAKE_DIR} COMPONENT libpalpate-dev)

# pkg-config palpate, palpate-haptics; folders relative to where the file lies, so that the tree may be moved
file(RELATIVE_PATH PALPATE_PREFIX /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
string(REGEX REPLACE "/$" "" PALPATE_PREFIX "${PALPATE_PREFIX}")
function(palpate_pkg_config name library description requires)
  set(file ${PROJECT_BINARY_DIR}/${name}.pc)
  file(WRITE ${file} "prefix=\${pcfiledir}/${PALPATE_PREFIX}
libdir=\${prefix}/${CMAKE_INSTALL_LIBDIR}
includedir=\${prefix}/${CMAKE_INSTALL_INCLUDEDIR}

Name: ${name}
Description: ${description}
Version: ${PROJECT_VERSION}
Requires: ${requires}
Libs: -L\${libdir} -l${library}
Cflags: -I\${includedir}
")
  install(FILES ${file} DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT libpalpate-dev)
endfunction()
palpate_pkg_config(palpate-haptics palpate-haptics "haptic loop at 1 kHz for simulations at 30 Hz" "")
palpate_pkg_config(palpate palpate "soft bodies in contact, felt through a handle" "palpate-haptics = ${PROJECT_VERSION}")

if(PALPATE_PROGRAM)
  install(TARGETS palpate RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT palpate)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/scenes DESTINATION ${CMAKE_INSTALL_DATADIR}/palpate COMPONENT palpate
          FILES_MATCHING PATTERN "*.yaml")
endif()
