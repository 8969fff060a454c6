#pragma once

#include <set>
#include <unordered_map>
#include <vector>

#include "palpate/mesh/bcc_lattice.h"
#include "palpate/mesh/inside_field.h"
#include "palpate/mesh/tetrahedron_subdivision.h"

namespace palpate {

/// The solid cut by the lattice: for each lattice tetrahedron the separate pieces of solid in it, found by samples, and
/// which pieces of neighboring tetrahedra touch through their common face.
struct SolidPieces {
  struct Piece {
    int slot = 0;                ///< lattice tetrahedron, as index into tetrahedra
    int samples = 0;             ///< small tetrahedra inside
    Vec4 moment = Vec4::Zero();  ///< sum of their centers' barycentric coordinates
  };
  struct Link {
    int piece;
    int other;
    std::array<std::array<int, 2>, 3> corners;  ///< the common face: corner of piece, corner of other
  };

  std::vector<int64_t> tetrahedra;           ///< lattice tetrahedra that hold solid
  std::unordered_map<int64_t, int> slot_of;  ///< inverse of tetrahedra
  std::vector<int> label;                    ///< slot * samples + sample -> piece, -1 outside
  std::vector<Piece> pieces;
  std::vector<Link> links;  ///< each pair once
};

/// Samples that count as solid wherever their centers lie, by tetrahedron: what is thinner than a sample.
using Bridges = std::unordered_map<int64_t, std::set<int>>;

/// @param separate  tell pieces in one tetrahedron apart; otherwise each tetrahedron is one piece
SolidPieces cutSolid(const BccLattice& lattice, const TetrahedronSubdivision& cut, const InsideField& field,
                     bool separate, const Bridges& bridges = {});

}  // namespace palpate
