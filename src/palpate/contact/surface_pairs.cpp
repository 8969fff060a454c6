#include "palpate/contact/surface_pairs.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "palpate/contact/pair_search.h"

namespace palpate {
namespace {

// A lower bound of the distance of what is in the boxes at the start.
float startDistance(const MovingBox& p, const MovingBox& q) {
  return std::sqrt(p.startGaps(q).max(0.0f).square().sum());
}

// On average.
double trianglesOfCluster(const CollisionSurface& s) {
  return static_cast<double>(s.triangles().size()) / static_cast<double>(s.clusters());
}

// Of pieces of time, in clusters. Tests are of longer ones, as in shorter ones the same clusters meet one time after
// the other; what is reported is as of tests in the shorter ones.
constexpr double kTestedLength = 8, kReportedLength = 2;
constexpr double kTrianglePairs = 50;  // of two clusters that count as one pair

}  // namespace

void SurfacePairFinder::find(const CollisionSurface& a, const CollisionSurface& b, double reach,
                             std::vector<FeaturePair>& out, PairFront* front, const PairExclusion* left_out) {
  if (a.nodes().empty() || b.nodes().empty()) return;
  PairSearch s{a, b, nullptr, settings_, reach, &out};
  s.front = front;
  s.left_out = left_out;
  search(s);
}

void SurfacePairFinder::findSelf(const CollisionSurface& a, const SelfExclusion& exclusion, double reach,
                                 std::vector<FeaturePair>& out, PairFront* front) {
  if (a.nodes().empty()) return;
  PairSearch s{a, a, &exclusion, settings_, reach, &out};
  s.front = front;
  search(s);
}

bool SurfacePairFinder::isNearest(const CollisionSurface& a, const CollisionSurface& b, const SelfExclusion* exclusion,
                                  double reach, const FeaturePair& pair) const {
  const PairSearch s{a, b, exclusion, settings_, reach, nullptr};
  if (pair.kind == FeaturePair::Kind::edge_edge) return isNearestEdgeEdge(s, pair.first_feature, pair.second_feature);
  const bool vertex_first = pair.kind == FeaturePair::Kind::vertex_face;
  return isNearestVertexFace(s, vertex_first, vertex_first ? pair.first_feature : pair.second_feature,
                             vertex_first ? pair.second_feature : pair.first_feature);
}

void SurfacePairFinder::search(PairSearch& s) {
  const double extent = std::max(s.a.bounds().extent, s.b.bounds().extent);
  s.box_reach = static_cast<float>(s.reach * (1 + 1e-6)) + 1e-6f * static_cast<float>(extent);
  const size_t begin = s.out->size();
  s.relative = relativeMotion(s.a.bounds(), s.b.bounds());
  const double size = std::max(1e-9, 0.5 * (s.a.clusterSize() + s.b.clusterSize()));
  const double ratio = s.relative / (size + s.reach);
  s.fast = ratio > 0.5;
  const auto piecesOf = [&](double length) {
    const double most = settings_.max_pieces;
    return std::isfinite(ratio) ? std::clamp(std::ceil(ratio / length), 1.0, most) : 1.0;
  };
  const int pieces = static_cast<int>(piecesOf(kTestedLength));
  weight_ = std::min(1.0, trianglesOfCluster(s.a) * trianglesOfCluster(s.b) / kTrianglePairs);
  meeting_.clear();
  counted_ = pieces == 1;
  size_t earlier = 0;
  if (s.front != nullptr) {
    earlier = continueFrom(*s.front, s);
  } else {
    descendFromRoots(s);
  }
  if (pieces == 1) {
    testMeetingClusters(s);
  } else {
    testInPieces(s, pieces);
  }
  if (s.front != nullptr) finishFront(*s.front, earlier);
  dropLater(s, begin, piecesOf(kReportedLength));
  // each pair of features comes once
  std::sort(s.out->begin() + static_cast<std::ptrdiff_t>(begin), s.out->end(),
            [](const FeaturePair& p, const FeaturePair& q) {
              return std::tuple(p.kind, p.first_feature, p.second_feature) <
                     std::tuple(q.kind, q.first_feature, q.second_feature);
            });
}

// Of what was found since `begin`: after the piece of time with the first hit, what only comes later.
void SurfacePairFinder::dropLater(const PairSearch& s, size_t begin, double pieces) {
  const double until = std::ceil(s.first_hit * pieces) / pieces;
  if (!(until < 1)) return;
  const auto later = [&](const FeaturePair& pair) {
    return !(pair.start_distance < s.reach) && !(pair.hit && pair.toi <= until);
  };
  s.out->erase(std::remove_if(s.out->begin() + static_cast<std::ptrdiff_t>(begin), s.out->end(), later), s.out->end());
}

// The clusters that meet at any time, in one piece of time after the other, up to the first hit.
void SurfacePairFinder::testInPieces(PairSearch& s, int pieces) {
  on_the_way_.swap(meeting_);
  if (s.front != nullptr) {
    for (const Meeting& m : on_the_way_) s.front->addMeeting(m.leaves);
  }
  PairSearch piece = s;
  piece.front = nullptr;
  for (int i = 0; i < pieces && !gave_up_; ++i) {
    piece.from = static_cast<double>(i) / pieces;
    piece.to = static_cast<double>(i + 1) / pieces;
    meeting_.clear();
    for (const Meeting& m : on_the_way_) {
      if (piece.meet(s.a.leafBox(m.leaves.a), s.b.leafBox(m.leaves.b))) meeting_.push_back(m);
    }
    tooMany();
    testMeetingClusters(piece);
    if (piece.first_hit <= piece.to) break;
  }
  s.first_hit = piece.first_hit;
}

// @returns how many of the front's pairs are those of earlier searches; what this one opens is only marked
size_t SurfacePairFinder::continueFrom(PairFront& front, PairSearch& s) {
  opened_.clear();
  if (front.mustRestart(s.reach)) {
    front.forget();
    front.reach_ = s.reach;
    descendFromRoots(s);
    front.beganWith(front.pairs_.size() + meeting_.size() + 1);
    opened_.reserve(front.pairs_.capacity());
    return 0;
  }
  const size_t size = front.pairs_.size();
  for (size_t i = 0; i < size && !gave_up_; ++i) {
    if (front.staysApart(i, s.relative)) continue;
    const NodePair pair = front.pairs_[i];
    const MovingBox &box_a = s.a.nodeBox(pair.a), &box_b = s.b.nodeBox(pair.b);
    if (!s.meet(box_a, box_b)) {
      front.setApart(i, static_cast<double>(startDistance(box_a, box_b) - s.box_reach));
      continue;
    }
    front.pairs_[i].a = -1;
    opened_.push_back({i, pair});
    descend(s, pair);
  }
  return size;
}

// A search that was given up leaves the front as it was: the next one would pay for all of it once more.
void SurfacePairFinder::finishFront(PairFront& front, size_t earlier) {
  if (gave_up_ && earlier == 0) {
    front.forget();
  } else if (gave_up_) {
    front.shorten(earlier);
    for (const auto& [i, pair] : opened_) front.pairs_[i] = pair;
  } else if (!opened_.empty()) {
    front.removeMarked();
  }
}

void SurfacePairFinder::descendFromRoots(PairSearch& s) {
  if (!s.self()) {
    descend(s, {0, 0});
    return;
  }
  const auto& nodes = s.a.nodes();
  for (int i = 0; i < static_cast<int>(nodes.size()); ++i) {
    const int right = nodes[static_cast<size_t>(i)].right;
    descend(s, right >= 0 ? NodePair{i + 1, right} : NodePair{i, i});
  }
}

bool SurfacePairFinder::tooMany() {
  gave_up_ = gave_up_ || tested_ + weight_ * static_cast<double>(meeting_.size()) > allowed_;
  return gave_up_;
}

void SurfacePairFinder::descend(PairSearch& s, NodePair root) {
  stack_.clear();
  stack_.push_back(root);
  while (!stack_.empty() && !gave_up_ && !(counted_ && tooMany())) {
    const NodePair p = stack_.back();
    stack_.pop_back();
    if (!visit(s, p)) continue;
    const auto &na = s.a.nodes()[static_cast<size_t>(p.a)], &nb = s.b.nodes()[static_cast<size_t>(p.b)];
    if (nb.right < 0 || (na.right >= 0 && s.a.nodeBox(p.a).size() >= s.b.nodeBox(p.b).size())) {
      stack_.push_back({p.a + 1, p.b});
      stack_.push_back({na.right, p.b});
    } else {
      stack_.push_back({p.a, p.b + 1});
      stack_.push_back({p.a, nb.right});
    }
  }
}

// Notes clusters that meet, and leaves what need not be opened to the front. Returns whether it must.
bool SurfacePairFinder::visit(PairSearch& s, NodePair p) {
  const auto &na = s.a.nodes()[static_cast<size_t>(p.a)], &nb = s.b.nodes()[static_cast<size_t>(p.b)];
  const bool leaves = na.right < 0 && nb.right < 0;
  if (leaves && s.self() && s.exclusion->excludesClusters(na.cluster, nb.cluster)) return false;
  const MovingBox &box_a = s.a.nodeBox(p.a), &box_b = s.b.nodeBox(p.b);
  if (!s.meet(box_a, box_b)) {
    if (s.front != nullptr) s.front->addApart(p, static_cast<double>(startDistance(box_a, box_b) - s.box_reach));
    return false;
  }
  if (!leaves) return true;
  if (s.a.sparse() || s.b.sparse()) {
    const MovingBox &tight_a = s.a.leafBox(p.a), &tight_b = s.b.leafBox(p.b);
    if (!s.meet(tight_a, tight_b)) {
      if (s.front != nullptr) s.front->addApart(p, static_cast<double>(startDistance(tight_a, tight_b) - s.box_reach));
      return false;
    }
  }
  meeting_.push_back({p, 0});
  return false;
}

}  // namespace palpate
