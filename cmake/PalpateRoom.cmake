# Shared compile options, and the functions by which each folder declares its library or its tests.
add_library(palpate_options INTERFACE)
target_include_directories(palpate_options INTERFACE ${PROJECT_SOURCE_DIR}/src)
# shared/: scenes and problems of tests and benchmarks
include_directories(${PROJECT_SOURCE_DIR})
target_compile_options(palpate_options INTERFACE -Wall -Wextra -Wshadow -Wconversion -Wno-sign-conversion -Wpedantic
                                                 -fno-math-errno)
# what is rounded follows from the source, not from what is inlined where; a room may say otherwise
add_compile_options(-ffp-contract=off)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # GCC 12 gives false alarms inside its own AVX-512 headers, Eigen and std::string (GCC bugs 105593, 105651)
  target_compile_options(palpate_options INTERFACE -Wno-maybe-uninitialized -Wno-uninitialized -Wno-restrict
                                                   -Wno-array-bounds -Wno-stringop-overread -Wno-stringop-overflow)
  # takes a source that is compiled with others of its room for a header
  target_compile_options(palpate_options INTERFACE -Wno-subobject-linkage)
  # for a gigabyte more, no time for collecting garbage
  target_compile_options(palpate_options INTERFACE --param=ggc-min-heapsize=1000000)
endif()
if(CMAKE_CXX_COMPILER_ID MATCHES "Clang")
  # GoogleTest's macros, which C++20 allows
  target_compile_options(palpate_options INTERFACE -Wno-gnu-zero-variadic-macro-arguments)
endif()
if(PALPATE_WERROR)
  target_compile_options(palpate_options INTERFACE -Werror)
endif()
if(PALPATE_NATIVE)
  target_compile_options(palpate_options INTERFACE -march=native)
endif()
if(PALPATE_SANITIZE)
  target_compile_options(palpate_options INTERFACE -fsanitize=${PALPATE_SANITIZE} -fno-omit-frame-pointer
                                                   -fno-sanitize-recover=all)
  if(PALPATE_SANITIZE MATCHES "undefined")
    # checks at each access: the address sanitizer finds what they find, and Eigen asserts its alignment
    target_compile_options(palpate_options INTERFACE -fno-sanitize=null,alignment,object-size,pointer-overflow)
  endif()
  target_link_options(palpate_options INTERFACE -fsanitize=${PALPATE_SANITIZE})
endif()
target_link_libraries(palpate_options INTERFACE Eigen3::Eigen fmt::fmt) # both are in the precompiled headers

# What libFuzzer steers by: it watches the rooms that read what comes from outside.
if(PALPATE_FUZZ)
  set(PALPATE_COVERAGE -fsanitize=fuzzer-no-link)
  set(PALPATE_COVERED mesh devices) # and those that are LIGHT
endif()

# Precompiled headers: what nearly every source includes. GCC takes the optimization of a precompiled header for that of
# the whole source, so a target that compiles with other options than the rooms has one of its own. Clang reads one of
# another optimization when it is told not to compare.
set(PALPATE_COMMON_HEADERS
    <algorithm> <array> <atomic> <chrono> <cmath> <cstdint> <filesystem> <functional> <limits> <map> <memory> <numbers>
    <numeric> <optional> <span> <stdexcept> <string> <string_view> <unordered_map> <utility> <variant> <vector>
    <Eigen/Cholesky> <Eigen/Core> <Eigen/Geometry> <Eigen/LU> <fmt/format.h>)
file(WRITE ${PROJECT_BINARY_DIR}/empty.cpp.in "")
function(palpate_precompiled name)
  configure_file(${PROJECT_BINARY_DIR}/empty.cpp.in ${PROJECT_BINARY_DIR}/${name}.cpp COPYONLY)
  add_library(${name} OBJECT ${PROJECT_BINARY_DIR}/${name}.cpp)
  target_link_libraries(${name} PRIVATE palpate_options)
  target_precompile_headers(${name} PRIVATE ${PALPATE_COMMON_HEADERS} ${ARGN})
  set_target_properties(${name} PROPERTIES PALPATE_HEADERS "${ARGN}")
endfunction()
# The rooms become programs and shared libraries, which show only what include/palpate declares.
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_CXX_VISIBILITY_PRESET hidden)
set(CMAKE_VISIBILITY_INLINES_HIDDEN ON)
# Make, too, may compile a room while those that it depends on are still at work: no room makes headers for another.
set(CMAKE_OPTIMIZE_DEPENDENCIES ON)
palpate_precompiled(palpate_headers)
if(CMAKE_CXX_COMPILER_ID MATCHES "Clang")
  set(PALPATE_ANY_HEADERS -Xclang -fno-validate-pch)
endif()

# palpate_reuse_headers(TARGET HEADERS OPTIONS...): HEADERS for a target that compiles with these options beside the
# rooms' own.
function(palpate_reuse_headers target headers)
  target_compile_options(${target} PRIVATE ${ARGN} ${PALPATE_ANY_HEADERS})
  if(NOT PALPATE_ANY_HEADERS)
    # GCC takes only what was made for code of the same kind
    set(kind POSITION_INDEPENDENT_CODE CXX_VISIBILITY_PRESET VISIBILITY_INLINES_HIDDEN)
    set(own "${headers}${ARGN}")
    foreach(property IN LISTS kind)
      get_target_property(${property} ${target} ${property})
      string(APPEND own "_${${property}}")
    endforeach()
    string(MAKE_C_IDENTIFIER "${own}" own)
    if(NOT TARGET ${own})
      get_target_property(listed ${headers} PALPATE_HEADERS)
      get_target_property(libraries ${headers} LINK_LIBRARIES)
      palpate_precompiled(${own} ${listed})
      target_link_libraries(${own} PRIVATE ${libraries})
      target_compile_options(${own} PRIVATE ${ARGN})
      foreach(property IN LISTS kind)
        if(NOT "${${property}}" MATCHES "NOTFOUND$")
          set_target_properties(${own} PROPERTIES ${property} "${${property}}")
        endif()
      endforeach()
    endif()
    set(headers ${own})
  endif()
  target_precompile_headers(${target} REUSE_FROM ${headers})
endfunction()

# For what runs once and not at each step: compiles in half the time. What is not optimized at all is slower under a
# sanitizer, but it is not what its tests wait for.
if(CMAKE_BUILD_TYPE STREQUAL "Release")
  set(PALPATE_LIGHT -O1)
else()
  set(PALPATE_LIGHT -O0)
endif()

# With PALPATE_UNITY, a few sources that include those given, up to twelve each: headers are read and templates compiled
# once for them all. CMake's own unity build writes absolute paths, which keeps a compiler cache from serving another
# checkout.
function(palpate_join variable name)
  if(NOT PALPATE_UNITY)
    set(${variable} ${ARGN} PARENT_SCOPE)
    return()
  endif()
  set(joined "")
  set(count 0)
  foreach(source IN LISTS ARGN)
    get_filename_component(path ${source} ABSOLUTE)
    file(RELATIVE_PATH path ${PROJECT_SOURCE_DIR} ${path})
    math(EXPR part "${count} / 12")
    set(file ${CMAKE_CURRENT_BINARY_DIR}/${name}_${part}.cpp)
    list(APPEND joined ${file})
    string(APPEND content_${part} "#include \"${path}\"\n")
    math(EXPR count "${count} + 1")
  endforeach()
  list(REMOVE_DUPLICATES joined)
  foreach(file IN LISTS joined)
    string(REGEX REPLACE ".*_([0-9]+)\\.cpp" "\\1" part ${file})
    file(GENERATE OUTPUT ${file} CONTENT "${content_${part}}")
  endforeach()
  set(${variable} ${joined} PARENT_SCOPE)
endfunction()

# palpate_room(NAME SOURCES ... DEPENDS ... [LIBRARIES ...] [ALONE ...] [LIGHT] [OPTIONS ...]): one static library,
# palpate_NAME, for src/palpate/NAME. ALONE: sources that a unity build must not join with others, as their private names
# clash or the file is long. LIGHT: little is to be optimized. OPTIONS: compile options of this room only, which cannot
# share the precompiled headers.
function(palpate_room name)
  cmake_parse_arguments(ROOM "LIGHT" "" "SOURCES;DEPENDS;LIBRARIES;ALONE;OPTIONS" ${ARGN})
  if(ROOM_SOURCES OR ROOM_ALONE)
    palpate_join(joined room_${name} ${ROOM_SOURCES})
    add_library(palpate_${name} STATIC ${joined} ${ROOM_ALONE})
    if(ROOM_OPTIONS)
      target_compile_options(palpate_${name} PRIVATE ${ROOM_OPTIONS})
    elseif(ROOM_LIGHT)
      palpate_reuse_headers(palpate_${name} palpate_headers ${PALPATE_LIGHT} ${PALPATE_COVERAGE})
    elseif(PALPATE_COVERAGE AND name IN_LIST PALPATE_COVERED)
      palpate_reuse_headers(palpate_${name} palpate_headers ${PALPATE_COVERAGE})
    else()
      target_precompile_headers(palpate_${name} REUSE_FROM palpate_headers)
    endif()
    set(scope PUBLIC)
  else()
    add_library(palpate_${name} INTERFACE)
    set(scope INTERFACE)
  endif()
  target_link_libraries(palpate_${name} ${scope} palpate_options)
  foreach(other IN LISTS ROOM_DEPENDS)
    target_link_libraries(palpate_${name} ${scope} palpate_${other})
  endforeach()
  target_link_libraries(palpate_${name} ${scope} ${ROOM_LIBRARIES})
endfunction()

# Targets that build the tests of one label.
add_custom_target(tests_core)
add_custom_target(tests_tsan)

# The rooms are what is tested: less optimization halves the tests' build, and in the sanitizer build they look for
# undefined behavior in the rooms, not in themselves.
set(PALPATE_TEST_OPTIONS -O1)
set(PALPATE_LIGHT_TEST_OPTIONS -O0)
if(PALPATE_SANITIZE MATCHES "undefined")
  list(APPEND PALPATE_TEST_OPTIONS -fno-sanitize=undefined)
  list(APPEND PALPATE_LIGHT_TEST_OPTIONS -fno-sanitize=undefined)
endif()
if(PALPATE_TESTS)
  palpate_precompiled(palpate_test_headers <gtest/gtest.h>)
  target_link_libraries(palpate_test_headers PRIVATE GTest::gtest)
  target_compile_options(palpate_test_headers PRIVATE ${PALPATE_TEST_OPTIONS})
  set_target_properties(palpate_test_headers PROPERTIES POSITION_INDEPENDENT_CODE OFF CXX_VISIBILITY_PRESET default
                                                        VISIBILITY_INLINES_HIDDEN OFF)
endif()

# palpate_test(NAME SOURCES ... DEPENDS ... [LIBRARIES ...] [LABELS ...] [ALONE ...] [LIGHT] [SLOW]): one GoogleTest
# program, test_NAME; one or two a room, as each is linked with all that its room needs. Its tests labelled core run in
# the address-sanitizer build as well, those labelled tsan in the thread-sanitizer build. ALONE: sources that a unity
# build must not join. LIGHT: the sources compute little themselves, so they are not optimized. SLOW: under a sanitizer
# it takes longest, so it begins first.
function(palpate_test name)
  cmake_parse_arguments(TEST "LIGHT;SLOW" "" "SOURCES;ALONE;DEPENDS;LIBRARIES;LABELS" ${ARGN})
  palpate_join(joined test_${name} ${TEST_SOURCES})
  add_executable(test_${name} ${joined} ${TEST_ALONE})
  if(TEST_LIGHT)
    palpate_reuse_headers(test_${name} palpate_test_headers ${PALPATE_LIGHT_TEST_OPTIONS})
  else()
    target_precompile_headers(test_${name} REUSE_FROM palpate_test_headers)
    target_compile_options(test_${name} PRIVATE ${PALPATE_TEST_OPTIONS})
  endif()
  foreach(other IN LISTS TEST_DEPENDS)
    target_link_libraries(test_${name} PRIVATE palpate_${other})
  endforeach()
  target_link_libraries(test_${name} PRIVATE palpate_options ${TEST_LIBRARIES} GTest::gtest GTest::gtest_main)
  set(properties TIMEOUT 600)
  if(name MATCHES "_(long|hard|state)$")
    list(APPEND properties COST 100) # the longest first, so that none runs alone at the end
  endif()
  foreach(label IN LISTS TEST_LABELS)
    if(NOT TARGET tests_${label})
      message(FATAL_ERROR "test_${name}: unknown label '${label}'; there are core and tsan")
    endif()
    add_dependencies(tests_${label} test_${name})
  endforeach()
  if(TEST_LABELS)
    string(REPLACE ";" "+" labels "${TEST_LABELS}") # gtest_discover_tests() takes no list here
    list(APPEND properties LABELS ${labels})
  endif()
  if(PALPATE_SANITIZE)
    # as one: a program with sanitizers takes longer to start than most tests to run
    list(LENGTH TEST_SOURCES cost)
    if(TEST_SLOW)
      math(EXPR cost "${cost} + 100")
    endif()
    list(APPEND properties COST ${cost}) # the longest first
    add_test(NAME ${name} COMMAND test_${name} --gtest_brief=1)
    set_tests_properties(${name} PROPERTIES ${properties})
  else()
    gtest_discover_tests(test_${name} DISCOVERY_MODE PRE_TEST DISCOVERY_TIMEOUT 60 TEST_PREFIX "${name}." PROPERTIES
                                                                                                        ${properties})
  endif()
endfunction()

# Sources (ALONE) that open the repository's files. Nobody else is told where it is, so that a compiler cache serves any checkout.
function(palpate_source_dir)
  set_property(SOURCE ${ARGN} APPEND PROPERTY COMPILE_DEFINITIONS PALPATE_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
endfunction()

# palpate_library(NAME SHOWN HEADER SOURCES ... DEPENDS ... [PUBLIC LIBRARY ...] [LIBRARIES ...]): a shared library,
# palpate_NAME here, palpate::HEADER for others, which shows what include/palpate/HEADER.h declares. DEPENDS: rooms that
# go into it. PUBLIC: such libraries that its users need too.
set(PALPATE_EXPORTS ${CMAKE_CURRENT_LIST_DIR}/../src/palpate/library/exports.map)
function(palpate_library name)
  cmake_parse_arguments(LIB "" "SHOWN" "SOURCES;DEPENDS;PUBLIC;LIBRARIES" ${ARGN})
  palpate_join(joined ${name} ${LIB_SOURCES})
  # compiled beside the rooms, in place of after them
  add_library(palpate_${name}_objects OBJECT ${joined})
  if(PALPATE_PACKAGES)
    palpate_reuse_headers(palpate_${name}_objects palpate_headers -g) # for tools/check_abi; packages are stripped
  else()
    target_precompile_headers(palpate_${name}_objects REUSE_FROM palpate_headers)
  endif()
  target_compile_definitions(palpate_${name}_objects PRIVATE PALPATE_WITHIN)
  target_include_directories(palpate_${name}_objects PRIVATE ${PROJECT_SOURCE_DIR}/include)
  target_link_libraries(palpate_${name}_objects PRIVATE palpate_options ${LIB_LIBRARIES})
  add_library(palpate_${name} SHARED $<TARGET_OBJECTS:palpate_${name}_objects>)
  add_library(palpate::${LIB_SHOWN} ALIAS palpate_${name})
  target_compile_features(palpate_${name} INTERFACE cxx_std_20)
  target_include_directories(palpate_${name} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
                                                    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  target_link_libraries(palpate_${name} PRIVATE palpate_options ${LIB_LIBRARIES})
  foreach(room IN LISTS LIB_DEPENDS)
    target_link_libraries(palpate_${name} PRIVATE palpate_${room})
  endforeach()
  foreach(library IN LISTS LIB_PUBLIC)
    target_link_libraries(palpate_${name} PUBLIC palpate_${library})
  endforeach()
  target_link_options(palpate_${name} PRIVATE -Wl,--version-script=${PALPATE_EXPORTS} -Wl,--as-needed)
  set(output palpate)
  if(NOT LIB_SHOWN STREQUAL "palpate")
    set(output palpate-${LIB_SHOWN})
  endif()
  set_target_properties(palpate_${name} PROPERTIES OUTPUT_NAME ${output} EXPORT_NAME ${LIB_SHOWN}
                                                   VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR}
                                                   LINK_DEPENDS ${PALPATE_EXPORTS})
endfunction()
