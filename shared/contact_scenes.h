#pragma once

// Worlds of soft foam in contact, small enough to step in a test and large enough to time: a plate on a block, blocks
// on an incline, a ball on a ball. Tests compare what threads make of them, benchmarks their cost.

#include <utility>

#include "palpate/mesh/embed_surface.h"
#include "palpate/mesh/implicit_surface.h"
#include "palpate/mesh/surface_measures.h"
#include "shared/held_scenes.h"

namespace palpate::test {

inline const Material kFoam{2.0e4, 0.4, 100.0, 0.0, 0.002};

inline constexpr double kPlateCell = 0.005;   // [m]
inline constexpr double kBallRadius = 0.05;   // [m]
inline constexpr double kIncline = 0.3;       // friction of its blocks
inline constexpr double kInclineSide = 0.04;  // of a block [m]

/// How far surfaces keep apart: the share of a body's size that scenes take as well [m].
inline double thicknessOf(const SimulationMesh& mesh) { return 0.002 * boundsOf(mesh.surface.vertices).diagonal(); }

/// A plate of cells x cells x 2 cells without weight, held by its upper side, twice the contact thickness over a fixed
/// block with a square top.
/// @param side   of the block's top, in cells
/// @param shift  of the block from under the plate's middle, in cells
inline World plateOverBlock(int cells, double side, double shift = 0) {
  const double width = cells * kPlateCell;
  World world;
  world.gravity.setZero();
  BodyModel plate("plate", barMesh(Vec3(width, width, 2 * kPlateCell), {cells, cells, 2}), kFoam);
  world.contact.thickness = thicknessOf(plate.mesh());
  holdNodes(
      plate, [](const Vec3& p) { return p.z() > 1.5 * kPlateCell; }, kPlainHandle);
  world.add(std::move(plate));
  const double middle = 0.5 * width + shift * kPlateCell;
  const Vec3 half(0.5 * side * kPlateCell, 0.5 * side * kPlateCell, 0.02);
  const BoxShape block{{Vec3(middle, middle, -half.z() - 2 * world.contact.thickness), Quat::Identity()}, half};
  world.obstacles.push_back({block, 0.5, "block"});
  return world;
}

/// Blocks side by side, a block's width apart, that slide down an incline made by tilting gravity.
/// @param finest  cells along a side: 2 in every block, or from 2 to this one block after the other
inline World slidingBlocks(int count, int finest = 2) {
  World world;
  world.gravity = Vec3(4.0, 0, -9.0);
  world.obstacles.push_back({PlaneShape{}, kIncline, "incline"});
  for (int i = 0; i < count; ++i) {
    const int cells = 2 + i % (finest - 1);
    const SimulationMesh mesh = barMesh(Vec3::Constant(kInclineSide), {cells, cells, cells});
    world.add(BodyModel("block", moved(mesh, {Vec3(0, 2 * kInclineSide * i, 0), Quat::Identity()}), kFoam, kIncline));
  }
  return world;
}

/// Surface of a ball of 10 cm about the origin.
/// @param cell  of the grid that it is read from, about an edge's length [m]
inline Surface ballSurface(double cell) {
  const auto distance = [](const Vec3& x) { return sphereDistance(x, Vec3::Zero(), kBallRadius); };
  return meshImplicit(distance, {Vec3::Constant(-1.1 * kBallRadius), Vec3::Constant(1.1 * kBallRadius)}, cell);
}

struct BallOptions {
  Vec3 offset{0, 0, 2 * kBallRadius};  ///< of the upper ball from the lower [m]
  double lower_handle = 0;             ///< mass of a handle at the lower ball's bottom [kg]; 0: it is free
  bool self_contact = false;
};
/// Two balls without weight, one over the other and held by its top.
/// @param ball  about the origin
inline World ballOverBall(const SimulationMesh& ball, const BallOptions& options) {
  World world;
  world.gravity.setZero();
  world.contact.thickness = thicknessOf(ball);
  BodyModel upper("upper", moved(ball, {options.offset, Quat::Identity()}), kFoam), lower("lower", ball, kFoam);
  holdNodes(
      upper, [&](const Vec3& p) { return p.z() > options.offset.z() + 0.5 * kBallRadius; }, kPlainHandle);
  if (options.lower_handle > 0) {
    HandleOptions heavy = kPlainHandle;
    heavy.mass = options.lower_handle;
    holdNodes(
        lower, [](const Vec3& p) { return p.z() < -0.5 * kBallRadius; }, heavy);
  }
  world.add(std::move(upper), options.self_contact);
  world.add(std::move(lower), options.self_contact);
  return world;
}

}  // namespace palpate::test
