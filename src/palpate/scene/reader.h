#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/scene/config.h"

namespace palpate {

// The schema, with units, ranges and defaults, is in docs/scene.md. All functions throw InputError (file, key path,
// cause).

/// Reads and checks a scene and finds the files that it names.
SceneConfig readScene(const std::filesystem::path& file);

/// The same from text, without looking for files. `name` stands for the file in errors.
SceneConfig readSceneFromString(std::string_view text, const std::string& name);

/// The same from what has been parsed (document.h).
SceneConfig readSceneFromDocument(std::shared_ptr<const DocumentNode> document, const std::string& name);

/// JSON Schema of scenes (schema.h): what the reader takes, apart from what one key means for another.
nlohmann::ordered_json sceneSchema();

/// Folders below which packages keep their data.
std::vector<std::filesystem::path> packageDataFolders();

/// Sets the path of every file that the scene names. Plain names are relative to the scene's folder; with a package P
/// the folders P and, if P ends in -data, P without it are searched below each of `data_folders`.
void resolveFiles(SceneConfig& config, const std::vector<std::filesystem::path>& data_folders = packageDataFolders());

}  // namespace palpate
