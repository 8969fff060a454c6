#include "palpate/live/contact_sweeps.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "palpate/live/tick_algebra.h"

namespace palpate {
namespace {

constexpr double kSettled = 1e-7;  // [N]; less is felt by nobody

using Vec2 = Eigen::Vector2d;

// Edges of a regular polygon in the unit circle: directions to their middles.
struct Polygon {
  int facets = 0;
  double inner = 1, half = 0;  // distance of an edge, half its length
  std::array<Vec2, LiveModel::kFacets> middle;

  explicit Polygon(int count) : facets(count) {
    if (facets == 0) return;
    const double angle = std::numbers::pi / facets;
    inner = std::cos(angle);
    half = std::sin(angle);
    for (int k = 0; k < facets; ++k) middle[k] = Vec2(std::cos((2 * k + 1) * angle), std::sin((2 * k + 1) * angle));
  }
  // The nearest point in a polygon of this radius.
  Vec2 limit(const Vec2& pull, double radius) const {
    int edge = 0;
    double out = pull.dot(middle[0]);
    for (int k = 1; k < facets; ++k) {
      const double along = pull.dot(middle[k]);
      if (along > out) {
        out = along;
        edge = k;
      }
    }
    if (out <= inner * radius) return pull;
    const Vec2 m = middle[edge], side(-m.y(), m.x());
    return inner * radius * m + std::clamp(pull.dot(side), -half * radius, half * radius) * side;
  }
};

// A tangential force to the nearest in the circle of this radius, or in the polygon in it.
void limit(const TickContacts& contacts, const Polygon& polygon, int i, double radius, Vec3& pull) {
  if (polygon.facets == 0) {
    const double length = pull.norm();
    if (length > radius) pull *= radius / length;
    return;
  }
  if (pull.squaredNorm() <= polygon.inner * polygon.inner * radius * radius) return;
  const Vec3 &first = contacts.tangent[i], other = contacts.normal[i].cross(first);
  const Vec2 kept = polygon.limit({pull.dot(first), pull.dot(other)}, radius);
  pull = kept.x() * first + kept.y() * other;
}

// The force of a contact, so that it holds by itself.
Vec3 pressedAgainst(const TickContacts& contacts, const Polygon& polygon, int i, const Vec3& before, const Vec3& way,
                    double along, double across) {
  const Vec3& n = contacts.normal[i];
  const double pressed = before.dot(n);
  const double press = std::max(0.0, pressed - (n.dot(way) + contacts.gap[i]) / along);
  Vec3 after = press * n;
  if (contacts.friction[i] <= 0 || press <= 0) return after;
  const Vec3 moved = way + contacts.compliance.block<3, 3>(3 * i, 3 * i) * ((press - pressed) * n);
  Vec3 pull = before - pressed * n - (moved - n.dot(moved) * n) / across;
  limit(contacts, polygon, i, contacts.friction[i] * press, pull);
  return after + pull;
}

// The friction of a support, so that it holds by itself.
Vec3 supportedAgainst(const TickContacts& contacts, const Polygon& polygon, int i, const Vec3& before, const Vec3& way,
                      double across, double load) {
  const Vec3& n = contacts.normal[i];
  const Vec3 wanted = before - way / across;
  Vec3 pull = wanted - n.dot(wanted) * n;
  limit(contacts, polygon, i, contacts.friction[i] * std::max(0.0, load), pull);
  return pull;
}

}  // namespace

bool TickContacts::any() const noexcept {
  if (supports > 0) return true;
  for (int i = 0; i < count; ++i) {
    if (tied[i] || gap[i] + normal[i].dot(free.segment<3>(3 * i)) < 0) return true;
  }
  return false;
}

void sweep(const TickContacts& contacts, int sweeps, RowVector& force) noexcept {
  const auto& g = contacts.compliance;
  std::array<double, LiveSize::kContacts> along{}, across{};
  std::array<Mat3, LiveSize::kContacts> stiffness;  // of what is tied
  for (int i = 0; i < contacts.count; ++i) {
    const auto own = g.block<3, 3>(3 * i, 3 * i);
    if (contacts.tied[i]) {
      stiffness[i] = own.inverse();
      continue;
    }
    along[i] = contacts.normal[i].dot(own * contacts.normal[i]);
    across[i] = 0.75 * (own.trace() - along[i]);
  }
  const Polygon polygon(contacts.facets);
  RowVector s = contacts.free;
  addProduct(1.0, g, force.data(), s.data());
  const int first_support = contacts.count - contacts.supports;
  std::array<double, LiveSize::kSupports> load = contacts.load;
  if (contacts.supports > 0) addProduct(1.0, contacts.bearing, force.data(), load.data());
  for (int k = 0; k < sweeps; ++k) {
    double most = 0;  // change in this sweep [N]
    for (int i = 0; i < contacts.count; ++i) {
      const Vec3 before = force.segment<3>(3 * i);
      const Vec3 way = s.segment<3>(3 * i);
      Vec3 after;
      if (contacts.tied[i]) {
        after = before - stiffness[i] * (way + contacts.away[i]);
      } else if (i >= first_support) {
        after = supportedAgainst(contacts, polygon, i, before, way, across[i], load[i - first_support]);
      } else {
        after = pressedAgainst(contacts, polygon, i, before, way, along[i], across[i]);
      }
      const Vec3 change = after - before;
      if (change.isZero(0.0)) continue;
      most = std::max(most, change.cwiseAbs().maxCoeff());
      s += change[0] * g.col(3 * i) + change[1] * g.col(3 * i + 1) + change[2] * g.col(3 * i + 2);
      force.segment<3>(3 * i) = after;
      if (contacts.supports > 0) addProduct(1.0, contacts.bearing.middleCols<3>(3 * i), change.data(), load.data());
    }
    if (most < kSettled) return;
  }
}

}  // namespace palpate
