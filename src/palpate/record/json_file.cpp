#include "palpate/record/json_file.h"

#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>

#include "palpate/common/error.h"
#include "palpate/common/interruption.h"

namespace palpate {

void writeJson(const std::filesystem::path& path, const nlohmann::ordered_json& value) {
  // Names from user files may hold bytes that are not UTF-8: replace them rather than fail.
  writeWhole(path, value.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
}

void writeWhole(const std::filesystem::path& path, std::string_view content) {
  const std::string temporary = path.string() + ".partial-" + std::to_string(static_cast<long>(::getpid()));
  std::FILE* file = std::fopen(temporary.c_str(), "wb");
  if (!file) throw InputError(path.string(), "", std::string("cannot be written: ") + std::strerror(errno));
  markProvisional(temporary);
  const bool written = std::fwrite(content.data(), 1, content.size(), file) == content.size();
  const bool closed = std::fclose(file) == 0;
  const bool placed = written && closed && std::rename(temporary.c_str(), path.c_str()) == 0;
  const std::string cause = std::strerror(errno);
  if (!placed) std::remove(temporary.c_str());
  unmarkProvisional(temporary);
  if (placed) return;
  throw RunError(path.string() + ": cannot be written: " + cause);
}

}  // namespace palpate
