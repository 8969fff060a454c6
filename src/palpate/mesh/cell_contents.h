#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "palpate/mesh/bcc_lattice.h"
#include "palpate/mesh/inside_field.h"

namespace palpate {

/// Which cells of a lattice the surface passes through and which lie inside. Work and memory grow with their number,
/// not with the lattice: a slender body that lies askew fills little of its bounding box.
class CellContents {
 public:
  enum class Content : char { outside, inside, cut };
  using Cell = BccLattice::Point;

  CellContents(const BccLattice& lattice, const InsideField& field);

  Content at(const Cell& cell) const {
    const auto found = contents_.find(index(cell));
    return found == contents_.end() ? Content::outside : found->second;
  }
  /// Those that are not outside, ascending in z, then y, then x.
  std::vector<Cell> filled() const;

 private:
  int64_t index(const Cell& c) const { return c[0] + counts_[0] * (c[1] + counts_[1] * c[2]); }
  Cell cellAt(int64_t i) const {
    return {static_cast<int>(i % counts_[0]), static_cast<int>(i / counts_[0] % counts_[1]),
            static_cast<int>(i / counts_[0] / counts_[1])};
  }
  template <class Visit>
  void forEachNeighbor(int64_t cell, Visit visit) const;
  void markCut(const Vec3& a, const Vec3& b, const Vec3& c);
  void fillFrom(const std::vector<int64_t>& cut, const BccLattice& lattice, const InsideField& field);

  std::array<int64_t, 3> counts_;
  std::unordered_map<int64_t, Content> contents_;
};

}  // namespace palpate
