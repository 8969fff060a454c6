#include "palpate/mesh/polygon.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <queue>

namespace palpate {
namespace {

using Vec2 = Eigen::Vector2d;

// Of the polygon's extent. Vertices as near as kFlat are welded (RepairOptions): what is no higher may lie the wrong
// way round. kRound is more than rounding makes.
constexpr double kFlat = 1e-6;
constexpr double kRound = 1e-9;

double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Twice the area of a triangle, positive if it runs counter-clockwise.
double area(const Vec2& a, const Vec2& b, const Vec2& c) { return cross(b - a, c - a); }

/// Height of a triangle over its longest side, negative if it runs clockwise.
double height(const Vec2& a, const Vec2& b, const Vec2& c) {
  const double longest = std::sqrt(std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()}));
  return longest > 0 ? area(a, b, c) / longest : 0.0;
}

/// Cuts ears off a polygon that runs counter-clockwise (Meisters 1975), the one with the shortest cut first, so that
/// triangles are not needles where they need not be.
class EarCutter {
 public:
  EarCutter(const std::vector<Vec2>& points, double extent, long long& looks)
      : x_(points),
        flat_(kFlat * extent),
        round_(kRound * extent),
        looks_(looks),
        n_(static_cast<int>(points.size())) {}

  /// False if the polygon crosses itself or the looks have run out.
  bool cut(std::vector<std::array<int, 3>>& out) {
    link();
    int left = n_;
    // A corner that comes twice in a row has no side of its own.
    for (int v = 0; left > 3 && v < n_; ++v) {
      if (x_[at(v)] != x_[at(next_[at(v)])]) continue;
      remove(v, out);
      --left;
    }
    sortBlockers();
    offerAll(Strictness::strict);
    for (; left > 3; --left) {
      const int v = nextEar();
      if (v < 0) return false;
      const int a = prev_[at(v)];
      const int c = next_[at(v)];
      remove(v, out);
      offer(a, Strictness::strict);
      offer(c, Strictness::strict);
    }
    int first = 0;
    while (gone_[at(first)]) ++first;
    if (cornerHeight(first) < -flat_) return false;
    out.push_back({prev_[at(first)], first, next_[at(first)]});
    return true;
  }

 private:
  /// What may be cut off: an ear whose triangle no other corner touches; one that none lies within; a corner without
  /// area.
  enum class Strictness { strict, loose, flat };

  struct Offer {
    double length;
    int v;
    int stamp;
    bool operator>(const Offer& o) const { return length > o.length || (length == o.length && v > o.v); }
  };

  static size_t at(int v) { return static_cast<size_t>(v); }

  void link() {
    prev_.resize(x_.size());
    next_.resize(x_.size());
    gone_.assign(x_.size(), 0);
    stamp_.assign(x_.size(), 0);
    for (int v = 0; v < n_; ++v) {
      prev_[at(v)] = v > 0 ? v - 1 : n_ - 1;
      next_[at(v)] = v + 1 < n_ ? v + 1 : 0;
    }
  }

  double cornerHeight(int v) const { return height(x_[at(prev_[at(v)])], x_[at(v)], x_[at(next_[at(v)])]); }

  void remove(int v, std::vector<std::array<int, 3>>& out) {
    const int a = prev_[at(v)];
    const int c = next_[at(v)];
    out.push_back({a, v, c});
    next_[at(a)] = c;
    prev_[at(c)] = a;
    gone_[at(v)] = 1;
    ++stamp_[at(a)];
    ++stamp_[at(c)];
  }

  // Only corners that are not convex can lie in an ear without a neighbor in it. They are sorted along the axis on
  // which sides, and so ears, cover the smaller part of the polygon.
  void sortBlockers() {
    Vec2 low = x_.front();
    Vec2 high = low;
    Vec2 sides = Vec2::Zero();
    for (int v = 0; v < n_; ++v) {
      low = low.cwiseMin(x_[at(v)]);
      high = high.cwiseMax(x_[at(v)]);
      sides += (x_[at(next_[at(v)])] - x_[at(v)]).cwiseAbs();
    }
    const Vec2 size = high - low;
    axis_ = sides.x() * size.y() <= sides.y() * size.x() ? 0 : 1;
    for (int v = 0; v < n_; ++v)
      if (!gone_[at(v)] && cornerHeight(v) <= round_) blockers_.push_back(v);
    std::stable_sort(blockers_.begin(), blockers_.end(),
                     [&](int a, int b) { return x_[at(a)][axis_] < x_[at(b)][axis_]; });
  }

  int nextEar() {
    for (const Strictness strictness : {Strictness::strict, Strictness::loose, Strictness::flat}) {
      if (offers_.empty()) offerAll(strictness);
      while (!offers_.empty()) {
        const Offer best = offers_.top();
        offers_.pop();
        if (gone_[at(best.v)] || stamp_[at(best.v)] != best.stamp) continue;
        // The others only as long as there is no better one.
        if (strictness != Strictness::strict) offers_ = {};
        return best.v;
      }
    }
    return -1;
  }

  void offerAll(Strictness strictness) {
    for (int v = 0; v < n_; ++v)
      if (!gone_[at(v)]) offer(v, strictness);
  }

  void offer(int v, Strictness strictness) {
    if (--looks_ < 0) return;
    const double h = cornerHeight(v);
    if (strictness == Strictness::flat ? std::abs(h) > flat_ : h <= round_ || blocked(v, strictness)) return;
    offers_.push({(x_[at(next_[at(v)])] - x_[at(prev_[at(v)])]).squaredNorm(), v, stamp_[at(v)]});
  }

  bool blocked(int v, Strictness strictness) {
    const Vec2& a = x_[at(prev_[at(v)])];
    const Vec2& b = x_[at(v)];
    const Vec2& c = x_[at(next_[at(v)])];
    const double margin = strictness == Strictness::strict ? round_ : -flat_;
    const double low = std::min({a[axis_], b[axis_], c[axis_]}) - flat_;
    const double high = std::max({a[axis_], b[axis_], c[axis_]}) + flat_;
    const double ab = margin * (b - a).norm();
    const double bc = margin * (c - b).norm();
    const double ca = margin * (a - c).norm();
    auto it = std::lower_bound(blockers_.begin(), blockers_.end(), low,
                               [&](int q, double value) { return x_[at(q)][axis_] < value; });
    for (; it != blockers_.end() && x_[at(*it)][axis_] <= high; ++it) {
      const int q = *it;
      if (--looks_ < 0) return true;
      if (gone_[at(q)] || q == v || q == prev_[at(v)] || q == next_[at(v)]) continue;
      const Vec2& p = x_[at(q)];
      if (p == a || p == c) continue;
      if (p == b) {
        if (leadsInto(q, a, b, c)) return true;
      } else if (area(a, b, p) >= -ab && area(b, c, p) >= -bc && area(c, a, p) >= -ca) {
        return true;
      }
    }
    return false;
  }

  // Where the polygon comes by an ear's tip a second time: whether it comes from the ear or goes there.
  bool leadsInto(int q, const Vec2& a, const Vec2& b, const Vec2& c) const {
    for (const int w : {prev_[at(q)], next_[at(q)]})
      if (height(a, b, x_[at(w)]) > round_ && height(b, c, x_[at(w)]) > round_) return true;
    return false;
  }

  const std::vector<Vec2>& x_;
  double flat_, round_;
  long long& looks_;
  int n_;
  int axis_ = 0;
  std::vector<int> prev_, next_, stamp_, blockers_;
  std::vector<char> gone_;
  std::priority_queue<Offer, std::vector<Offer>, std::greater<>> offers_;
};

/// Twice the area, along its normal (Newell).
Vec3 areaOf(const std::vector<Vec3>& vertices, std::span<const int> corners, const Vec3& origin) {
  Vec3 sum = Vec3::Zero();
  Vec3 last = vertices[static_cast<size_t>(corners.back())] - origin;
  for (const int v : corners) {
    const Vec3 x = vertices[static_cast<size_t>(v)] - origin;
    sum += last.cross(x);
    last = x;
  }
  return sum;
}

/// False if it is to be the fan.
bool cutEars(const std::vector<Vec3>& vertices, std::span<const int> corners, long long& looks,
             std::array<int, 3>* out) {
  const Vec3& origin = vertices[static_cast<size_t>(corners.front())];
  const Vec3 doubled = areaOf(vertices, corners, origin);
  Vec3 low = origin;
  Vec3 high = origin;
  for (const int v : corners) {
    low = low.cwiseMin(vertices[static_cast<size_t>(v)]);
    high = high.cwiseMax(vertices[static_cast<size_t>(v)]);
  }
  const double extent = (high - low).norm();
  const double flat = kFlat * extent;
  if (!(doubled.norm() > flat * extent)) return false;
  const Vec3 normal = doubled.normalized();
  // All that most files' polygons cost.
  bool fan = true;
  for (size_t k = 1; fan && k + 1 < corners.size(); ++k) {
    const Vec3 b = vertices[static_cast<size_t>(corners[k])] - origin;
    const Vec3 c = vertices[static_cast<size_t>(corners[k + 1])] - origin;
    const double longest = std::sqrt(std::max({b.squaredNorm(), c.squaredNorm(), (c - b).squaredNorm()}));
    fan = b.cross(c).dot(normal) >= -flat * longest;
  }
  if (fan) return false;
  const Vec3 across = normal.unitOrthogonal();
  const Vec3 up = normal.cross(across);
  std::vector<Vec2> points;
  points.reserve(corners.size());
  for (const int v : corners) {
    const Vec3 x = vertices[static_cast<size_t>(v)] - origin;
    points.push_back({x.dot(across), x.dot(up)});
  }
  std::vector<std::array<int, 3>> triangles;
  triangles.reserve(corners.size() - 2);
  if (!EarCutter(points, extent, looks).cut(triangles)) return false;
  for (const auto& t : triangles) {
    for (size_t k = 0; k < 3; ++k) (*out)[k] = corners[static_cast<size_t>(t[k])];
    ++out;
  }
  return true;
}

}  // namespace

void cutPolygon(const std::vector<Vec3>& vertices, std::span<const int> corners, long long& looks,
                std::array<int, 3>* out) {
  if (corners.size() > 3 && cutEars(vertices, corners, looks, out)) return;
  for (size_t k = 1; k + 1 < corners.size(); ++k) *out++ = {corners[0], corners[k], corners[k + 1]};
}

}  // namespace palpate
