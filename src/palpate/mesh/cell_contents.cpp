#include "palpate/mesh/cell_contents.h"

#include <algorithm>
#include <cmath>

#include "palpate/common/cancellation.h"

namespace palpate {
namespace {

constexpr double kSlack = 1e-6;    // cells: what only touches a cell from outside cuts it
constexpr double kMostCells = 64;  // in the box of a triangle whose cells are tried one by one

}  // namespace

CellContents::CellContents(const BccLattice& lattice, const InsideField& field) {
  for (std::size_t d = 0; d < 3; ++d) counts_[d] = lattice.cells()[d];
  const auto toCells = [&](const Vec3& x) -> Vec3 { return (x - lattice.origin()) / lattice.cellSize(); };
  field.forEachTriangle(
      [&](const Vec3& a, const Vec3& b, const Vec3& c) { markCut(toCells(a), toCells(b), toCells(c)); });
  std::vector<int64_t> cut;
  cut.reserve(contents_.size());
  for (const auto& [cell, content] : contents_) cut.push_back(cell);
  fillFrom(cut, lattice, field);
}

// Corners in cells. Long triangles that lie askew are halved, as few cells of their boxes are on them.
void CellContents::markCut(const Vec3& a, const Vec3& b, const Vec3& c) {
  throwIfCancelled();
  const Vec3 low = a.cwiseMin(b).cwiseMin(c) - Vec3::Constant(kSlack);
  const Vec3 high = a.cwiseMax(b).cwiseMax(c) + Vec3::Constant(kSlack);
  Cell from, to;
  double cells = 1;
  for (std::size_t d = 0; d < 3; ++d) {
    const auto e = static_cast<Eigen::Index>(d);
    const double last = static_cast<double>(counts_[d]) - 1;
    from[d] = static_cast<int>(std::clamp(std::floor(low[e]), 0.0, last));
    to[d] = static_cast<int>(std::clamp(std::floor(high[e]), 0.0, last));
    cells *= to[d] - from[d] + 1;
  }
  if (cells > kMostCells) {
    const double ab = (b - a).squaredNorm(), bc = (c - b).squaredNorm(), ca = (a - c).squaredNorm();
    if (ab >= bc && ab >= ca) {
      const Vec3 m = 0.5 * (a + b);
      markCut(a, m, c);
      markCut(m, b, c);
    } else if (bc >= ca) {
      const Vec3 m = 0.5 * (b + c);
      markCut(b, m, a);
      markCut(m, c, a);
    } else {
      const Vec3 m = 0.5 * (c + a);
      markCut(c, m, b);
      markCut(m, a, b);
    }
    return;
  }
  const Vec3 normal = (b - a).cross(c - a).normalized();
  const double reach = 0.5 * normal.cwiseAbs().sum() + kSlack;
  for (int k = from[2]; k <= to[2]; ++k)
    for (int j = from[1]; j <= to[1]; ++j)
      for (int i = from[0]; i <= to[0]; ++i) {
        const Vec3 center(i + 0.5, j + 0.5, k + 0.5);
        // a degenerate triangle has no normal: then the whole box of it is cut
        if (!(std::abs(normal.dot(center - a)) > reach)) contents_[index({i, j, k})] = Content::cut;
      }
}

template <class Visit>
void CellContents::forEachNeighbor(int64_t cell, Visit visit) const {
  const Cell c = cellAt(cell);
  for (std::size_t d = 0; d < 3; ++d) {
    for (const int step : {-1, 1}) {
      Cell other = c;
      other[d] += step;
      if (other[d] >= 0 && other[d] < counts_[d]) visit(index(other));
    }
  }
}

// No surface passes between neighbors that are not cut, so one test serves all that are connected. What is outside is
// marked only beside the surface, so that it is not asked about again.
void CellContents::fillFrom(const std::vector<int64_t>& cut, const BccLattice& lattice, const InsideField& field) {
  std::vector<int64_t> stack;
  const auto test = [&](int64_t cell) {
    const auto [at, fresh] = contents_.try_emplace(cell, Content::outside);
    if (!fresh) return;
    const Cell c = cellAt(cell);
    if (!field.inside(lattice.position({2 * c[0] + 1, 2 * c[1] + 1, 2 * c[2] + 1}))) return;
    at->second = Content::inside;
    stack.push_back(cell);
  };
  const auto spread = [&](int64_t cell) {
    if (contents_.try_emplace(cell, Content::inside).second) stack.push_back(cell);
  };
  for (const int64_t cell : cut) {
    throwIfCancelled();
    forEachNeighbor(cell, test);
    while (!stack.empty()) {
      const int64_t inside = stack.back();
      stack.pop_back();
      forEachNeighbor(inside, spread);
    }
  }
}

std::vector<CellContents::Cell> CellContents::filled() const {
  std::vector<int64_t> indices;
  for (const auto& [cell, content] : contents_) {
    if (content != Content::outside) indices.push_back(cell);
  }
  std::sort(indices.begin(), indices.end());
  std::vector<Cell> out;
  out.reserve(indices.size());
  for (const int64_t i : indices) out.push_back(cellAt(i));
  return out;
}

}  // namespace palpate
