#include "palpate/mesh/winding_number.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>

namespace palpate {
namespace {

constexpr int leaf_size = 8;
constexpr double four_pi = 4 * std::numbers::pi;

struct Corners {
  Vec3 a, b, c;
};

Corners cornersOf(const Surface& surface, int triangle) {
  const auto& t = surface.triangles[static_cast<size_t>(triangle)];
  return {surface.vertices[static_cast<size_t>(t[0])], surface.vertices[static_cast<size_t>(t[1])],
          surface.vertices[static_cast<size_t>(t[2])]};
}

Vec3 areaNormal(const Corners& t) { return 0.5 * (t.b - t.a).cross(t.c - t.a); }
Vec3 centerOf(const Corners& t) { return (t.a + t.b + t.c) / 3; }

}  // namespace

WindingNumber::WindingNumber(const Surface& surface, double accuracy) {
  const int n = static_cast<int>(surface.triangles.size());
  if (n == 0) return;
  std::vector<int> order(static_cast<size_t>(n));
  std::iota(order.begin(), order.end(), 0);
  clusters_.reserve(static_cast<size_t>(2 * n / (leaf_size / 2) + 2));
  clusters_.emplace_back();
  clusters_[0].first = 0;
  clusters_[0].last = n;
  build(0, order, surface, accuracy, 0);
  triangles_.reserve(order.size());
  for (int t : order) {
    const Corners corners = cornersOf(surface, t);
    triangles_.push_back({corners.a, corners.b, corners.c});
  }
}

void WindingNumber::summarize(Cluster& cluster, const std::vector<int>& order, const Surface& surface,
                              double accuracy) const {
  double area = 0;
  Vec3 weighted = Vec3::Zero();
  Vec3 plain = Vec3::Zero();
  cluster.area_normal.setZero();
  for (int i = cluster.first; i < cluster.last; ++i) {
    const Corners t = cornersOf(surface, order[static_cast<size_t>(i)]);
    const Vec3 n = areaNormal(t);
    area += n.norm();
    weighted += n.norm() * centerOf(t);
    plain += centerOf(t);
    cluster.area_normal += n;
  }
  cluster.center = area > 0 ? Vec3(weighted / area) : Vec3(plain / (cluster.last - cluster.first));
  cluster.moment.setZero();
  double radius_squared = 0;
  for (int i = cluster.first; i < cluster.last; ++i) {
    const Corners t = cornersOf(surface, order[static_cast<size_t>(i)]);
    cluster.moment += (centerOf(t) - cluster.center) * areaNormal(t).transpose();
    for (const Vec3& v : {t.a, t.b, t.c}) radius_squared = std::max(radius_squared, (v - cluster.center).squaredNorm());
  }
  cluster.far_squared = accuracy * accuracy * radius_squared;
}

void WindingNumber::build(int index, std::vector<int>& order, const Surface& surface, double accuracy, int depth) {
  summarize(clusters_[static_cast<size_t>(index)], order, surface, accuracy);
  const int first = clusters_[static_cast<size_t>(index)].first;
  const int last = clusters_[static_cast<size_t>(index)].last;
  if (last - first <= leaf_size) return;

  Vec3 low = centerOf(cornersOf(surface, order[static_cast<size_t>(first)]));
  Vec3 high = low;
  for (int i = first; i < last; ++i) {
    const Vec3 c = centerOf(cornersOf(surface, order[static_cast<size_t>(i)]));
    low = low.cwiseMin(c);
    high = high.cwiseMax(c);
  }
  Eigen::Index axis = 0;
  (high - low).maxCoeff(&axis);
  const auto key = [&](int t) {
    const auto& v = surface.triangles[static_cast<size_t>(t)];
    return surface.vertices[static_cast<size_t>(v[0])][axis] + surface.vertices[static_cast<size_t>(v[1])][axis] +
           surface.vertices[static_cast<size_t>(v[2])][axis];
  };
  const int middle = (first + last) / 2;
  std::nth_element(order.begin() + first, order.begin() + middle, order.begin() + last, [&](int a, int b) {
    const double ka = key(a);
    const double kb = key(b);
    return ka < kb || (ka == kb && a < b);
  });
  const int left = static_cast<int>(clusters_.size());
  clusters_[static_cast<size_t>(index)].left = left;
  clusters_.emplace_back();
  clusters_.emplace_back();
  clusters_[static_cast<size_t>(left)].first = first;
  clusters_[static_cast<size_t>(left)].last = middle;
  clusters_[static_cast<size_t>(left) + 1].first = middle;
  clusters_[static_cast<size_t>(left) + 1].last = last;
  build(left, order, surface, accuracy, depth + 1);
  build(left + 1, order, surface, accuracy, depth + 1);
}

double WindingNumber::solidAngle(const Triangle& t, const Vec3& x) {
  // van Oosterom and Strackee 1983
  const Vec3 a = t.a - x;
  const Vec3 b = t.b - x;
  const Vec3 c = t.c - x;
  const double la = a.norm();
  const double lb = b.norm();
  const double lc = c.norm();
  const double numerator = a.dot(b.cross(c));
  const double denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
  return 2 * std::atan2(numerator, denominator);
}

double WindingNumber::at(const Vec3& x) const {
  if (clusters_.empty()) return 0;
  double angle = 0;
  // Median splits: the depth is at most 32, and each level leaves one cluster waiting.
  std::array<int, 64> stack;
  size_t top = 0;
  stack[top++] = 0;
  while (top > 0) {
    const Cluster& cluster = clusters_[static_cast<size_t>(stack[--top])];
    const Vec3 r = cluster.center - x;
    const double d2 = r.squaredNorm();
    if (d2 > cluster.far_squared) {
      const double inverse = 1 / std::sqrt(d2);
      const double inverse3 = inverse * inverse * inverse;
      angle += inverse3 * (r.dot(cluster.area_normal) + cluster.moment.trace() -
                           3 * inverse * inverse * r.dot(cluster.moment * r));
    } else if (cluster.left < 0) {
      for (int i = cluster.first; i < cluster.last; ++i) angle += solidAngle(triangles_[static_cast<size_t>(i)], x);
    } else {
      stack[top++] = cluster.left + 1;
      stack[top++] = cluster.left;
    }
  }
  return angle / four_pi;
}

double WindingNumber::exactAt(const Vec3& x) const {
  double angle = 0;
  for (const Triangle& t : triangles_) angle += solidAngle(t, x);
  return angle / four_pi;
}

}  // namespace palpate
