#include "palpate/mesh/winding_number.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace palpate {
namespace {

constexpr int kLeafSize = 8;
constexpr double kFourPi = 4 * std::numbers::pi;

}  // namespace

WindingNumber::WindingNumber(const Surface& surface, double accuracy) {
  const int n = static_cast<int>(surface.triangles.size());
  if (n == 0) return;
  triangles_.reserve(surface.triangles.size());
  for (const auto& t : surface.triangles) {
    const Vec3& a = surface.vertices[static_cast<size_t>(t[0])];
    const Vec3& b = surface.vertices[static_cast<size_t>(t[1])];
    const Vec3& c = surface.vertices[static_cast<size_t>(t[2])];
    triangles_.push_back({a, b, c});
  }
  clusters_.reserve(static_cast<size_t>(n / 2 + 2));
  clusters_.emplace_back();
  clusters_[0].first = 0;
  clusters_[0].last = n;
  build(0, accuracy);
}

void WindingNumber::summarize(Cluster& cluster, double accuracy) const {
  double area = 0;
  Vec3 weighted = Vec3::Zero();
  Vec3 plain = Vec3::Zero();
  cluster.area_normal.setZero();
  // Sum of center * area normal^T, moved to the cluster's center afterwards.
  Mat3 moment = Mat3::Zero();
  for (int i = cluster.first; i < cluster.last; ++i) {
    const Triangle& t = triangles_[static_cast<size_t>(i)];
    const Vec3 normal = 0.5 * (t.b - t.a).cross(t.c - t.a);
    const Vec3 center = (t.a + t.b + t.c) / 3;
    const double size = normal.norm();
    area += size;
    weighted += size * center;
    plain += center;
    cluster.area_normal += normal;
    moment += center * normal.transpose();
  }
  cluster.center = area > 0 ? Vec3(weighted / area) : Vec3(plain / (cluster.last - cluster.first));
  cluster.moment = moment - cluster.center * cluster.area_normal.transpose();
  double radius_squared = 0;
  for (int i = cluster.first; i < cluster.last; ++i) {
    const Triangle& t = triangles_[static_cast<size_t>(i)];
    radius_squared = std::max({radius_squared, (t.a - cluster.center).squaredNorm(),
                               (t.b - cluster.center).squaredNorm(), (t.c - cluster.center).squaredNorm()});
  }
  cluster.far_squared = accuracy * accuracy * radius_squared;
}

void WindingNumber::build(int index, double accuracy) {
  summarize(clusters_[static_cast<size_t>(index)], accuracy);
  const int first = clusters_[static_cast<size_t>(index)].first;
  const int last = clusters_[static_cast<size_t>(index)].last;
  if (last - first <= kLeafSize) return;

  const auto sum = [](const Triangle& t) -> Vec3 { return t.a + t.b + t.c; };
  Vec3 low = sum(triangles_[static_cast<size_t>(first)]);
  Vec3 high = low;
  for (int i = first; i < last; ++i) {
    const Vec3 c = sum(triangles_[static_cast<size_t>(i)]);
    low = low.cwiseMin(c);
    high = high.cwiseMax(c);
  }
  Eigen::Index axis = 0;
  (high - low).maxCoeff(&axis);
  const int middle = (first + last) / 2;
  std::nth_element(triangles_.begin() + first, triangles_.begin() + middle, triangles_.begin() + last,
                   [axis](const Triangle& s, const Triangle& t) {
                     return s.a[axis] + s.b[axis] + s.c[axis] < t.a[axis] + t.b[axis] + t.c[axis];
                   });
  const int left = static_cast<int>(clusters_.size());
  clusters_[static_cast<size_t>(index)].left = left;
  clusters_.emplace_back();
  clusters_.emplace_back();
  clusters_[static_cast<size_t>(left)].first = first;
  clusters_[static_cast<size_t>(left)].last = middle;
  clusters_[static_cast<size_t>(left) + 1].first = middle;
  clusters_[static_cast<size_t>(left) + 1].last = last;
  build(left, accuracy);
  build(left + 1, accuracy);
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
  return angle / kFourPi;
}

double WindingNumber::exactAt(const Vec3& x) const {
  double angle = 0;
  for (const Triangle& t : triangles_) angle += solidAngle(t, x);
  return angle / kFourPi;
}

}  // namespace palpate
