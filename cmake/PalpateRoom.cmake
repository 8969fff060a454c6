# Shared compile options, and the functions by which each folder declares its library or its tests.
add_library(palpate_options INTERFACE)
target_include_directories(palpate_options INTERFACE ${CMAKE_SOURCE_DIR}/src)
# shared/: scenes and problems of tests and benchmarks
include_directories(${CMAKE_SOURCE_DIR})
target_compile_options(palpate_options INTERFACE -Wall -Wextra -Wshadow -Wconversion -Wno-sign-conversion -Wpedantic
                                                 -fno-math-errno)
# what is rounded follows from the source, not from what is inlined where; a room may say otherwise
add_compile_options(-ffp-contract=off)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # GCC 12 gives false alarms inside its own AVX-512 headers, Eigen and std::string (GCC bugs 105593, 105651)
  target_compile_options(palpate_options INTERFACE -Wno-maybe-uninitialized -Wno-uninitialized -Wno-restrict
                                                   -Wno-array-bounds -Wno-stringop-overread -Wno-stringop-overflow)
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
  target_link_options(palpate_options INTERFACE -fsanitize=${PALPATE_SANITIZE})
endif()
target_link_libraries(palpate_options INTERFACE Eigen3::Eigen)

# palpate_room(NAME SOURCES ... DEPENDS ...): one static library, palpate_NAME, for src/palpate/NAME. With PALPATE_UNITY
# its sources are compiled as one, so that headers are read once.
function(palpate_room name)
  cmake_parse_arguments(ROOM "" "" "SOURCES;DEPENDS;LIBRARIES" ${ARGN})
  if(ROOM_SOURCES)
    add_library(palpate_${name} STATIC ${ROOM_SOURCES})
    set_target_properties(palpate_${name} PROPERTIES UNITY_BUILD ${PALPATE_UNITY} UNITY_BUILD_BATCH_SIZE 8)
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

# palpate_test(NAME SOURCES ... DEPENDS ... [LABELS ...]): one GoogleTest program, test_NAME. Tests labelled core run in
# the address-sanitizer build as well, those labelled tsan in the thread-sanitizer build; those labelled timing run
# alone.
function(palpate_test name)
  cmake_parse_arguments(TEST "" "" "SOURCES;DEPENDS;LIBRARIES;LABELS" ${ARGN})
  add_executable(test_${name} ${TEST_SOURCES})
  target_compile_options(test_${name} PRIVATE -O1)  # the rooms are what is tested; this halves the build of the tests
  foreach(other IN LISTS TEST_DEPENDS)
    target_link_libraries(test_${name} PRIVATE palpate_${other})
  endforeach()
  target_link_libraries(test_${name} PRIVATE palpate_options ${TEST_LIBRARIES} GTest::gtest GTest::gtest_main)
  target_compile_definitions(test_${name} PRIVATE PALPATE_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
  set(properties TIMEOUT 600)
  foreach(label IN LISTS TEST_LABELS)
    if(TARGET tests_${label})
      add_dependencies(tests_${label} test_${name})
    elseif(label STREQUAL "timing")
      list(APPEND properties RUN_SERIAL ON)
    else()
      message(FATAL_ERROR "test_${name}: unknown label '${label}'; there are core, tsan and timing")
    endif()
  endforeach()
  if(TEST_LABELS)
    string(REPLACE ";" "+" labels "${TEST_LABELS}") # gtest_discover_tests() takes no list here
    list(APPEND properties LABELS ${labels})
  endif()
  gtest_discover_tests(test_${name} DISCOVERY_MODE PRE_TEST DISCOVERY_TIMEOUT 60 TEST_PREFIX "${name}." PROPERTIES
                                                                                                      ${properties})
endfunction()
