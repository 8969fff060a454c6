# Debian packages, one a component, by cpack in build/package: program, libraries, what is needed to build with them, and
# Python where there is a target palpate_python. Checked by tools/check_packages.
set(PALPATE_CONTACT "The Palpate authors <palpate@palpate.invalid>" CACHE STRING "Maintainer of the packages")
set(CPACK_PACKAGE_CONTACT ${PALPATE_CONTACT})
set(CPACK_PACKAGE_NAME palpate)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_VENDOR "Palpate")
set(CPACK_STRIP_FILES ON)
set(CPACK_GENERATOR DEB)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ
                                                WORLD_EXECUTE)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SOURCE palpate)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${PROJECT_BINARY_DIR}/src/palpate/library)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(same "(= ${PROJECT_VERSION}-1)")

# Every package says what is new and under which license it is.
configure_file(${PROJECT_SOURCE_DIR}/packaging/changelog.in ${PROJECT_BINARY_DIR}/changelog.Debian)
execute_process(COMMAND gzip -9nkf ${PROJECT_BINARY_DIR}/changelog.Debian COMMAND_ERROR_IS_FATAL ANY)

# palpate_package(COMPONENT NAME SECTION DEPENDS SUMMARY TEXT): the package of a component.
set(CPACK_COMPONENTS_ALL "")
function(palpate_package component name section depends summary text)
  list(APPEND CPACK_COMPONENTS_ALL ${component})
  string(TOUPPER ${component} upper)
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${name} PARENT_SCOPE)
  set(CPACK_DEBIAN_${upper}_PACKAGE_SECTION ${section} PARENT_SCOPE)
  set(CPACK_DEBIAN_${upper}_PACKAGE_DEPENDS ${depends} PARENT_SCOPE)
  set(CPACK_DEBIAN_${upper}_DESCRIPTION "${summary}\n${text}" PARENT_SCOPE)
  set(CPACK_COMPONENTS_ALL ${CPACK_COMPONENTS_ALL} PARENT_SCOPE)
  install(FILES ${PROJECT_SOURCE_DIR}/packaging/copyright ${PROJECT_BINARY_DIR}/changelog.Debian.gz
          DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${name} COMPONENT ${component})
endfunction()

if(PALPATE_PROGRAM)
  palpate_package(palpate palpate science "" "soft objects held by a handle, felt at 1 kHz"
                  "A person holds a soft object by a handle, pushes it into things and feels
it at 1 kHz, while the whole scene (deformation, contact, friction) is
simulated at 30 Hz. Program with a viewer in the browser, and scenes.")
endif()
palpate_package(libpalpate0 libpalpate0 libs "libpalpate-haptics0 ${same}" "soft bodies in contact, felt through a handle"
                "Scenes, their simulation, and small linear models of the force on a
handle, for a haptic loop at 1 kHz. Shared library.")
palpate_package(libpalpate-haptics0 libpalpate-haptics0 libs "" "haptic loop at 1 kHz for simulations at 30 Hz"
                "Handle model, proxy, tick, safety stage and devices, to be used behind
any simulation. Shared library.")
palpate_package(libpalpate-dev libpalpate-dev libdevel "libpalpate0 ${same}, libpalpate-haptics0 ${same}"
                "soft bodies in contact, felt through a handle (development)"
                "Headers, CMake package and pkg-config files of libpalpate and
libpalpate-haptics.")
if(TARGET palpate_python)
  palpate_package(python python3-palpate python "python3, python3-numpy, python3-scipy"
                  "soft bodies in contact, felt through a handle (Python 3)"
                  "Scenes, worlds, runs, handle models and the haptic loop, with NumPy views.")
endif()

# What needs these libraries needs this very version; ldconfig is run by a trigger.
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS_POLICY "=")
foreach(component LIBPALPATE0 LIBPALPATE-HAPTICS0)
  set(CPACK_DEBIAN_${component}_PACKAGE_CONTROL_EXTRA ${PROJECT_SOURCE_DIR}/packaging/triggers)
endforeach()
set(CPACK_POST_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/packaging/use_triggers.cmake)
include(CPack)
