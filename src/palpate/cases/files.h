#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>

#include "palpate/common/error.h"
#include "palpate/record/json_file.h"

namespace palpate {

/// 64 bits of FNV-1a, in hexadecimal: tells texts apart, and is no defence against whoever wants to deceive.
inline std::string digestOf(std::string_view bytes) {
  std::uint64_t hash = 0xcbf29ce484222325u;
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
  return fmt::format("{:016x}", hash);
}

/// @throws InputError if it cannot be read
inline std::string fileBytes(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  if (!stream.is_open() || stream.bad()) throw InputError(path.string(), "", "cannot be read");
  return bytes;
}

/// Leaves a file alone that has the content already, so that its time does not change.
inline void writeIfOther(const std::filesystem::path& path, const std::string& content) {
  std::error_code ignored;
  if (std::filesystem::is_regular_file(path, ignored) && fileBytes(path) == content) return;
  writeWhole(path, content);
}

}  // namespace palpate
