#include "palpate/contact/feature_distance.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

double segmentDistance(const Vec3& d1, const Vec3& d2, const Vec3& r, double s, double t) {
  return (r + s * d1 - t * d2).norm();
}

}  // namespace

SegmentPair closestOnSegments(const Vec3& a0, const Vec3& a1, const Vec3& b0, const Vec3& b1) {
  const Vec3 d1 = a1 - a0, d2 = b1 - b0, r = a0 - b0;
  const double a = d1.squaredNorm(), e = d2.squaredNorm(), b = d1.dot(d2);
  const double c = d1.dot(r), f = d2.dot(r);
  const double denominator = a * e - b * b;  // a e sin^2
  SegmentPair result;
  if (denominator > 1e-12 * a * e) {
    double s = std::clamp((b * f - c * e) / denominator, 0.0, 1.0);
    double t = (b * s + f) / e;
    if (t < 0 || t > 1) {
      t = std::clamp(t, 0.0, 1.0);
      s = std::clamp((b * t - c) / a, 0.0, 1.0);
    }
    return {s, t, segmentDistance(d1, d2, r, s, t)};
  }
  // parallel, or without length: one of the four ends is as near as any point
  result.distance = std::numeric_limits<double>::infinity();
  const auto consider = [&](double s, double t) {
    const double distance = segmentDistance(d1, d2, r, s, t);
    if (distance < result.distance) result = {s, t, distance};
  };
  consider(0, closestOnSegment(a0, b0, b1));
  consider(1, closestOnSegment(a1, b0, b1));
  consider(closestOnSegment(b0, a0, a1), 0);
  consider(closestOnSegment(b1, a0, a1), 1);
  return result;
}

Approach timeOfApproach(FeatureKind kind, const std::array<Vec3, 4>& start, const std::array<Vec3, 4>& end,
                        double min_distance, int max_iterations, double until) {
  // relative to the first point, so that a common motion neither counts nor costs digits
  std::array<Vec3, 4> x, v;
  for (size_t i = 0; i < 4; ++i) {
    x[i] = start[i] - start[0];
    v[i] = end[i] - start[i] - (end[0] - start[0]);
  }
  const bool face = kind == FeatureKind::vertex_face;
  const size_t split = face ? 1 : 2;  // points of the first feature
  double speed = 0;                   // largest of any two points
  for (size_t i = 0; i < split; ++i)
    for (size_t j = split; j < 4; ++j) speed = std::max(speed, (v[i] - v[j]).norm());

  double t = 0, stop = 0, aim = 0;
  std::array<Vec3, 4> y = x;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    for (size_t i = 0; i < 4; ++i) y[i] = x[i] + t * v[i];
    Vec3 line;
    if (face) {
      const TrianglePoint q = closestOnTriangle(y[0], y[1], y[2], y[3]);
      line = y[0] - (q.weight[0] * y[1] + q.weight[1] * y[2] + q.weight[2] * y[3]);
    } else {
      const SegmentPair q = closestOnSegments(y[0], y[1], y[2], y[3]);
      line = (1 - q.s) * y[0] + q.s * y[1] - (1 - q.t) * y[2] - q.t * y[3];
    }
    const double distance = line.norm();
    if (iteration == 0) {
      if (!(distance > min_distance)) return {0, true};
      const double room = distance - min_distance;
      const double tolerance = min_distance > 0 ? std::min(0.05 * room, 0.1 * min_distance) : 0.05 * room;
      stop = min_distance + tolerance;
      aim = min_distance + 0.5 * tolerance;
    }
    if (distance <= stop) return {t, true};
    line /= distance;
    double step = std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < split; ++i)
      for (size_t j = split; j < 4; ++j) {
        const double rate = line.dot(v[i] - v[j]);
        if (rate < 0) step = std::min(step, (line.dot(y[i] - y[j]) - aim) / -rate);
      }
    // rounding can spoil the plane where features nearly touch; the distance over the largest speed is left then
    if (!(step > 0)) step = (distance - aim) / speed;
    t += step;
    if (t >= 1 || t > until) return {1, false};
  }
  return {t, true};
}

}  // namespace palpate
