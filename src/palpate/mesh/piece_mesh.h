#pragma once

#include <vector>

#include "palpate/mesh/edge_table.h"
#include "palpate/mesh/solid_pieces.h"

namespace palpate {

/// From pieces of solid to copies of lattice tetrahedra: unites the corners of linked pieces, merges copies that became
/// the same, hands slivers to neighbors and drops crumbs that hang on nothing.
class PieceMesh {
 public:
  PieceMesh(const BccLattice& lattice, const TetrahedronSubdivision& cut, SolidPieces solid, double smallest_fill,
            bool virtual_nodes);

  const SolidPieces& solid() const { return solid_; }
  const std::vector<int>& kept() const { return kept_; }
  int count() const { return static_cast<int>(kept_.size()); }
  int mergedSlivers() const { return merged_slivers_; }
  /// The kept piece that a piece has become part of.
  int hostOf(int piece) const;
  /// Class of a piece's corner: equal for corners that are one node.
  int nodeClass(int piece, int corner) { return classes_.find(4 * piece + corner); }
  /// Kept pieces that share a face, three nodes, with a kept piece.
  std::vector<int> keptNeighbors(int piece) const;
  /// Of the kept pieces, connected through faces: what is connected so has the six rigid modes and no hinge.
  int components() const;
  /// Whether two kept pieces are connected through at most `faces` faces.
  bool connectedNear(int piece, int other, int faces) const;

 private:
  void uniteCorners(bool virtual_nodes);
  void mergeIdentical();
  void findFaces();
  void mergeSlivers(double smallest_fill);
  void dropCrumbs();
  bool giveAway(int piece);
  bool staysConnected(int piece, const std::vector<int>& neighbors) const;
  /// Whether at most `faces` faces lead from a kept piece to each of others, with none through the piece `without`.
  bool reaches(int piece, const std::vector<int>& others, int faces, int without) const;
  DisjointSets faceComponents() const;
  double worstWeight(int piece, int host) const;
  void absorb(int piece, int host);
  bool isKept(int piece) const { return host_[static_cast<size_t>(piece)] == piece; }
  int64_t tetrahedronOf(int piece) const {
    return solid_.tetrahedra[static_cast<size_t>(solid_.pieces[static_cast<size_t>(piece)].slot)];
  }

  const BccLattice& lattice_;
  const TetrahedronSubdivision& cut_;
  SolidPieces solid_;
  DisjointSets classes_;
  std::vector<int> host_;
  std::vector<std::vector<int>> adjacent_;  ///< pieces that share three nodes
  std::vector<std::vector<int>> absorbed_;  ///< original pieces that a kept piece stands for, besides itself
  std::vector<int> kept_;
  int merged_slivers_ = 0;
};

}  // namespace palpate
