#pragma once

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/common/interruption.h"

namespace palpate {

struct WriteFailure {
  bool begun;  ///< the file could be opened, and not be written or named
  std::string cause;
};

/// Writes a file so that it appears whole or not at all: first under the temporary name, then renamed.
/// @returns what failed
inline std::optional<WriteFailure> writeThenRename(const std::string& path, const std::string& temporary,
                                                   std::string_view contents) {
  markProvisional(temporary);
  std::FILE* file = std::fopen(temporary.c_str(), "wb");
  if (!file) {
    const std::string cause = std::strerror(errno);
    unmarkProvisional(temporary);
    return WriteFailure{false, cause};
  }
  const bool written = std::fwrite(contents.data(), 1, contents.size(), file) == contents.size();
  const bool closed = std::fclose(file) == 0;
  const bool placed = written && closed && std::rename(temporary.c_str(), path.c_str()) == 0;
  const std::string cause = std::strerror(errno);
  if (!placed) std::remove(temporary.c_str());
  unmarkProvisional(temporary);
  if (placed) return std::nullopt;
  return WriteFailure{true, cause};
}

}  // namespace palpate
