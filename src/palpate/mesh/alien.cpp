#include "palpate/mesh/alien.h"

#include <algorithm>
#include <cmath>

#include "palpate/common/error.h"

namespace palpate {
namespace {

// All lengths in heights; the right half (+x), mirrored.
const Vec3 head_center(0, 0.005, 0.78);
const Vec3 head_radii(0.2, 0.178, 0.22);
const Vec3 trunk_low(0, 0, 0.345);
const Vec3 trunk_high(0, 0, 0.485);
const Vec3 shoulder(0.06, 0, 0.5);
const Vec3 elbow(0.185, -0.012, 0.43);
const Vec3 hand_center(0.295, 0.04, 0.36);
const Vec3 hip(0.048, 0, 0.315);
const Vec3 ankle(0.098, -0.012, 0.06);
const Vec3 foot_center(0.106, 0.026, 0.036);
const Vec3 eye_center(0.082, 0.144, 0.775);
constexpr double kHandRadius = 0.052;
constexpr double kFootLength = 0.088;

double handDistance(const Vec3& x) {
  double d = sphereDistance(x, hand_center, kHandRadius);
  const Vec3 palm = hand_center;
  for (const Vec3& tip : {Vec3(0.367, 0.05, 0.375), Vec3(0.362, 0.07, 0.322), Vec3(0.29, 0.112, 0.362)})
    d = smoothUnion(d, taperedCapsuleDistance(x, palm, tip, 0.032, 0.024), 0.02);
  return d;
}

double legDistance(const Vec3& x) {
  const double leg = taperedCapsuleDistance(x, hip, ankle, 0.04, 0.031);
  const double foot = ellipsoidDistance(x, foot_center, Vec3(0.058, kFootLength, 0.05));
  return smoothUnion(leg, foot, 0.03);
}

double armDistance(const Vec3& x) {
  const double upper = taperedCapsuleDistance(x, shoulder, elbow, 0.034, 0.029);
  const double lower = taperedCapsuleDistance(x, elbow, hand_center, 0.029, 0.03);
  return smoothUnion(smoothUnion(upper, lower, 0.02), handDistance(x), 0.025);
}

}  // namespace

double alienDistance(const Vec3& point) {
  const Vec3 x(std::abs(point.x()), point.y(), point.z());
  const double skull = ellipsoidDistance(x, head_center, head_radii);
  const double chin = ellipsoidDistance(x, Vec3(0, 0.018, 0.635), Vec3(0.11, 0.105, 0.09));
  double d = smoothUnion(skull, chin, 0.08);
  d = smoothUnion(d, ellipsoidDistance(x, eye_center, Vec3(0.052, 0.042, 0.072)), 0.012);
  const double trunk = taperedCapsuleDistance(x, trunk_low, trunk_high, 0.092, 0.07);
  d = smoothUnion(d, trunk, 0.05);
  d = smoothUnion(d, armDistance(x), 0.03);
  d = smoothUnion(d, legDistance(x), 0.03);
  // Flat soles with a rounded rim.
  return smoothIntersection(d, -x.z(), 0.02);
}

Alien makeAlien(const AlienOptions& options) {
  if (!(options.height > 0) || !std::isfinite(options.height))
    throw InputError("alien", "height", "must be positive and finite");
  if (!(options.resolution >= 0.005 && options.resolution <= 0.04))
    throw InputError("alien", "resolution", "must be 0.005 to 0.04 of the height");
  const Bounds box{Vec3(-0.5, -0.3, -0.06), Vec3(0.5, 0.32, 1.06)};
  Alien alien;
  alien.surface = meshImplicit(alienDistance, box, options.resolution);
  const Bounds bounds = boundsOf(alien.surface.vertices);
  const double scale = options.height / (bounds.high.z() - bounds.low.z());
  const auto place = [&](const Vec3& x) -> Vec3 { return scale * (x - Vec3(0, 0, bounds.low.z())); };
  const auto mirrored = [](const Vec3& x) { return Vec3(-x.x(), x.y(), x.z()); };
  for (Vec3& x : alien.surface.vertices) {
    x = place(x);
    x.z() = std::max(x.z(), 0.0);
  }
  AlienLandmarks& marks = alien.landmarks;
  marks.height = options.height;
  marks.head = place(head_center);
  marks.head_radius = scale * head_radii.minCoeff();
  marks.trunk = place(0.5 * (trunk_low + trunk_high));
  marks.right_hand = place(hand_center);
  marks.left_hand = place(mirrored(hand_center));
  marks.hand_radius = scale * kHandRadius;
  marks.right_foot = place(foot_center);
  marks.left_foot = place(mirrored(foot_center));
  marks.foot_radius = scale * kFootLength;
  return alien;
}

}  // namespace palpate
