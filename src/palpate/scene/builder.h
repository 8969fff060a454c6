#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/devices/device.h"
#include "palpate/devices/mouse_device.h"
#include "palpate/haptics/haptic_loop.h"
#include "palpate/linearization/linearize.h"
#include "palpate/mesh/embed_surface.h"
#include "palpate/reduction/live_settings.h"
#include "palpate/scene/config.h"
#include "palpate/simulation/world.h"

namespace palpate {

/// A scene made ready to run.
struct BuiltScene {
  World world;
  HapticSettings haptic;
  LinearizationSettings linearization;
  LiveSettings live;
  std::unique_ptr<Device> device;
  Pose start;                                            ///< first pose of the device
  int tetrahedra = 0, nodes = 0, surface_triangles = 0;  ///< of all bodies
  std::vector<std::string> notes;                        ///< on what is not as the user may expect
};

/// Makes bodies, obstacles, device and haptic settings of a scene (its files resolved). Says on standard error what it
/// is at where that takes longer than a second.
/// @throws InputError for what only the meshes tell: a region without nodes, a surface without volume, too many
///         triangles
BuiltScene buildScene(const SceneConfig& config);

/// Adds to the scene's notes what is odd about its start: what lies inside something else, what is far larger than a
/// hand moves, a handle that cannot turn what it holds. Changes nothing in the scene but that its obstacles are from
/// now on fixed.
void noteStart(const SceneConfig& config, BuiltScene& scene);

/// A mouse in place of the scene's device: the same mass and hand, the chosen handle's path until somebody takes it.
/// @param start  first pose of the device
std::unique_ptr<MouseDevice> buildMouse(const SceneConfig& config, const Pose& start);

/// Weight of handle and tool together, at their center of mass, as the tool now hangs.
CompensatedWeight staticWeight(const World& world);

/// The tool of a scene alone, without device: for reports on meshes and for checks.
/// @param notes  gets a line on each thing of a mesh file that is left out; may be null
SimulationMesh buildMesh(const BodyConfig& config, EmbedReport* report = nullptr,
                         std::vector<std::string>* notes = nullptr);

}  // namespace palpate
