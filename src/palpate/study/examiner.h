#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "palpate/contact/collision_surface.h"
#include "palpate/contact/overlap.h"
#include "palpate/contact/self_exclusion.h"
#include "palpate/contact/self_intersections.h"
#include "palpate/mesh/embedding_map.h"
#include "palpate/simulation/world.h"

namespace palpate {

/// How many tetrahedra have no positive volume at these node positions (flat) [m].
int invertedTetrahedra(const TetrahedralMesh& mesh, const VecX& positions);

/// What a world looks like after a step.
struct Examination {
  bool finite = true;          ///< all positions and velocities; if not, nothing else was examined
  double depth = 0;            ///< of the deepest surface point of a body in a plane or in another solid [m]
  int wrong_side = 0;          ///< surface vertices deeper than the tolerance
  int self_intersections = 0;  ///< pairs of triangles, of deformable bodies with themselves
  int passed = 0;              ///< those of them that contact has to keep apart: not neighbors in the mesh
  int inverted = 0;            ///< tetrahedra, of deformable bodies
};

/// Examines a world from its surfaces and meshes alone, apart from what its steps found.
class Examiner {
 public:
  /// @param world      as built: triangles that intersect there already are not counted later on
  /// @param inside     depth from which a vertex is on the wrong side [m]
  /// @param crossable  bodies whose surfaces may pass through themselves
  Examiner(const World& world, double inside, const std::vector<int>& crossable = {});

  Examination examine(const World& world);

 private:
  struct Own {  // of a body
    EmbeddingMap embedding;
    bool self = false;
    SelfExclusion neighbors;
    std::vector<std::array<int, 2>> from_start;  // sorted
  };
  void place(const World& world);
  void examinePlanes(const World& world, Examination& out) const;
  void examineOverlaps(const World& world, Examination& out);
  void examineSelf(int body, Examination& out);

  double inside_;
  std::vector<CollisionSurface> surfaces_;  // of the bodies, then of the obstacles
  std::vector<Own> own_;                    // of the bodies
  std::vector<OverlapPoint> points_;
  std::vector<std::array<int, 2>> pairs_;
};

}  // namespace palpate
