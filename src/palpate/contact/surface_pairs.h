#pragma once

#include <array>
#include <limits>
#include <span>
#include <vector>

#include "palpate/contact/collision_surface.h"
#include "palpate/contact/pair_front.h"
#include "palpate/math/types.h"

namespace palpate {

/// Two features of two surfaces (or of one) that come near each other in a step.
struct FeaturePair {
  enum class Kind { vertex_face, face_vertex, edge_edge };  ///< first, second
  Kind kind = Kind::vertex_face;
  std::array<int, 3> first_vertex{-1, -1, -1};  ///< of the first surface; -1: unused
  std::array<int, 3> second_vertex{-1, -1, -1};
  std::array<double, 3> first_weight{};  ///< barycentric, at reference_time
  std::array<double, 3> second_weight{};
  int first_triangle = -1;  ///< the face, or the owner of the vertex or edge
  int second_triangle = -1;
  int first_feature = -1;  ///< index of the vertex, face or edge
  int second_feature = -1;
  Vec3 normal = Vec3::UnitZ();  ///< unit, from second to first, at reference_time
  double start_distance = 0;    ///< >= 0 [m]
  /// Without a hit the distance at the end; else normal . (first - second) there, of the weighted points [m].
  double end_distance = 0;
  double toi = 1;    ///< of a hit: the distance stays above a fraction of the reach, or of the start's, until then
  bool hit = false;  ///< the path runs through the other feature, or comes down to that fraction
  /// The line from one feature to the other starts into one of the solids (of closed surfaces): they overlap already,
  /// or the pair comes after another hit, or something in front of it is nearer. Not a contact to keep apart along
  /// normal.
  bool behind = false;
  double reference_time = 0;  ///< that of weights and normal: 0, 1, or toi of a hit
  double rest_distance = std::numeric_limits<double>::infinity();  ///< of pairs of one surface, if below reach [m]
};

/// What must not touch within one surface; for this surface only, as its clusters are related beforehand. Features that
/// share a vertex never do; nor do those of excluded groups.
class SelfExclusion {
 public:
  SelfExclusion() = default;
  /// Vertices belong to groups (such as tetrahedra). Two features are excluded where any vertex of one and any vertex
  /// of the other are of the same group or of neighbors.
  /// @param group      of each vertex, >= 0; -1: none
  /// @param offset     neighbors of group g are neighbor[offset[g]] ... neighbor[offset[g + 1]]
  /// @param neighbor   sorted within each group; symmetric
  /// Throws InputError where sizes do not fit or indices are out of range.
  SelfExclusion(const CollisionSurface& surface, std::vector<int> group, std::vector<int> offset,
                std::vector<int> neighbor);

  bool excludesGroups(int g, int h) const;
  /// Shared vertices and groups; -1 in either list is skipped.
  bool excludes(const std::array<int, 3>& first, const std::array<int, 3>& second) const;
  /// Whether two clusters are excluded as wholes: the groups of all their triangles' first vertices exclude each other.
  bool excludesClusters(int a, int b) const { return clusters_.contains(a, b); }
  /// Whether any two features of these clusters may be excluded, or share a vertex.
  bool touchesClusters(int a, int b) const { return clusters_.empty() || touching_clusters_.contains(a, b); }

 private:
  struct Relation {  // of clusters
    std::vector<int> offset, other;
    bool empty() const { return offset.empty(); }
    bool contains(int a, int b) const;
    void endRow() { offset.push_back(static_cast<int>(other.size())); }
  };
  void relateClusters(const CollisionSurface& surface);
  bool excludesAll(std::span<const int> groups, std::span<const int> others) const;

  std::vector<int> group_, offset_, neighbor_;
  Relation clusters_;           // excluded as wholes
  Relation touching_clusters_;  // not free of exclusion
};

struct PairSettings {
  /// A path counts as a hit where it comes below this fraction of the reach, or of the start's distance if that is
  /// less.
  double hit_fraction = 0.1;
  /// Fast motion is taken in at most this many pieces of time.
  int max_pieces = 32;
  int max_iterations = 64;  ///< of continuous detection, a pair
};

/// Finds pairs of features of triangle surfaces that hit each other in a step or are near each other at its start or
/// end. Keeps its workspace: allocates nothing once it has seen the like. Parts of
/// a search run as parallelFor() has them run; the pairs are the same.
///
/// Every vertex-face and edge-edge pair that hits, or whose distance at the start or the end is below reach, is either
/// reported or stands behind a reported one:
/// - Vertex against faces: where the nearest point is on an edge or a corner of the face, only the nearest of the faces
///   there counts (of hits: the one hit first; of equals: the lowest). So what is left is where the distance from the
///   vertex to the other surface has a local minimum. Two vertices nearest to each other come once, and a vertex that
///   is nearest to an edge or a vertex only if, the other way round, its own surface is not nearer beside it.
/// - Edge against edge: only where both nearest points are inside the edges and where no face at one of the edges comes
///   nearer; nor for two flat regions that face each other, inside which vertices say the same. Hits at an end of an
///   edge are left to the vertex if that hits too.
/// Where the motion is fast it is examined in pieces of time, and after the first piece with a hit nothing that only
/// comes later is reported.
class SurfacePairFinder {
 public:
  explicit SurfacePairFinder(const PairSettings& settings = {}) : settings_(settings) {}

  /// Pairs between two surfaces, in an order that depends on the features alone; appends. Both must be refitted.
  /// @param reach  > 0 [m]
  /// @param front  of earlier searches with these surfaces
  void find(const CollisionSurface& a, const CollisionSurface& b, double reach, std::vector<FeaturePair>& out,
            PairFront* front = nullptr);
  /// Pairs within one surface; appends.
  void findSelf(const CollisionSurface& a, const SelfExclusion& exclusion, double reach, std::vector<FeaturePair>& out,
                PairFront* front = nullptr);

 private:
  using NodePair = PairFront::NodePair;
  struct Local {  // triangle of a cluster pair, with its box at hand
    MovingBox box;
    int triangle;
  };
  struct Meeting {  // leaves that must be opened
    NodePair leaves;
    float clearance;
  };
  struct Workspace {  // of a part of the clusters that meet
    std::vector<Local> a, b;
    std::vector<FeaturePair> found;
    double first_hit;
  };
  struct Faces;   // vertex against face
  struct Search;  // what one call knows

  void search(Search& s);
  void continueFrom(PairFront& front, Search& s);
  void descendFromRoots(Search& s);
  void descend(Search& s, NodePair root);
  bool visit(Search& s, NodePair pair);
  void testMeeting(Search& s);
  void testClusters(Search& s, NodePair leaves, Workspace& workspace);
  static float gapAlongNormal(const CollisionSurface& sp, const std::array<int, 3>& p, const CollisionSurface& sq,
                              const std::array<int, 3>& q);
  void testTriangles(Search& s, const Local& a, const Local& b);
  void testVertexFace(Search& s, bool vertex_first, int vertex, int owner, int face);
  void testEdgeEdge(Search& s, int edge_a, int edge_b);

  PairSettings settings_;
  std::vector<NodePair> stack_;
  std::vector<Meeting> meeting_;
  std::vector<int> boxless_a_, boxless_b_;  // clusters whose triangles need boxes
  std::vector<Workspace> workspace_;
};

}  // namespace palpate
