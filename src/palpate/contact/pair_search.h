#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "palpate/contact/collision_surface.h"
#include "palpate/contact/feature_pair.h"
#include "palpate/contact/pair_exclusion.h"
#include "palpate/contact/pair_front.h"
#include "palpate/contact/self_exclusion.h"

namespace palpate {

/// What one search of SurfacePairFinder knows, and where it leaves its pairs. For the parts of the finder only.
struct PairSearch {
  const CollisionSurface& a;
  const CollisionSurface& b;
  const SelfExclusion* exclusion;  ///< of a search within one surface
  const PairSettings& settings;
  double reach;
  std::vector<FeaturePair>* out;

  PairFront* front = nullptr;
  const PairExclusion* left_out = nullptr;  ///< of a search between two surfaces, null: nothing
  double relative = 0;                      ///< bound of how far vertices move relative to each other [m]
  bool may_exclude = false;                 ///< among the features of the present clusters
  float clearance = 0;                      ///< no two features of the present clusters start nearer to each other [m]
  float box_reach = 0;                      ///< reach, and what single precision loses
  bool fast = false;                        ///< boxes move by more than their size: worth asking when they meet
  double from = 0, to = 1;                  ///< the present piece of time
  double first_hit = std::numeric_limits<double>::infinity();

  bool self() const { return exclusion != nullptr; }
  /// @param p, q  vertices of features of a and of b
  bool excluded(const std::array<int, 3>& p, const std::array<int, 3>& q) const {
    return (exclusion != nullptr && exclusion->excludes(p, q)) || (left_out != nullptr && left_out->excludes(p, q));
  }
  /// What some axis keeps the boxes apart by at the start and at the end, hence throughout.
  static float gap(const MovingBox& p, const MovingBox& q) {
    const MovingBox::Corner low = (p.start_low + q.start_negative_high).min(p.end_low + q.end_negative_high);
    const MovingBox::Corner high = (p.start_negative_high + q.start_low).min(p.end_negative_high + q.end_low);
    return low.max(high).maxCoeff();
  }
  bool meet(const MovingBox& p, const MovingBox& q) const {
    return gap(p, q) <= box_reach && (!fast || meetInTime(p, q));
  }
  /// Two triangles or features, not excluded, start at least so far apart.
  void noteDistance(double distance) { clearance = std::min(clearance, static_cast<float>(distance)); }
  /// For triangles and features: keeps what is left of the clearance.
  bool meetClosely(const MovingBox& p, const MovingBox& q) {
    if (meet(p, q)) return true;
    noteDistance(p.startGaps(q).maxCoeff());
    return false;
  }
  /// Whether the boxes meet at any one time of the present piece.
  bool meetInTime(const MovingBox& p, const MovingBox& q) const;
  /// Distance at which a path counts as a hit [m].
  double hitDistance(double start_distance) const { return settings.hit_fraction * std::min(start_distance, reach); }
  /// Whether what a plane keeps so far apart throughout the present piece of time can count as a hit that it has to
  /// report: not if that is more than hitDistance() of any start, unless hits of the whole way are asked for now.
  bool hitsWithin(float apart) const {
    const auto least = static_cast<float>(settings.hit_fraction * reach);
    return apart <= least + (box_reach - static_cast<float>(reach)) || (from <= 0 && to < 1);
  }
  /// Of what starts so far apart only a hit in the present piece of time is to be reported now.
  bool onlyHits(double start_distance) const { return to < 1 && !(start_distance < reach); }
  /// Until when a hit matters.
  double horizon(double start_distance) const { return onlyHits(start_distance) ? to : 1; }
  /// Whether a pair is to be reported now: near the start in the first piece, near the end in the last, hits in theirs.
  bool wanted(const FeaturePair& pair) const {
    if (pair.start_distance < reach) return from <= 0;
    if (pair.hit) return pair.toi <= to;
    return to >= 1 && pair.end_distance < reach;
  }
  void report(const FeaturePair& pair) {
    if (pair.hit) first_hit = std::min(first_hit, pair.toi);
    out->push_back(pair);
  }
};

/// Tests of two features whose boxes meet; a pair that is worth it is reported (see SurfacePairFinder).
/// @param vertex_first  the vertex is of s.a and the face of s.b; else the other way round
/// @param owner         triangle that owns the vertex
void testVertexFace(PairSearch& s, bool vertex_first, int vertex, int owner, int face);
void testEdgeEdge(PairSearch& s, int edge_a, int edge_b);
/// Whether two features are where the surfaces are nearest to each other at the start, as those of a reported pair.
bool isNearestVertexFace(const PairSearch& s, bool vertex_first, int vertex, int face);
bool isNearestEdgeEdge(const PairSearch& s, int edge_a, int edge_b);

}  // namespace palpate
