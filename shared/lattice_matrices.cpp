#include "shared/lattice_matrices.h"

#include <algorithm>
#include <map>
#include <random>
#include <utility>

namespace palpate::test {
namespace {

using Cell = std::array<int, 3>;

// The six tetrahedra around the diagonal of a cell, by corner number (bit 0: x, bit 1: y, bit 2: z).
constexpr std::array<std::array<int, 4>, 6> kTetrahedra = {
    {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7}, {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}}};

std::vector<Cell> box(Cell low, Cell size) {
  std::vector<Cell> cells;
  for (int k = 0; k < size[2]; ++k)
    for (int j = 0; j < size[1]; ++j)
      for (int i = 0; i < size[0]; ++i) cells.push_back({low[0] + i, low[1] + j, low[2] + k});
  return cells;
}

LatticeMatrix fromCells(const std::vector<Cell>& cells, std::uint32_t seed) {
  std::map<std::array<int, 3>, int> cells_at;  // by lattice point, in z, y, x order: how many of its eight cells exist
  for (const Cell& c : cells)
    for (int corner = 0; corner < 8; ++corner)
      ++cells_at[{c[2] + (corner >> 2), c[1] + ((corner >> 1) & 1), c[0] + (corner & 1)}];
  const int bottom = cells_at.begin()->first[0];
  const int top = cells_at.rbegin()->first[0];

  LatticeMatrix lattice;
  std::map<std::array<int, 3>, int> node;  // -1: held
  int count = 0;
  for (const auto& [point, cells_here] : cells_at) {
    node[point] = point[0] == top ? -1 : count++;
    if (node[point] < 0) continue;
    if (point[0] == bottom) lattice.bottom.push_back(node[point]);
    if (cells_here < 8) lattice.surface.push_back(node[point]);
  }

  std::vector<std::array<int, 4>> tetrahedra;
  std::vector<std::pair<int, int>> pairs;
  for (const Cell& c : cells) {
    for (const auto& corners : kTetrahedra) {
      std::array<int, 4> tet{};
      for (int v = 0; v < 4; ++v)
        tet[v] = node[{c[2] + (corners[v] >> 2), c[1] + ((corners[v] >> 1) & 1), c[0] + (corners[v] & 1)}];
      tetrahedra.push_back(tet);
      for (int a = 0; a < 4; ++a)
        for (int b = 0; b < a; ++b)
          if (tet[a] >= 0 && tet[b] >= 0) pairs.emplace_back(tet[a], tet[b]);
    }
  }
  lattice.tetrahedra = static_cast<int>(tetrahedra.size());
  lattice.matrix = SymmetricBlockMatrix::fromPairs(count, pairs);

  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (const auto& tet : tetrahedra) {
    Eigen::Matrix<double, 6, 12>
        b;  // stiffness of rank six, without effect on translation, like a linear tetrahedron's
    for (int i = 0; i < b.size(); ++i) b.data()[i] = uniform(random);
    b.leftCols<3>() = -(b.middleCols<3>(3) + b.middleCols<3>(6) + b.rightCols<3>());
    const Eigen::Matrix<double, 12, 12> k = b.transpose() * b;
    for (int a = 0; a < 4; ++a)
      for (int c = 0; c < 4; ++c)
        if (tet[a] >= tet[c] && tet[c] >= 0)
          lattice.matrix.block(lattice.matrix.find(tet[a], tet[c])) += k.block<3, 3>(3 * a, 3 * c);
  }
  for (int i = 0; i < count; ++i) lattice.matrix.block(lattice.matrix.find(i, i)).diagonal().array() += 0.5;
  return lattice;
}

}  // namespace

LatticeMatrix barMatrix(int x, int y, int z, std::uint32_t seed) { return fromCells(box({0, 0, 0}, {x, y, z}), seed); }

LatticeMatrix thinLimbedMatrix(std::uint32_t seed) {
  std::vector<Cell> cells;
  const auto add = [&cells](Cell low, Cell size) {
    const std::vector<Cell> part = box(low, size);
    cells.insert(cells.end(), part.begin(), part.end());
  };
  add({0, 0, 0}, {3, 2, 3});   // trunk
  add({0, 0, 3}, {2, 2, 2});   // head
  add({-5, 0, 1}, {5, 1, 1});  // arms
  add({3, 1, 1}, {5, 1, 1});
  add({0, 0, -6}, {1, 1, 6});  // legs
  add({2, 1, -6}, {1, 1, 6});
  return fromCells(cells, seed);
}

}  // namespace palpate::test
