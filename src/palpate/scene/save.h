#pragma once

#include <string>

#include "palpate/scene/config.h"

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

}  // namespace palpate
