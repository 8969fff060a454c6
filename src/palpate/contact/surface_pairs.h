#pragma once

#include <array>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "palpate/contact/collision_surface.h"
#include "palpate/contact/feature_pair.h"
#include "palpate/contact/pair_exclusion.h"
#include "palpate/contact/pair_front.h"
#include "palpate/contact/self_exclusion.h"

namespace palpate {

struct PairSearch;

/// Finds pairs of features of triangle surfaces that hit each other in a step or are near each other at its start or
/// end: two trees of boxes are descended together, triangles of clusters that meet are tested by their boxes and
/// normals, features of triangles that meet by their distance and by continuous detection. Keeps its workspace:
/// allocates nothing once it has seen the like. Parts of a search run as parallelFor() has them run; the pairs are the
/// same.
///
/// Every vertex-face and edge-edge pair that hits, or whose distance at the start or the end is below reach, is either
/// reported or a reported one stands for it:
/// - Vertex against faces: where the nearest point is on an edge or a corner of the face, only the nearest of the faces
///   there counts (of hits: the one hit first; of equals: the lowest). So what is left is where the distance from the
///   vertex to the other surface has a local minimum. Two vertices nearest to each other come once, and a vertex that
///   is nearest to an edge or a vertex only if, the other way round, its own surface is not nearer beside it.
/// - Edge against edge: only where both nearest points are inside the edges and where no face at one of the edges comes
///   nearer; nor for two flat regions that face each other, inside which vertices say the same. Hits at an end of an
///   edge are left to the vertex if that hits too. A hollow edge is only ever hit.
/// Where the motion is fast it is examined in pieces of time, and after the first piece with a hit nothing that only
/// comes later is reported.
class SurfacePairFinder {
 public:
  explicit SurfacePairFinder(const PairSettings& settings = {}) : settings_(settings) {}

  /// Pairs between two surfaces, in an order that depends on the features alone; appends. Both must be refitted.
  /// @param reach  > 0 [m]
  /// @param front     of earlier searches with these surfaces
  /// @param left_out  what is not looked at
  void find(const CollisionSurface& a, const CollisionSurface& b, double reach, std::vector<FeaturePair>& out,
            PairFront* front = nullptr, const PairExclusion* left_out = nullptr);
  /// Pairs within one surface; appends.
  void findSelf(const CollisionSurface& a, const SelfExclusion& exclusion, double reach, std::vector<FeaturePair>& out,
                PairFront* front = nullptr);

  /// Whether the features of a pair are still where two surfaces, or one, are nearest to each other at the start. Their
  /// vertices, and those that share a triangle with them, must be placed.
  /// @param exclusion  of a pair within one surface, else null
  bool isNearest(const CollisionSurface& a, const CollisionSurface& b, const SelfExclusion* exclusion, double reach,
                 const FeaturePair& pair) const;

  void setAsNow(bool on) { settings_.as_now = on; }  ///< see PairSettings
  void setAhead(bool on) { settings_.ahead = on; }   ///< the same
  bool ahead() const { return settings_.ahead; }
  /// Gives up searches once more pairs of clusters meet, those of all of them from now on counted together: where the
  /// motion is so wild that all may meet all. What was found is then not complete.
  void allow(double clusters) {
    allowed_ = clusters;
    tested_ = 0;
    gave_up_ = false;
  }
  /// Pairs of clusters since allow(), those of a few triangles counted as the fraction of one that they cost, and hits
  /// as some more.
  double tested() const { return tested_; }
  bool gaveUp() const { return gave_up_; }  ///< since allow()

 private:
  using NodePair = PairFront::NodePair;
  struct Local {  // triangle of a cluster pair, with its box at hand
    MovingBox box;
    int triangle;
  };
  struct Details {  // of such a triangle, for all the triangles that it meets; made when they are asked for
    bool plane_known, boxes_known;
    Eigen::Vector3f origin, normal;   // of its plane at the start, as long as twice its area
    float length, low, high;          // of the normal; how far the triangle leaves the plane at either end of the piece
    std::array<MovingBox, 3> corner;  // on their way
    std::array<MovingBox, 3> edge;    // from its corner on
  };
  struct Triangles {  // of one cluster
    std::vector<Local> list;
    std::vector<Details> details;
    void forgetDetails() {
      if (details.size() < list.size()) details.resize(list.capacity());
      for (size_t i = 0; i < list.size(); ++i) details[i].plane_known = details[i].boxes_known = false;
    }
    void reserve(size_t room) {
      list.reserve(room);
      details.resize(room);
    }
  };
  struct Meeting {  // leaves that must be opened
    NodePair leaves;
    float clearance;
  };
  struct Workspace {  // of a part of the clusters that meet
    Triangles a, b;
    std::vector<FeaturePair> found;
    double first_hit;
  };

  // surface_pairs.cpp: pieces of time, and the trees
  void search(PairSearch& s);
  void testInPieces(PairSearch& s, int pieces);
  static void dropLater(const PairSearch& s, size_t begin, double pieces);
  size_t continueFrom(PairFront& front, PairSearch& s);
  void finishFront(PairFront& front, size_t earlier);
  void descendFromRoots(PairSearch& s);
  void descend(PairSearch& s, NodePair root);
  bool visit(PairSearch& s, NodePair pair);
  // cluster_pairs.cpp: clusters and triangles
  void testMeetingClusters(PairSearch& s);
  void testSome(PairSearch& s, std::span<Meeting> meeting);
  void makeTriangleBoxes(const PairSearch& s);
  void shareRoom();
  void testClusters(PairSearch& s, NodePair leaves, Workspace& workspace);
  static void makePlane(const PairSearch& s, const CollisionSurface& surface, int triangle, Details& of);
  static void makeBoxes(const CollisionSurface& surface, int triangle, Details& of);
  static float gapAlongNormal(const PairSearch& s, const Details& p, const CollisionSurface& sq, int q);
  static void testTriangles(PairSearch& s, const Local& a, Details& da, const Local& b, Details& db);

  static constexpr int kMostParts = 64;
  bool tooMany();
  PairSettings settings_;
  double allowed_ = std::numeric_limits<double>::infinity(), tested_ = 0;
  double weight_ = 1;  // of a pair of clusters, among tested_
  bool gave_up_ = false;
  std::vector<NodePair> stack_;
  std::vector<std::pair<size_t, NodePair>> opened_;  // of a front, with their places in it
  std::vector<Meeting> meeting_, on_the_way_;
  bool counted_ = true;                                 // all pairs that meet are tested
  std::vector<int> without_boxes_a_, without_boxes_b_;  // clusters whose triangles need boxes
  std::vector<Workspace> workspace_;
};

}  // namespace palpate
