#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "palpate/scene/config.h"
#include "palpate/scene/document.h"

namespace palpate {

/// What a person has changed of a running scene and its configuration does not say.
struct SceneFactors {
  double friction = 1.0;   ///< on all coefficients
  double stiffness = 1.0;  ///< on all moduli
};

/// Whether the files that a saved scene names are found from everywhere.
enum class SavedFiles {
  absolute,  ///< relative names become absolute ones, by the folder of SceneConfig::file
  as_named   ///< names stay: the scene belongs where its files are
};

/// The scene as the YAML document that reads as this one: what was read, with what Overrides can change as it is now
/// and the factors in its numbers. Comments are lost, aliases written out.
/// @throws InputError where the scene was not read from a document, or the result would not be read again: a factor
///         leads beyond a limit, or it is longer than a document may be
std::string sceneText(const SceneConfig& config, const SceneFactors& factors = {},
                      SavedFiles files = SavedFiles::absolute);

/// The same, with files called as `name` says; it is given the absolute path of each, which may be named more than
/// once.
std::string sceneTextWithFiles(const SceneConfig& config,
                               const std::function<std::string(const std::filesystem::path&)>& name);

/// A value for a key: names of keys and numbers of list entries (from 0), with dots between them:
/// "tool.material.density", "bodies.0.friction".
struct SceneEdit {
  std::string key;
  DocumentNode::Pointer value;
};

DocumentNode::Pointer scalarNode(const std::string& text);

/// The scene that its file would be with these values, which are read as strictly. Overrides are lost.
/// @throws InputError (the scene's file, key, cause)
SceneConfig editedScene(const SceneConfig& config, const std::vector<SceneEdit>& edits);

}  // namespace palpate
