#pragma once

#include <array>

#include "palpate/linearization/linearize.h"

namespace palpate {

/// Errors of Kx or Kv against central differences, by block: force by translation, force by rotation, torque by
/// translation, torque by rotation. Rotations are scaled by half the tool's bounding-box diagonal; each error is the
/// Frobenius norm of the difference relative to the block's own (at least 1e-6 of the whole scaled matrix, and of what
/// the handle's mass resists in a step).
struct BlockErrors {
  std::array<double, 4> block{};
  double worst() const;
};

/// Comparison of the linearization of the present state with central differences of the step.
struct LinearizationCheck {
  BlockErrors kx_frozen, kv_frozen, kx_full, kv_full;
  int active = 0, sticking = 0, sliding = 0;
  double force_error = 0;  ///< of Fc itself against the slow step [N, N m scaled], relative
};

/// Differences are taken of an independent, slow step (textbook element matrices, one sparse system of handle and tool,
/// an equality solve for the active contacts) with the active contacts, their states and frames held, once frozen and
/// once with everything live.
/// @param settings  the model checked against both; hsl-exact is the one that can agree in contact
LinearizationCheck checkLinearization(World& world, const DeviceTarget& device, double h,
                                      const LinearizationSettings& settings);

/// How far `model` is from `reference`, by block.
/// @param nothing  norm of a scaled block that counts as no more than that [N/m], [N s/m]
BlockErrors compareBlocks(const Mat6& model, const Mat6& reference, double length, double nothing = 0.0);

}  // namespace palpate
