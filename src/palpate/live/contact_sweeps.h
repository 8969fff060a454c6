#pragma once

#include "palpate/live/live_model.h"

namespace palpate {

/// Contacts of one tick, in the handle's frame. With s = free + compliance lambda the displacement of each in the tick:
///   0 <= lambda_n _|_ gap + n . s >= 0,   lambda_t against s_t, |lambda_t| <= friction lambda_n,
/// or in the regular polygon inscribed in that circle. Of what is tied, away + s = 0; of a support, lambda_n = 0 and
/// |lambda_t| <= friction (load + bearing lambda).
struct TickContacts {
  int count = 0;
  BoundedMatrix<LiveSize::kRows, LiveSize::kRows> compliance;  ///< G, both triangles [m/N]
  RowVector free;                                              ///< [m]
  std::array<Vec3, LiveSize::kContacts> normal;
  std::array<double, LiveSize::kContacts> gap{};  ///< [m]
  std::array<double, LiveSize::kContacts> friction{};
  int facets = 0;                                 ///< of the cones, at most LiveModel::kFacets; 0: round
  std::array<Vec3, LiveSize::kContacts> tangent;  ///< along which a cone of facets has its first vertex
  std::array<bool, LiveSize::kContacts> tied{};
  std::array<Vec3, LiveSize::kContacts> away;      ///< of what is tied, from its place [m]
  int supports = 0;                                ///< the last ones
  std::array<double, LiveSize::kSupports> load{};  ///< of those, without any force [N]
  BoundedMatrix<LiveSize::kSupports, LiveSize::kRows> bearing;

  /// Whether one would close without any force, is tied or a support.
  bool any() const noexcept;
};

/// Sweeps of projected Gauss-Seidel from the given forces.
void sweep(const TickContacts& contacts, int sweeps, RowVector& force) noexcept;

}  // namespace palpate
