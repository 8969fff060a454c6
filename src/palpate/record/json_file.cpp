#include "palpate/record/json_file.h"

#include <unistd.h>

#include <nlohmann/json.hpp>
#include <string>

#include "palpate/common/error.h"
#include "palpate/common/whole_file.h"

namespace palpate {

void writeJson(const std::filesystem::path& path, const nlohmann::ordered_json& value) {
  // Names from user files may hold bytes that are not UTF-8: replace them rather than fail.
  writeWhole(path, value.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
}

void writeWhole(const std::filesystem::path& path, std::string_view content) {
  const std::string name = path.string();
  const std::string temporary = name + ".partial-" + std::to_string(static_cast<long>(::getpid()));
  const auto failure = writeThenRename(name, temporary, content);
  if (!failure) return;
  if (!failure->begun) throw InputError(name, "", "cannot be written: " + failure->cause);
  throw RunError(name + ": cannot be written: " + failure->cause);
}

}  // namespace palpate
