#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/scene/config.h"

namespace palpate {

// Rules that tie several values together, wherever those come from. Each says what is wrong, if anything.

/// The visual step is a whole multiple of the haptic step.
std::optional<std::string> stepObjection(const SceneConfig& config);
/// It is, and the run is no longer than files can hold.
std::optional<std::string> timingObjection(const SceneConfig& config);
/// All bodies together stay below the limit on tetrahedra.
std::optional<std::string> sizeObjection(const SceneConfig& config);
/// The tool has a handle of that name.
std::optional<std::string> handleObjection(const ToolConfig& tool, const std::string& handle);

/// The method can serve the tool.
std::optional<std::string> methodObjection(const SceneConfig& config);

/// Names as scene files and the command line spell them, in the order of the enumerators.
const std::vector<std::string>& methodNames();
const std::vector<std::string>& aimNames();
const std::vector<std::string>& derivativeNames();
const std::vector<std::string>& deviceNames();
/// Polyhedral, exact.
const std::vector<std::string>& coneNames();
/// Places of the alien that a region may name.
const std::vector<std::string>& alienLandmarkNames();

}  // namespace palpate
