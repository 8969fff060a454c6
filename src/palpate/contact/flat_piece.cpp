#include "palpate/contact/flat_piece.h"

#include <algorithm>
#include <limits>

namespace palpate {
namespace {

constexpr double kOnePlane = 0.99995;        // cosine of normals
constexpr std::size_t kMostTriangles = 256;  // bounds the time
constexpr double kBeside = 1e-5;             // [m]: so far beside a triangle a line still is on it

using Vec2 = Eigen::Vector2d;

// Where a triangle is within kBeside of the first axis, along it; empty (low > high) where it is not.
std::array<double, 2> alongAxis(const std::array<Vec2, 3>& corner) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  const auto take = [&](double u) {
    low = std::min(low, u);
    high = std::max(high, u);
  };
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec2 &p = corner[k], &q = corner[(k + 1) % 3];
    if (std::abs(p.y()) <= kBeside) take(p.x());
    for (const double v : {-kBeside, kBeside}) {
      if ((p.y() - v) * (q.y() - v) < 0) take(p.x() + (v - p.y()) / (q.y() - p.y()) * (q.x() - p.x()));
    }
  }
  return {low, high};
}

}  // namespace

Vec3 normalAtStart(const CollisionSurface& surface, int triangle) {
  for (const int v : surface.triangles()[static_cast<std::size_t>(triangle)]) surface.placeStart(v);
  return surface.areaNormal(triangle, 0).normalized();
}

FlatPiece::FlatPiece(const CollisionSurface& surface, std::span<const int> triangles, const Vec3& facing) {
  int first = -1;
  for (const int t : triangles) {
    const Vec3 n = normalAtStart(surface, t);
    if (first >= 0 && !(n.dot(facing) > normal_.dot(facing))) continue;
    first = t;
    normal_ = n;
  }
  if (first < 0) return;
  std::vector<int> piece{first};
  for (std::size_t i = 0; i < piece.size(); ++i) {
    auto& corners = corners_.emplace_back();  // placed for the normal
    for (std::size_t k = 0; k < 3; ++k) {
      corners[k] = surface.start[static_cast<std::size_t>(surface.triangles()[static_cast<std::size_t>(piece[i])][k])];
    }
    for (const int e : surface.triangleEdges()[static_cast<std::size_t>(piece[i])]) {
      for (const int t : surface.edgeTriangles()[static_cast<std::size_t>(e)]) {
        if (t < 0 || piece.size() >= kMostTriangles || std::find(piece.begin(), piece.end(), t) != piece.end())
          continue;
        if (normalAtStart(surface, t).dot(normal_) > kOnePlane) piece.push_back(t);
      }
    }
  }
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3 edge = corners_[0][(k + 1) % 3] - corners_[0][k];
    if (k == 0 || edge.squaredNorm() < along_.squaredNorm()) along_ = edge;
  }
  along_.normalize();
}

std::array<double, 2> FlatPiece::extent(const Vec3& place, const Vec3& direction) const {
  const Vec3 across = normal_.cross(direction);
  std::vector<std::array<double, 2>> parts;
  for (const std::array<Vec3, 3>& x : corners_) {
    std::array<Vec2, 3> corner;
    for (std::size_t k = 0; k < 3; ++k) corner[k] = Vec2(direction.dot(x[k] - place), across.dot(x[k] - place));
    const std::array<double, 2> part = alongAxis(corner);
    if (part[0] <= part[1]) parts.push_back(part);
  }
  std::sort(parts.begin(), parts.end());
  std::array<double, 2> out{0, 0}, run{0, -1};
  const auto close = [&] {
    if (run[0] <= kBeside && run[1] >= -kBeside) out = {std::min(run[0], 0.0), std::max(run[1], 0.0)};
  };
  for (const std::array<double, 2>& part : parts) {
    if (run[1] < run[0]) {
      run = part;
    } else if (part[0] <= run[1] + kBeside) {
      run[1] = std::max(run[1], part[1]);
    } else {
      close();
      run = part;
    }
  }
  if (run[0] <= run[1]) close();
  return out;
}

}  // namespace palpate
