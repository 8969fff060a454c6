#include "palpate/mesh/thickness.h"

#include <algorithm>
#include <cmath>

#include "palpate/common/cancellation.h"
#include "palpate/mesh/surface_measures.h"

namespace palpate {
namespace {

constexpr double kNearest = 1e-5;  // of the bounding box's diagonal, where the search begins
constexpr double kGrowth = 1.15;
constexpr double kAccuracy = 0.01;

// Inward from x; negative if nothing is there.
double depthOf(const InsideField& field, const Vec3& x, const Vec3& inward, double diagonal) {
  double inside = kNearest * diagonal;
  if (!field.inside(x + inside * inward)) return -1;
  double outside = inside;
  while (field.inside(x + outside * inward)) {
    inside = outside;
    outside *= kGrowth;
    if (outside > 2 * diagonal) return diagonal;
  }
  while (outside - inside > kAccuracy * inside) {
    const double middle = 0.5 * (inside + outside);
    (field.inside(x + middle * inward) ? inside : outside) = middle;
  }
  return outside;
}

}  // namespace

std::vector<double> solidThickness(const Surface& surface, const InsideField& field, int places) {
  const double diagonal = boundsOf(surface.vertices).diagonal();
  double area = 0;
  for (const auto& t : surface.triangles) {
    const Vec3& a = surface.vertices[t[0]];
    area += 0.5 * (surface.vertices[t[1]] - a).cross(surface.vertices[t[2]] - a).norm();
  }
  std::vector<double> out;
  const double each = area / places;
  double passed = 0, next = 0.5 * each;
  for (const auto& t : surface.triangles) {
    const Vec3& a = surface.vertices[t[0]];
    const Vec3 ab = surface.vertices[t[1]] - a, ac = surface.vertices[t[2]] - a, normal = ab.cross(ac);
    passed += 0.5 * normal.norm();
    for (int k = 0; next < passed; ++k, next += each) {
      throwIfCancelled();
      // the golden ratio's multiples spread over the triangle
      double u = std::fmod(1.0 / 3 + 0.7548776662466927 * k, 1.0), v = std::fmod(1.0 / 3 + 0.5698402909980532 * k, 1.0);
      if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
      }
      const double d = depthOf(field, a + u * ab + v * ac, -normal.normalized(), diagonal);
      if (d > 0) out.push_back(d);
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

double thicknessAt(const std::vector<double>& thickness, double share) {
  if (thickness.empty()) return 0;
  const auto last = thickness.size() - 1;
  return thickness[std::min(last, static_cast<std::size_t>(share * static_cast<double>(thickness.size())))];
}

}  // namespace palpate
