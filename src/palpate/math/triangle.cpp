#include "palpate/math/triangle.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/math/segment.h"

namespace palpate {
namespace {

constexpr double kRounding = 1e-9;  // of a triangle's size

// Nearest of the edges that face p: edge i, opposite corner i, does so where sign[i] < 0.
TrianglePoint closestOnOutline(const Vec3& p, const std::array<const Vec3*, 3>& corner,
                               const std::array<double, 3>& sign) {
  TrianglePoint best;
  double best2 = std::numeric_limits<double>::infinity();
  for (size_t opposite = 0; opposite < 3; ++opposite) {
    if (!(sign[opposite] < 0)) continue;
    const size_t i = (opposite + 1) % 3, j = (opposite + 2) % 3;
    const double t = closestOnSegment(p, *corner[i], *corner[j]);
    const double distance2 = (p - (*corner[i] + t * (*corner[j] - *corner[i]))).squaredNorm();
    if (distance2 >= best2) continue;
    best2 = distance2;
    best.weight = {};
    best.weight[i] = 1 - t;
    best.weight[j] = t;
  }
  best.distance = std::sqrt(best2);
  return best;
}

// Whether a segment passes through a triangle, from one side of its plane to the other.
bool passes(const Vec3& p, const Vec3& q, double height_p, double height_q, const TriangleCorners& t) {
  if (!((height_p < 0 && height_q > 0) || (height_p > 0 && height_q < 0))) return false;
  const Vec3 d = q - p, a = t[0] - p, b = t[1] - p, c = t[2] - p;
  const double wa = d.dot(b.cross(c)), wb = d.dot(c.cross(a)), wc = d.dot(a.cross(b));
  return (wa >= 0 && wb >= 0 && wc >= 0) || (wa <= 0 && wb <= 0 && wc <= 0);
}

// Heights of the corners of u over the plane of t, times twice its area; what may be rounding is zero, as parts of a
// flat face would else cross. @returns whether they are on both sides
bool straddles(const TriangleCorners& t, const TriangleCorners& u, std::array<double, 3>& height) {
  const Vec3 n = (t[1] - t[0]).cross(t[2] - t[0]);
  const double area = n.norm(), rounding = kRounding * area * std::sqrt(area);
  for (int k = 0; k < 3; ++k) {
    height[k] = n.dot(u[k] - t[0]);
    if (std::abs(height[k]) < rounding) height[k] = 0;
  }
  return std::min({height[0], height[1], height[2]}) < 0 && std::max({height[0], height[1], height[2]}) > 0;
}

bool anyEdgePasses(const TriangleCorners& u, const std::array<double, 3>& height, const TriangleCorners& t) {
  for (int k = 0; k < 3; ++k) {
    const int l = (k + 1) % 3;
    if (passes(u[k], u[l], height[k], height[l], t)) return true;
  }
  return false;
}

}  // namespace

TrianglePoint closestOnTriangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  // Everything in the triangle's plane, from the Gram matrix of its edges at a: the plane's weights, unless one of them
  // is negative; then the nearest point is on the outline.
  const Vec3 u = b - a, v = c - a, w = p - a;
  const double uu = u.squaredNorm(), uv = u.dot(v), vv = v.squaredNorm();
  const double uw = u.dot(w), vw = v.dot(w);
  const double det = uu * vv - uv * uv;
  const double wb = vv * uw - uv * vw, wc = uu * vw - uv * uw;
  const double wa = det - wb - wc;
  if (!(det > 1e-14 * uu * vv)) return closestOnOutline(p, {&a, &b, &c}, {-1, -1, -1});
  if (wa < 0 || wb < 0 || wc < 0) return closestOnOutline(p, {&a, &b, &c}, {wa, wb, wc});
  TrianglePoint r;
  r.weight = {wa / det, wb / det, wc / det};
  r.distance = (w - r.weight[1] * u - r.weight[2] * v).norm();
  return r;
}

bool trianglesCross(const TriangleCorners& t, const TriangleCorners& u) {
  std::array<double, 3> of_u{}, of_t{};
  return straddles(t, u, of_u) && straddles(u, t, of_t) && (anyEdgePasses(u, of_u, t) || anyEdgePasses(t, of_t, u));
}

}  // namespace palpate
