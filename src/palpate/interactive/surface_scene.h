#pragma once

#include <filesystem>
#include <string>

#include "palpate/protocol/commands.h"
#include "palpate/protocol/messages.h"
#include "palpate/scene/config.h"

namespace palpate {

/// A scene in which a surface stands on the ground: light and soft, held as the placement says. It was read from the
/// text that sceneText() gives back, so that a saved one is the same to the bit.
/// @param file  the surface, in the folder that the scene's names are relative to
/// @param name  of the file, for people
/// @throws InputError or RunError, which do not name the folder, if the file holds no usable surface
SceneConfig sceneOfSurface(const std::filesystem::path& file, const std::string& name,
                           const PlaceMessage& placement = {});

/// A scene that shows a surface and does not move: rigid, on the ground, without weight, not turned, its longest side
/// SurfacePreview::size.
/// @throws as sceneOfSurface
SceneConfig previewOfSurface(const std::filesystem::path& file, const std::string& name, SurfacePreview& preview);

/// The text without the folder that a dropped file was put in: it means nothing to whoever sent the file.
std::string withoutFolder(std::string text, const std::filesystem::path& file);

}  // namespace palpate
