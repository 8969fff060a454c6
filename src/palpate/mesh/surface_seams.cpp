#include "palpate/mesh/surface_seams.h"

#include <algorithm>
#include <cmath>

#include "palpate/common/cancellation.h"
#include "palpate/mesh/surface_measures.h"

namespace palpate {
namespace {

constexpr int kNear = 8;  // faces from one point's tetrahedron to that of the next: a third of a lattice point's star

class SeamFinder {
 public:
  SeamFinder(const Surface& surface, const BccLattice& lattice, const TetrahedronSubdivision& cut, PieceMesh& pieces,
             double spacing)
      : surface_(surface),
        cell_(lattice.cellSize()),
        locator_(lattice, cut, pieces),
        pieces_(pieces),
        spacing_(spacing) {}

  Seams run() {
    const std::vector<Vec3> normals = vertexNormals(surface_);
    for (std::size_t v = 0; v < normals.size(); ++v) corner_.push_back(hostUnder(surface_.vertices[v], normals[v]));
    for (const auto& t : surface_.triangles) examine(t);
    return std::move(seams_);
  }

 private:
  int hostUnder(const Vec3& x, const Vec3& normal) const {
    const int piece = locator_.under(x, normal);
    return piece < 0 ? -1 : pieces_.hostOf(piece);
  }

  // A grid over the triangle, n intervals a side; each point beside the two before it.
  void examine(const std::array<int, 3>& t) {
    throwIfCancelled();
    const Vec3 &a = surface_.vertices[t[0]], &b = surface_.vertices[t[1]], &c = surface_.vertices[t[2]];
    const double longest = std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
    const int n = std::clamp(static_cast<int>(std::ceil(longest / (0.5 * cell_))), 1, 400);
    const Vec3 normal = (b - a).cross(c - a).normalized();
    const auto place = [&](int i, int j) -> Vec3 { return a + (b - a) * i / n + (c - a) * j / n; };
    row_.assign(static_cast<std::size_t>(n) + 1, -1);
    for (int i = 0; i <= n; ++i) {
      int before = -1;  // the point (i, j - 1)
      for (int j = 0; i + j <= n; ++j) {
        const Vec3 x = place(i, j);
        int host = 0;
        if (i == 0 && j == 0) {
          host = corner_[t[0]];
        } else if (i == n) {
          host = corner_[t[1]];
        } else if (j == n) {
          host = corner_[t[2]];
        } else {
          host = hostUnder(x, normal);
        }
        if (j > 0) compare(before, host, place(i, j - 1), x);
        if (i > 0) compare(row_[j], host, place(i - 1, j), x);
        row_[j] = before = host;
      }
    }
    if (n == 1) compare(corner_[t[1]], corner_[t[2]], b, c);
  }

  void compare(int p, int q, const Vec3& from, const Vec3& to) {
    if (p >= 0 && q >= 0 && (p == q || pieces_.connectedNear(p, q, kNear))) return;
    ++seams_.count;
    const int steps = std::max(1, static_cast<int>(std::ceil((to - from).norm() / spacing_)));
    for (int k = 0; k <= steps; ++k) seams_.bridges.push_back(from + (to - from) * k / steps);
  }

  const Surface& surface_;
  double cell_;
  PieceLocator locator_;
  PieceMesh& pieces_;
  double spacing_;
  std::vector<int> corner_, row_;
  Seams seams_;
};

}  // namespace

int PieceLocator::at(const Vec3& x) const {
  const auto location = lattice_.locate(x);
  const auto slot = pieces_.solid().slot_of.find(location.tetrahedron);
  if (slot == pieces_.solid().slot_of.end()) return -1;
  const auto sample = static_cast<std::size_t>(slot->second) * static_cast<std::size_t>(cut_.count()) +
                      static_cast<std::size_t>(cut_.locate(location.weights));
  return pieces_.solid().label[sample];
}

int PieceLocator::under(const Vec3& x, const Vec3& normal) const {
  const double fine = lattice_.cellSize() / cut_.side();
  for (double depth : {0.4, 0.2, 0.7, 0.0, 1.0, 1.5}) {
    const int piece = at(x - depth * fine * normal);
    if (piece >= 0) return piece;
  }
  for (double radius : {0.5, 1.0, 1.6, 2.5, 4.0}) {
    int best = -1;
    double most_inward = -2;
    for (int i = 0; i < 27; ++i) {
      const Vec3 direction = Vec3(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1).normalized();
      const int piece = at(x + radius * fine * direction);
      if (piece < 0 || -direction.dot(normal) <= most_inward) continue;
      most_inward = -direction.dot(normal);
      best = piece;
    }
    if (best >= 0) return best;
  }
  return -1;
}

Seams findSeams(const Surface& surface, const BccLattice& lattice, const TetrahedronSubdivision& cut, PieceMesh& pieces,
                double spacing) {
  return SeamFinder(surface, lattice, cut, pieces, spacing).run();
}

}  // namespace palpate
