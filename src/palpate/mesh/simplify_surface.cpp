#include "palpate/mesh/simplify_surface.h"

#include <algorithm>
#include <boost/geometry.hpp>
#include <boost/geometry/index/rtree.hpp>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <queue>
#include <tuple>
#include <utility>
#include <vector>

#include "palpate/common/cancellation.h"
#include "palpate/math/triangle.h"
#include "palpate/mesh/surface_measures.h"

namespace palpate {
namespace {

namespace bg = boost::geometry;
namespace bgi = boost::geometry::index;
using Point = bg::model::point<double, 3, bg::cs::cartesian>;
using Box = bg::model::box<Point>;

constexpr double kMostOfSize = 0.01;  // of the diagonal, whatever the tolerance: what is near is to be few triangles
constexpr int kTries = 6;
constexpr double kLess = 0.6;     // of the tolerance, for the next try
constexpr double kWorthIt = 0.8;  // of the triangles left at most
constexpr double kTurn = 0.5;     // cosine of how far a triangle may turn at once
constexpr double kSlender = 0.1;  // height by longest edge
constexpr double kWorse = 0.9;    // of the slenderness before, where that was less

Point point(const Vec3& x) { return {x.x(), x.y(), x.z()}; }

/// How far points are from a surface, if they are near.
class NearSurface {
 public:
  NearSurface(const Surface& surface, double reach) : surface_(surface), reach_(reach) {
    std::vector<std::pair<Box, int>> boxes;
    for (int i = 0; i < static_cast<int>(surface.triangles.size()); ++i) {
      const auto [low, high] = extents(i);
      boxes.emplace_back(Box(point(low), point(high)), i);
    }
    tree_ = Tree(boxes);
  }

  /// Infinite beyond reach.
  double distance(const Vec3& x) const {
    const Vec3 reach = Vec3::Constant(reach_);
    double nearest = std::numeric_limits<double>::infinity();
    for (auto it = tree_.qbegin(bgi::intersects(Box(point(x - reach), point(x + reach)))); it != tree_.qend(); ++it) {
      const int i = it->second;
      nearest = std::min(nearest, closestOnTriangle(x, corner(i, 0), corner(i, 1), corner(i, 2)).distance);
    }
    return nearest <= reach_ ? nearest : std::numeric_limits<double>::infinity();
  }

  /// Pairs of its triangles, without a common vertex, that pass through each other.
  int crossings() const {
    int count = 0;
    for (int i = 0; i < static_cast<int>(surface_.triangles.size()); ++i) {
      const auto& t = surface_.triangles[i];
      const TriangleCorners corners{corner(i, 0), corner(i, 1), corner(i, 2)};
      const auto [low, high] = extents(i);
      for (auto it = tree_.qbegin(bgi::intersects(Box(point(low), point(high)))); it != tree_.qend(); ++it) {
        const int j = it->second;
        const auto& u = surface_.triangles[j];
        if (j <= i || std::find_first_of(t.begin(), t.end(), u.begin(), u.end()) != t.end()) continue;
        if (trianglesCross(corners, {corner(j, 0), corner(j, 1), corner(j, 2)})) ++count;
      }
    }
    return count;
  }

 private:
  using Tree = bgi::rtree<std::pair<Box, int>, bgi::rstar<16>>;

  const Vec3& corner(int triangle, int k) const { return surface_.vertices[surface_.triangles[triangle][k]]; }

  Bounds extents(int triangle) const {
    const Vec3 &a = corner(triangle, 0), &b = corner(triangle, 1), &c = corner(triangle, 2);
    return {a.cwiseMin(b).cwiseMin(c), a.cwiseMax(b).cwiseMax(c)};
  }

  const Surface& surface_;
  double reach_;
  Tree tree_;
};

/// Collapses edges of one surface: one end goes to the other.
class Collapser {
 public:
  /// @param whole  of that surface, its reach not less than the tolerance
  Collapser(const Surface& surface, const NearSurface& whole, double tolerance)
      : x_(surface.vertices),
        whole_(whole),
        triangles_(surface.triangles),
        at_(x_.size()),
        points_(triangles_.size()),
        quadrics_(x_.size(), Quadric::Zero()),
        stamps_(x_.size(), 0),
        locked_(x_.size(), 0),
        tolerance_(tolerance) {
    for (int i = 0; i < static_cast<int>(triangles_.size()); ++i)
      for (const int v : triangles_[i]) at_[v].push_back(i);
    lock();
    for (const Triangle& t : triangles_) {
      const Vec3 n = areaVector(t);
      const double area = n.norm();
      if (!(area > 0)) continue;
      Eigen::Vector4d plane;
      plane << n / area, -n.dot(x_[t[0]] - origin_) / area;
      for (const int v : t) quadrics_[v] += area * plane * plane.transpose();
    }
  }

  Surface run() {
    for (const Triangle& t : triangles_)
      for (int k = 0; k < 3; ++k) offer(t[k], t[(k + 1) % 3]);
    for (std::size_t n = 0; !heap_.empty(); ++n) {
      if (n % 4096 == 0) throwIfCancelled();
      const Offer best = heap_.top();
      heap_.pop();
      if (best.stamp != stamps_[best.from] + stamps_[best.to] || !mayGo(best.from, best.to)) continue;
      go(best.from, best.to);
    }
    return rest();
  }

 private:
  using Triangle = std::array<int, 3>;
  using Quadric = Eigen::Matrix4d;
  struct Offer {
    double cost;
    int from, to, stamp;
    // cheapest first; of equal ones always the same
    bool operator<(const Offer& o) const { return std::tie(o.cost, o.from, o.to) < std::tie(cost, from, to); }
  };

  Vec3 areaVector(const Triangle& t) const { return (x_[t[1]] - x_[t[0]]).cross(x_[t[2]] - x_[t[0]]); }

  // Square of the longest edge.
  double size(const Triangle& t) const {
    return std::max({(x_[t[1]] - x_[t[0]]).squaredNorm(), (x_[t[2]] - x_[t[1]]).squaredNorm(),
                     (x_[t[0]] - x_[t[2]]).squaredNorm()});
  }

  static bool has(const Triangle& t, int v) { return t[0] == v || t[1] == v || t[2] == v; }

  // Vertices whose triangles are no single fan stay: those at a boundary, and where surfaces meet.
  void lock() {
    std::vector<int> ends;
    for (std::size_t v = 0; v < x_.size(); ++v) {
      ends.clear();
      for (const int i : at_[v])
        for (const int w : triangles_[i])
          if (w != static_cast<int>(v)) ends.push_back(w);
      std::sort(ends.begin(), ends.end());
      bool fan = ends.size() >= 6;
      for (std::size_t k = 0; fan && k < ends.size(); k += 2)
        fan = ends[k] == ends[k + 1] && (k + 2 == ends.size() || ends[k + 2] != ends[k]);
      locked_[v] = !(fan && aroundOnce(static_cast<int>(v)));
    }
  }

  // From triangle to triangle around v, whether all of them are met.
  bool aroundOnce(int v) const {
    const int first = triangles_[at_[v].front()][(corner(at_[v].front(), v) + 1) % 3];
    int w = first;
    for (std::size_t met = 1; met <= at_[v].size(); ++met) {
      const auto next =
          std::find_if(at_[v].begin(), at_[v].end(), [&](int i) { return triangles_[i][(corner(i, v) + 1) % 3] == w; });
      if (next == at_[v].end()) return false;  // not of one orientation
      w = triangles_[*next][(corner(*next, v) + 2) % 3];
      if (w == first) return met == at_[v].size();
    }
    return false;
  }

  int corner(int triangle, int v) const {
    const Triangle& t = triangles_[triangle];
    return t[0] == v ? 0 : t[1] == v ? 1 : 2;
  }

  void offer(int from, int to) {
    if (locked_[from]) return;
    Eigen::Vector4d x;
    x << x_[to] - origin_, 1;
    heap_.push({x.dot((quadrics_[from] + quadrics_[to]) * x), from, to, stamps_[from] + stamps_[to]});
  }

  std::vector<int> neighbors(int v) const {
    std::vector<int> out;
    for (const int i : at_[v])
      for (const int w : triangles_[i])
        if (w != v) out.push_back(w);
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
  }

  // The surface stays a surface: the two ends have no neighbors in common but the two corners opposite their edge.
  bool staysSound(int from, int to) const {
    const std::vector<int> a = neighbors(from), b = neighbors(to);
    std::vector<int> common;
    std::set_intersection(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(common));
    return common.size() == 2 && at_[common[0]].size() > 3 && at_[common[1]].size() > 3;
  }

  // Neither turned over nor, unless it was, much more slender than a triangle should be.
  bool keepsShape(const Triangle& before, const Triangle& after) const {
    const Vec3 n = areaVector(before), m = areaVector(after);
    const double area = m.norm();
    if (!(n.dot(m) > kTurn * n.norm() * area)) return false;
    return area > std::min(kSlender * size(after), kWorse * n.norm() / size(before) * size(after));
  }

  // Collects the triangles that would be left of those at `from`, and finds where what was left out would then be.
  bool mayGo(int from, int to) {
    if (!staysSound(from, to)) return false;
    changed_.clear();
    for (const int i : at_[from]) {
      if (has(triangles_[i], to)) continue;
      Triangle after = triangles_[i];
      after[corner(i, from)] = to;
      if (!keepsShape(triangles_[i], after)) return false;
      changed_.emplace_back(i, after);
    }
    placed_.clear();
    if (!place(from)) return false;
    for (const int i : at_[from])
      for (const int p : points_[i])
        if (!place(p)) return false;
    return staysNear(to);
  }

  // The changed triangles lie at the surface, not only where a vertex was left out.
  bool staysNear(int to) const {
    return std::all_of(changed_.begin(), changed_.end(), [&](const auto& change) {
      const Triangle& t = change.second;
      const Vec3 middle = (x_[t[0]] + x_[t[1]] + x_[t[2]]) / 3;
      if (!(whole_.distance(middle) <= tolerance_)) return false;
      return std::all_of(t.begin(), t.end(),
                         [&](int w) { return w == to || whole_.distance(0.5 * (x_[w] + x_[to])) <= tolerance_; });
    });
  }

  // Vertex p, left out, to the nearest of the changed triangles, if that is near enough.
  bool place(int p) {
    double nearest = std::numeric_limits<double>::infinity();
    int where = -1;
    for (const auto& [i, t] : changed_) {
      const double distance = closestOnTriangle(x_[p], x_[t[0]], x_[t[1]], x_[t[2]]).distance;
      if (!(distance < nearest)) continue;
      nearest = distance;
      where = i;
    }
    placed_.emplace_back(p, where);
    return nearest <= tolerance_;
  }

  // As mayGo() has prepared it.
  void go(int from, int to) {
    for (const int i : at_[from]) {
      points_[i].clear();
      if (!has(triangles_[i], to)) continue;
      for (const int v : triangles_[i])
        if (v != from) at_[v].erase(std::find(at_[v].begin(), at_[v].end(), i));
      triangles_[i] = {-1, -1, -1};
    }
    for (const auto& [i, after] : changed_) {
      triangles_[i] = after;
      at_[to].push_back(i);
    }
    at_[from].clear();
    for (const auto& [p, i] : placed_) points_[i].push_back(p);
    quadrics_[to] += quadrics_[from];
    ++stamps_[to];
    for (const int w : neighbors(to)) {
      offer(to, w);
      offer(w, to);
    }
  }

  Surface rest() const {
    Surface out;
    std::vector<int> number(x_.size(), -1);
    for (const Triangle& t : triangles_) {
      if (t[0] < 0) continue;
      for (const int v : t) number[v] = 0;
      out.triangles.push_back(t);
    }
    for (std::size_t v = 0; v < x_.size(); ++v) {
      if (number[v] < 0) continue;
      number[v] = static_cast<int>(out.vertices.size());
      out.vertices.push_back(x_[v]);
    }
    for (Triangle& t : out.triangles)
      for (int& v : t) v = number[v];
    return out;
  }

  const std::vector<Vec3>& x_;
  const NearSurface& whole_;
  Vec3 origin_ = x_.empty() ? Vec3::Zero() : x_.front();  // near what is measured, so that squares keep their digits
  std::vector<Triangle> triangles_;                       // -1: gone
  std::vector<std::vector<int>> at_;                      // triangles by vertex
  std::vector<std::vector<int>> points_;  // vertices that were left out, by the triangle that they are nearest to
  std::vector<Quadric> quadrics_;         // sum of area times squared distance to planes, by vertex
  std::vector<int> stamps_;               // offers with an earlier one are out of date
  std::vector<char> locked_;
  std::priority_queue<Offer> heap_;
  double tolerance_;
  std::vector<std::pair<int, Triangle>> changed_;
  std::vector<std::pair<int, int>> placed_;
};

// Vertices, and of `middles` also the middles of triangles and of their edges; infinite if one is beyond reach.
double farthest(const Surface& from, bool middles, const NearSurface& to) {
  double far = 0;
  for (const Vec3& x : from.vertices) {
    far = std::max(far, to.distance(x));
    if (std::isinf(far)) return far;
  }
  if (!middles) return far;
  for (const auto& t : from.triangles) {
    const Vec3 &a = from.vertices[t[0]], &b = from.vertices[t[1]], &c = from.vertices[t[2]];
    for (const Vec3& x : {Vec3(0.5 * (a + b)), Vec3(0.5 * (b + c)), Vec3(0.5 * (c + a)), Vec3((a + b + c) / 3)})
      far = std::max(far, to.distance(x));
    if (std::isinf(far)) return far;
  }
  return far;
}

double farthestApart(const Surface& first, const NearSurface& near_first, const Surface& second,
                     const NearSurface& near_second) {
  return std::max(farthest(first, false, near_second), farthest(second, true, near_first));
}

}  // namespace

double farthestApart(const Surface& first, const Surface& second, double reach) {
  return farthestApart(first, NearSurface(first, reach), second, NearSurface(second, reach));
}

SimplifiedSurface simplifySurface(const Surface& surface, double tolerance) {
  if (!(tolerance > 0) || surface.triangles.empty()) return {surface, 0};
  const Bounds box = boundsOf(surface.vertices);
  tolerance = std::min(tolerance, kMostOfSize * (box.high - box.low).norm());
  const NearSurface whole(surface, tolerance);
  std::optional<int> crossings_before;
  const auto asApart = [&](const NearSurface& simpler) {
    const int crossings = simpler.crossings();
    if (crossings == 0) return true;
    if (!crossings_before) crossings_before = whole.crossings();
    return crossings <= *crossings_before;
  };
  double within = tolerance;
  for (int i = 0; i < kTries; ++i, within *= kLess) {
    SimplifiedSurface out{Collapser(surface, whole, within).run(), 0};
    if (static_cast<double>(out.surface.triangles.size()) > kWorthIt * static_cast<double>(surface.triangles.size()))
      break;
    const NearSurface near(out.surface, tolerance);
    out.deviation = farthestApart(surface, whole, out.surface, near);
    if (out.deviation <= tolerance && asApart(near)) return out;
  }
  return {surface, 0};
}

}  // namespace palpate
