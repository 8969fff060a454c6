#pragma once

/// @file
/// Version of the library, and how its names are exported.
///
/// Versions are semantic (semver.org). Before 1.0 a minor version may change what is declared here, and the shared
/// libraries' number (libpalpate.so.0) with it; a patch never does.

// CMakeLists.txt reads the version from here.
#define PALPATE_VERSION_MAJOR 0
#define PALPATE_VERSION_MINOR 1
#define PALPATE_VERSION_PATCH 0
#define PALPATE_VERSION_STRING "0.1.0"

#define PALPATE_EXPORT __attribute__((visibility("default")))
#define PALPATE_LOCAL __attribute__((visibility("hidden")))

// All names are in palpate::v0, which is inline. Palpate's own sources have classes of the same names in palpate
// itself; for them it is not.
#ifdef PALPATE_WITHIN
#define PALPATE_BEGIN_API \
  namespace palpate {     \
  namespace v0 {
#else
#define PALPATE_BEGIN_API \
  namespace palpate {     \
  inline namespace v0 {
#endif
#define PALPATE_END_API \
  }                     \
  }
