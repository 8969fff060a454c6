# Every library that Palpate uses; each is a Debian package (see ./dev setup).
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(Threads REQUIRED)
find_package(fmt REQUIRED)
find_package(yaml-cpp REQUIRED)
find_package(nlohmann_json REQUIRED)
if(PALPATE_PROGRAM)
  find_package(CLI11 REQUIRED)
endif()
find_package(pugixml REQUIRED)
find_package(ZLIB REQUIRED)
find_package(Boost 1.74 REQUIRED NO_MODULE) # headers only: Beast and Asio

if(NOT TARGET yaml-cpp::yaml-cpp)
  add_library(yaml-cpp::yaml-cpp ALIAS yaml-cpp)
endif()

# CHOLMOD of SuiteSparse ships no CMake package in Debian 12 and Ubuntu 22.04.
find_path(CHOLMOD_INCLUDE_DIR cholmod.h PATH_SUFFIXES suitesparse REQUIRED)
find_library(CHOLMOD_LIBRARY cholmod REQUIRED)
add_library(palpate_cholmod INTERFACE)
target_include_directories(palpate_cholmod SYSTEM INTERFACE ${CHOLMOD_INCLUDE_DIR})
target_link_libraries(palpate_cholmod INTERFACE ${CHOLMOD_LIBRARY})

# Debian's CMake package of libzip asks for tools that its library does not need.
find_path(ZIP_INCLUDE_DIR zip.h REQUIRED)
find_library(ZIP_LIBRARY zip REQUIRED)
add_library(palpate_zip INTERFACE)
target_include_directories(palpate_zip SYSTEM INTERFACE ${ZIP_INCLUDE_DIR})
target_link_libraries(palpate_zip INTERFACE ${ZIP_LIBRARY})

if(PALPATE_TESTS)
  find_package(GTest REQUIRED)
  include(GoogleTest)
endif()
if(PALPATE_BENCH)
  find_package(benchmark REQUIRED)
endif()
