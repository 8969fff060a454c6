#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>

namespace palpate {

/// Opens what is closed of standard input, output and error on /dev/null, before the program opens anything else: files
/// would get their numbers, and text for people would land in them. @return false where that cannot be done
inline bool openStandardDescriptors() noexcept {
  for (int descriptor = STDIN_FILENO; descriptor <= STDERR_FILENO; ++descriptor) {
    if (::fcntl(descriptor, F_GETFD) != -1 || errno != EBADF) continue;
    if (::open("/dev/null", O_RDWR) != descriptor) return false;  // the lowest that is free
  }
  return true;
}

}  // namespace palpate
