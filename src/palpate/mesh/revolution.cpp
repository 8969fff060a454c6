#include "palpate/mesh/revolution.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/common/error.h"

namespace palpate {
namespace {

using Corner = std::array<double, 2>;

constexpr long long kMostTriangles = 1'000'000;

std::string cornerName(std::size_t i) { return "corner " + std::to_string(i + 1); }

double distance(const Corner& a, const Corner& b) { return std::hypot(a[0] - b[0], a[1] - b[1]); }

double cross(const Corner& o, const Corner& a, const Corner& b) {
  return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
}

double distanceToSide(const Corner& p, const Corner& a, const Corner& b) {
  const double dr = b[0] - a[0];
  const double dz = b[1] - a[1];
  const double along = std::clamp(((p[0] - a[0]) * dr + (p[1] - a[1]) * dz) / (dr * dr + dz * dz), 0.0, 1.0);
  return distance(p, {a[0] + along * dr, a[1] + along * dz});
}

/// Whether two sides without a common corner cross or come closer than a side may be short.
bool sidesMeet(const Corner& a, const Corner& b, const Corner& c, const Corner& d) {
  if (cross(a, b, c) * cross(a, b, d) < 0 && cross(c, d, a) * cross(c, d, b) < 0) return true;
  const double gap =
      std::min({distanceToSide(a, c, d), distanceToSide(b, c, d), distanceToSide(c, a, b), distanceToSide(d, a, b)});
  return gap < 0.5 * kShortestProfileSide;
}

/// Whether the polygon turns back onto the side it came along.
bool turnsBack(const Corner& before, const Corner& at, const Corner& after) {
  const double dot = (before[0] - at[0]) * (after[0] - at[0]) + (before[1] - at[1]) * (after[1] - at[1]);
  return dot > 0 && std::abs(cross(at, before, after)) < 1e-3 * distance(before, at) * distance(after, at);
}

bool onAxis(const Corner& corner) { return corner[0] == 0.0; }

std::optional<std::string> placeObjection(const RevolutionProfile& p, std::size_t i) {
  if (!std::isfinite(p[i][0]) || !std::isfinite(p[i][1])) return cornerName(i) + " is not finite";
  if (p[i][0] < 0.0) return cornerName(i) + " lies at a negative radius";
  if (!onAxis(p[i]) && p[i][0] < kShortestProfileSide)
    return cornerName(i) + " is neither on the axis nor at least 1e-05 m away from it";
  return std::nullopt;
}

std::optional<std::string> sideObjection(const RevolutionProfile& p, std::size_t i) {
  const std::size_t n = p.size();
  const Corner& before = p[(i + n - 1) % n];
  const Corner& after = p[(i + 1) % n];
  if (distance(p[i], after) < kShortestProfileSide)
    return cornerName(i) + " is less than 1e-05 m away from " + cornerName((i + 1) % n) +
           (i + 1 == n ? "; the last corner is joined to the first by itself" : "");
  if (onAxis(p[i]) && !onAxis(before) && !onAxis(after)) return cornerName(i) + " touches the axis in a single point";
  if (turnsBack(before, p[i], after)) return cornerName(i) + " turns back along its side";
  return std::nullopt;
}

std::optional<std::string> crossingObjection(const RevolutionProfile& p) {
  const std::size_t n = p.size();
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 2; j < n; ++j) {
      if (i == 0 && j + 1 == n) continue;  // neighbors
      if (sidesMeet(p[i], p[i + 1], p[j], p[(j + 1) % n]))
        return "the sides that start at " + cornerName(i) + " and " + cornerName(j) + " cross or touch";
    }
  }
  return std::nullopt;
}

/// A circle of the surface; on the axis, a single vertex.
struct Circle {
  double r = 0;
  double z = 0;
  int count = 1;
  int first = 0;  ///< index of its first vertex
};

class Lathe {
 public:
  Lathe(const RevolutionProfile& profile, int segments) : segments_(segments) {
    for (const Corner& corner : profile) largest_radius_ = std::max(largest_radius_, corner[0]);
    width_ = 2 * std::numbers::pi * largest_radius_ / segments;
    RevolutionProfile outward = profile;
    if (area(profile) < 0) std::reverse(outward.begin(), outward.end());
    requireSize(outward);
    for (std::size_t i = 0; i < outward.size(); ++i) corners_.push_back(addCorner(outward, i));
    for (std::size_t i = 0; i < outward.size(); ++i) addSide(outward, i);
  }

  Surface take() { return std::move(surface_); }

 private:
  static double area(const RevolutionProfile& p) {
    double sum = 0;
    for (std::size_t i = 0; i < p.size(); ++i) {
      const Corner& b = p[(i + 1) % p.size()];
      sum += 0.5 * (p[i][0] * b[1] - b[0] * p[i][1]);
    }
    return sum;
  }

  long long pieces(const Corner& a, const Corner& b) const {
    const double wanted = std::min(std::ceil(distance(a, b) / width_ - 0.01), 1e9);
    return std::max(1LL, static_cast<long long>(wanted));
  }

  /// Vertices of a circle: halved as long as they would be nearer to each other than half the width.
  int countAt(double r) const {
    if (r == 0.0) return 1;
    int count = segments_;
    for (double limit = 0.5 * largest_radius_; r <= limit && count % 2 == 0 && count >= 12; limit *= 0.5) count /= 2;
    return count;
  }

  void requireSize(const RevolutionProfile& p) const {
    long long rows = 0;
    for (std::size_t i = 0; i < p.size(); ++i) rows += pieces(p[i], p[(i + 1) % p.size()]);
    if (2 * rows * segments_ > kMostTriangles)
      throw InputError("revolution", "", "would have more than a million triangles; take fewer segments");
  }

  Circle addCircle(const Corner& corner) {
    Circle circle{corner[0], corner[1], countAt(corner[0]), static_cast<int>(surface_.vertices.size())};
    for (int i = 0; i < circle.count; ++i) {
      const double angle = 2 * std::numbers::pi * i / circle.count;
      surface_.vertices.push_back({circle.r * std::cos(angle), circle.r * std::sin(angle), circle.z});
    }
    return circle;
  }

  /// A corner inside a run along the axis belongs to no triangle and gets no vertex.
  Circle addCorner(const RevolutionProfile& p, std::size_t i) {
    const std::size_t n = p.size();
    if (onAxis(p[i]) && onAxis(p[(i + n - 1) % n]) && onAxis(p[(i + 1) % n])) return {};
    return addCircle(p[i]);
  }

  void addSide(const RevolutionProfile& p, std::size_t i) {
    const Corner& a = p[i];
    const Corner& b = p[(i + 1) % p.size()];
    if (onAxis(a) && onAxis(b)) return;
    const int count = static_cast<int>(pieces(a, b));
    Circle from = corners_[i];
    for (int k = 1; k <= count; ++k) {
      const double t = static_cast<double>(k) / count;
      const Circle to =
          k == count ? corners_[(i + 1) % p.size()] : addCircle({a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])});
      addBand(from, to);
      from = to;
    }
  }

  /// Triangles between two circles, going round both and advancing on the one that lags behind. The profile runs
  /// counter-clockwise in (r, z), so its outer side is on the right of the way from `a` to `b`.
  void addBand(const Circle& a, const Circle& b) {
    const auto vertex = [](const Circle& c, int i) { return c.first + i % c.count; };
    const int steps_a = a.count == 1 ? 0 : a.count;
    const int steps_b = b.count == 1 ? 0 : b.count;
    int i = 0;
    int j = 0;
    while (i < steps_a || j < steps_b) {
      // middles of the next steps, as fractions of a turn
      const double next_a = steps_a == 0 ? 2.0 : (i + 0.5) / steps_a;
      const double next_b = steps_b == 0 ? 2.0 : (j + 0.5) / steps_b;
      if (j == steps_b || (i < steps_a && next_a <= next_b)) {
        surface_.triangles.push_back({vertex(a, i), vertex(a, i + 1), vertex(b, j)});
        ++i;
      } else {
        surface_.triangles.push_back({vertex(a, i), vertex(b, j + 1), vertex(b, j)});
        ++j;
      }
    }
  }

  int segments_;
  double largest_radius_ = 0;
  double width_ = 0;  ///< of a segment on the largest circle [m]
  std::vector<Circle> corners_;
  Surface surface_;
};

}  // namespace

std::optional<std::string> profileObjection(const RevolutionProfile& profile) {
  const std::size_t n = profile.size();
  if (n < 3) return "a profile needs at least three corners";
  if (n > kLargestProfile)
    return "has " + std::to_string(n) + " corners; at most " + std::to_string(kLargestProfile) + " are allowed";
  for (std::size_t i = 0; i < n; ++i)
    if (auto cause = placeObjection(profile, i)) return cause;
  for (std::size_t i = 0; i < n; ++i)
    if (auto cause = sideObjection(profile, i)) return cause;
  return crossingObjection(profile);
}

Surface revolutionSurface(const RevolutionProfile& profile, int segments) {
  if (const auto cause = profileObjection(profile)) throw InputError("revolution", "profile", *cause);
  if (segments < kLeastRevolutionSegments || segments > kLargestRevolutionSegments)
    throw InputError(
        "revolution", "segments",
        "must be " + std::to_string(kLeastRevolutionSegments) + " to " + std::to_string(kLargestRevolutionSegments));
  return Lathe(profile, segments).take();
}

}  // namespace palpate
