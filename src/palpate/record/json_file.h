#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string_view>

namespace palpate {

/// Writes indented JSON with its keys in the order in which they were added; numbers that are not finite become null.
/// The file appears whole or not at all. Include <nlohmann/json.hpp> to fill the value.
/// @throws InputError if the file cannot be opened, RunError if it cannot be written to its end
void writeJson(const std::filesystem::path& path, const nlohmann::ordered_json& value);

/// Writes a text so that the file appears whole or not at all; throws as writeJson().
void writeWhole(const std::filesystem::path& path, std::string_view content);

}  // namespace palpate
