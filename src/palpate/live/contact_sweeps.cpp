#include "palpate/live/contact_sweeps.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate {
namespace {

// A tangential force to the nearest in the circle of this radius, or in the polygon in it.
void limit(const TickContacts& contacts, int i, double radius, Vec3& pull) {
  const double length = pull.norm();
  if (contacts.facets == 0) {
    if (length > radius) pull *= radius / length;
    return;
  }
  const double half = std::numbers::pi / contacts.facets;
  const double inner = radius * std::cos(half);
  if (length <= inner) return;
  const Vec3 other = contacts.normal[i].cross(contacts.tangent[i]);
  const double angle = std::atan2(pull.dot(other), pull.dot(contacts.tangent[i]));
  const double middle = (2.0 * std::floor(angle / (2.0 * half)) + 1.0) * half;  // of the edge
  const double out = length * std::cos(angle - middle), along = length * std::sin(angle - middle);
  if (out <= inner) return;
  const double reach = radius * std::sin(half), kept = std::clamp(along, -reach, reach);
  const double x = inner * std::cos(middle) - kept * std::sin(middle);
  const double y = inner * std::sin(middle) + kept * std::cos(middle);
  pull = x * contacts.tangent[i] + y * other;
}

}  // namespace

bool TickContacts::any() const noexcept {
  for (int i = 0; i < count; ++i) {
    if (gap[i] + normal[i].dot(free.segment<3>(3 * i)) < 0) return true;
  }
  return false;
}

void sweep(const TickContacts& contacts, int sweeps, RowVector& force) noexcept {
  const auto& g = contacts.compliance;
  std::array<double, LiveSize::kContacts> along{}, across{};
  for (int i = 0; i < contacts.count; ++i) {
    const auto own = g.block<3, 3>(3 * i, 3 * i);
    along[i] = contacts.normal[i].dot(own * contacts.normal[i]);
    across[i] = 0.75 * (own.trace() - along[i]);
  }
  RowVector s = contacts.free;
  s.noalias() += g * force;
  for (int k = 0; k < sweeps; ++k) {
    for (int i = 0; i < contacts.count; ++i) {
      const Vec3& n = contacts.normal[i];
      const Vec3 before = force.segment<3>(3 * i);
      const Vec3 way = s.segment<3>(3 * i);
      const double pressed = before.dot(n);
      const double press = std::max(0.0, pressed - (n.dot(way) + contacts.gap[i]) / along[i]);
      Vec3 after = press * n;
      if (contacts.friction[i] > 0 && press > 0) {
        const Vec3 moved = way + g.block<3, 3>(3 * i, 3 * i) * ((press - pressed) * n);
        Vec3 pull = before - pressed * n - (moved - n.dot(moved) * n) / across[i];
        limit(contacts, i, contacts.friction[i] * press, pull);
        after += pull;
      }
      const Vec3 change = after - before;
      s.noalias() += g.middleCols<3>(3 * i) * change;
      force.segment<3>(3 * i) = after;
    }
  }
}

}  // namespace palpate
