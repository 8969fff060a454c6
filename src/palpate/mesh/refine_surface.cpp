#include "palpate/mesh/refine_surface.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "palpate/common/cancellation.h"

namespace palpate {
namespace {

using Triangle = std::array<int, 3>;

/// One round: each edge longer than allowed gets a vertex in its middle.
class Splitter {
 public:
  Splitter(Surface& surface, double longest) : surface_(surface), longest_squared_(longest * longest) {}

  /// @returns whether anything was split
  bool run() {
    for (const Triangle& t : surface_.triangles) {
      for (int k = 0; k < 3; ++k) markLong(t[k], t[(k + 1) % 3]);
    }
    if (middle_.empty()) return false;
    for (const Triangle& t : surface_.triangles) split(t);
    surface_.triangles = std::move(out_);
    return true;
  }

 private:
  static std::pair<int, int> edge(int a, int b) { return {std::min(a, b), std::max(a, b)}; }

  void markLong(int a, int b) {
    if ((surface_.vertices[a] - surface_.vertices[b]).squaredNorm() <= longest_squared_) return;
    const auto [at, fresh] = middle_.try_emplace(edge(a, b), static_cast<int>(surface_.vertices.size()));
    if (fresh) surface_.vertices.push_back(0.5 * (surface_.vertices[a] + surface_.vertices[b]));
  }

  int middle(int a, int b) const {
    const auto at = middle_.find(edge(a, b));
    return at == middle_.end() ? -1 : at->second;
  }

  double distance(int a, int b) const { return (surface_.vertices[a] - surface_.vertices[b]).squaredNorm(); }

  // Into as many triangles as it has marked edges, and one more.
  void split(const Triangle& t) {
    std::array<int, 3> m;
    for (int k = 0; k < 3; ++k) m[k] = middle(t[k], t[(k + 1) % 3]);
    const auto marks = std::count_if(m.begin(), m.end(), [](int v) { return v >= 0; });
    if (marks == 0) {
      out_.push_back(t);
    } else if (marks == 3) {
      out_.push_back({m[0], m[1], m[2]});
      for (int k = 0; k < 3; ++k) out_.push_back({t[k], m[k], m[(k + 2) % 3]});
    } else if (marks == 1) {
      const int k = m[0] >= 0 ? 0 : m[1] >= 0 ? 1 : 2;
      out_.push_back({t[k], m[k], t[(k + 2) % 3]});
      out_.push_back({m[k], t[(k + 1) % 3], t[(k + 2) % 3]});
    } else {  // the unmarked edge runs from a to b; the quadrangle beside it is cut along its shorter diagonal
      const int k = m[0] < 0 ? 0 : m[1] < 0 ? 1 : 2;
      const int a = t[k], b = t[(k + 1) % 3], c = t[(k + 2) % 3], bc = m[(k + 1) % 3], ca = m[(k + 2) % 3];
      out_.push_back({ca, bc, c});
      if (distance(a, bc) <= distance(b, ca)) {
        out_.push_back({a, b, bc});
        out_.push_back({a, bc, ca});
      } else {
        out_.push_back({a, b, ca});
        out_.push_back({b, bc, ca});
      }
    }
  }

  Surface& surface_;
  double longest_squared_;
  std::map<std::pair<int, int>, int> middle_;  // vertex by edge
  std::vector<Triangle> out_;
};

// Triangles of edges a little shorter than `longest`.
double expectedTriangles(const Surface& s, double longest) {
  double count = 0;
  for (const Triangle& t : s.triangles) {
    const Vec3 ab = s.vertices[t[1]] - s.vertices[t[0]], ac = s.vertices[t[2]] - s.vertices[t[0]];
    const double side = std::sqrt(std::max({ab.squaredNorm(), ac.squaredNorm(), (ac - ab).squaredNorm()}));
    // by area, or by length where they are slender
    count += std::max({1.0, ab.cross(ac).norm() / (0.35 * longest * longest), side / longest});
  }
  return count;
}

}  // namespace

Surface refineSurface(const Surface& surface, double longest, std::size_t most) {
  Surface out = surface;
  if (!(longest > 0)) return out;
  const double limit = static_cast<double>(std::max(most, surface.triangles.size()));
  while (expectedTriangles(surface, longest) > limit && longest < 1e12) longest *= 1.25;
  while (Splitter(out, longest).run()) throwIfCancelled();
  return out;
}

}  // namespace palpate
