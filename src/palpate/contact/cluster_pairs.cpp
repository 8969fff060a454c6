// Pairs of clusters that meet: their triangles, and of those the features.
#include <algorithm>
#include <limits>

#include "palpate/common/parallel.h"
#include "palpate/contact/pair_search.h"
#include "palpate/contact/surface_pairs.h"

namespace palpate {
namespace {

constexpr double kHit = 0.5;     // of a pair of clusters: what it costs to find when two features hit each other
constexpr size_t kAtOnce = 256;  // pairs of clusters, before it is asked whether the search has cost too much

}  // namespace

// Tests the clusters that meet, part by part, and leaves them to the front.
void SurfacePairFinder::testMeetingClusters(PairSearch& s) {
  tested_ += weight_ * static_cast<double>(meeting_.size());
  if (gave_up_) {
    meeting_.clear();
    return;
  }
  makeTriangleBoxes(s);
  workspace_.resize(kMostParts);
  for (size_t first = 0; first < meeting_.size() && !gave_up_; first += kAtOnce) {
    testSome(s, std::span(meeting_).subspan(first, std::min(kAtOnce, meeting_.size() - first)));
    gave_up_ = tested_ > allowed_;
  }
  shareRoom();
  if (s.front != nullptr) {
    for (const Meeting& m : meeting_) {
      if (m.clearance > s.box_reach) {
        s.front->addApart(m.leaves, static_cast<double>(m.clearance - s.box_reach));
      } else {
        s.front->addMeeting(m.leaves);
      }
    }
  }
  meeting_.clear();
}

void SurfacePairFinder::testSome(PairSearch& s, std::span<Meeting> meeting) {
  const int count = static_cast<int>(meeting.size()), parts = std::min(count, kMostParts);
  parallelRanges(parts, count, [&](int begin, int end, int part) {
    Workspace& workspace = workspace_[static_cast<size_t>(part)];
    workspace.found.clear();
    PairSearch own = s;
    own.out = &workspace.found;
    for (int i = begin; i < end; ++i) {
      Meeting& m = meeting[static_cast<size_t>(i)];
      testClusters(own, m.leaves, workspace);
      m.clearance = own.clearance;
    }
    workspace.first_hit = own.first_hit;
  });
  for (int part = 0; part < parts; ++part) {
    const Workspace& workspace = workspace_[static_cast<size_t>(part)];
    s.out->insert(s.out->end(), workspace.found.begin(), workspace.found.end());
    for (const FeaturePair& pair : workspace.found) tested_ += pair.hit ? kHit : 0.0;
    s.first_hit = std::min(s.first_hit, workspace.first_hit);
  }
}

// Boxes of the triangles in clusters that meet, each cluster's once, before parts ask for them at the same time.
void SurfacePairFinder::makeTriangleBoxes(const PairSearch& s) {
  constexpr int kBoxParts = 8;
  without_boxes_a_.clear();
  without_boxes_b_.clear();
  for (const Meeting& m : meeting_) {
    const int ca = s.a.nodes()[static_cast<size_t>(m.leaves.a)].cluster;
    const int cb = s.b.nodes()[static_cast<size_t>(m.leaves.b)].cluster;
    if (s.a.claimTriangleBoxes(ca)) without_boxes_a_.push_back(ca);
    if (s.b.claimTriangleBoxes(cb)) without_boxes_b_.push_back(cb);
  }
  const int of_a = static_cast<int>(without_boxes_a_.size()), count = of_a + static_cast<int>(without_boxes_b_.size());
  parallelRanges(std::min(count, kBoxParts), count, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      if (i < of_a) {
        s.a.makeTriangleBoxes(without_boxes_a_[static_cast<size_t>(i)]);
      } else {
        s.b.makeTriangleBoxes(without_boxes_b_[static_cast<size_t>(i - of_a)]);
      }
    }
  });
}

// Which part finds how much changes from search to search: room in one is room in all, and later ones allocate nothing.
void SurfacePairFinder::shareRoom() {
  const auto roomOf = [](const Workspace& w) {
    return std::array<size_t, 3>{w.a.list.capacity(), w.b.list.capacity(), w.found.capacity()};
  };
  std::array<size_t, 3> room{};
  for (const Workspace& w : workspace_) {
    const std::array<size_t, 3> own = roomOf(w);
    for (size_t k = 0; k < 3; ++k) room[k] = std::max(room[k], own[k]);
  }
  for (Workspace& w : workspace_) {
    if (roomOf(w) == room) continue;
    w.a.reserve(room[0]);
    w.b.reserve(room[1]);
    w.found.reserve(room[2]);
  }
}

void SurfacePairFinder::testClusters(PairSearch& s, NodePair leaves, Workspace& workspace) {
  const int ca = s.a.nodes()[static_cast<size_t>(leaves.a)].cluster;
  const int cb = s.b.nodes()[static_cast<size_t>(leaves.b)].cluster;
  const auto gather = [&s](const CollisionSurface& surface, int cluster, const MovingBox& other,
                           std::vector<Local>& local, MovingBox& around) {
    const auto boxes = surface.triangleBoxes(cluster);
    const auto triangles = surface.trianglesOfCluster(cluster);
    local.clear();
    for (size_t i = 0; i < boxes.size(); ++i) {
      if (!s.meetClosely(boxes[i], other)) continue;
      if (local.empty())
        around = boxes[i];
      else
        around.include(boxes[i]);
      local.push_back({boxes[i], triangles[i]});
    }
  };
  const bool same = s.self() && ca == cb;
  s.may_exclude = s.left_out != nullptr || (s.self() && s.exclusion->touchesClusters(ca, cb));
  s.clearance = std::numeric_limits<float>::infinity();
  MovingBox around_a, around_b;
  Triangles &a = workspace.a, &b = workspace.b;
  gather(s.a, ca, s.b.leafBox(leaves.b), a.list, around_a);
  if (a.list.empty()) return;
  gather(s.b, cb, same ? s.b.leafBox(leaves.b) : around_a, b.list, around_b);
  a.forgetDetails();
  b.forgetDetails();
  for (size_t i = 0; i < a.list.size(); ++i)
    for (size_t j = 0; j < b.list.size(); ++j) {
      const Local &p = a.list[i], &q = b.list[j];
      if ((!same || p.triangle < q.triangle) && s.meetClosely(p.box, q.box))
        testTriangles(s, p, a.details[i], q, b.details[j]);
    }
}

void SurfacePairFinder::makePlane(const PairSearch& s, const CollisionSurface& surface, int triangle, Details& of) {
  using Vec3f = Eigen::Vector3f;
  const auto& v = surface.triangles()[static_cast<size_t>(triangle)];
  const auto start = [&](size_t i) -> Vec3f { return surface.roundedStart(v[i]).head<3>(); };
  const auto from = static_cast<float>(s.from), to = static_cast<float>(s.to);
  of.origin = start(0);
  of.normal = (start(1) - of.origin).cross(start(2) - of.origin);
  of.length = of.normal.norm();
  of.low = std::numeric_limits<float>::infinity();
  of.high = -of.low;
  for (const int i : v) {
    const Vec3f end = surface.roundedEnd(i).head<3>();
    const float leaves = of.normal.dot(end - of.origin);  // start: 0
    of.low = std::min(of.low, std::min(from * leaves, to * leaves));
    of.high = std::max(of.high, std::max(from * leaves, to * leaves));
  }
  of.plane_known = true;
}

void SurfacePairFinder::makeBoxes(const CollisionSurface& surface, int triangle, Details& of) {
  const auto& v = surface.triangles()[static_cast<size_t>(triangle)];
  for (size_t k = 0; k < 3; ++k) of.corner[k] = of.edge[k] = surface.vertexBox(v[k]);
  for (size_t k = 0; k < 3; ++k) of.edge[k].include(of.corner[(k + 1) % 3]);
  of.boxes_known = true;
}

// By how much planes square to the triangle p at its start keep the two apart at both ends of the present piece of
// time, hence throughout; below zero if they do not.
float SurfacePairFinder::gapAlongNormal(const PairSearch& s, const Details& p, const CollisionSurface& sq, int q) {
  using Vec3f = Eigen::Vector3f;
  const auto from = static_cast<float>(s.from), to = static_cast<float>(s.to);
  constexpr float kFar = std::numeric_limits<float>::infinity();
  float low = kFar, high = -kFar;
  for (const int v : sq.triangles()[static_cast<size_t>(q)]) {
    const Vec3f start = sq.roundedStart(v).head<3>(), end = sq.roundedEnd(v).head<3>();
    const float qs = p.normal.dot(start - p.origin), way = p.normal.dot(end - p.origin) - qs;
    low = std::min(low, std::min(qs + from * way, qs + to * way));
    high = std::max(high, std::max(qs + from * way, qs + to * way));
  }
  constexpr float kShortest = 1e-15f;  // square meters; squares of shorter ones run out of single precision's exponents
  return p.length > kShortest ? std::max(low - p.high, p.low - high) / p.length : 0.0f;
}

void SurfacePairFinder::testTriangles(PairSearch& s, const Local& a, Details& da, const Local& b, Details& db) {
  const int ta = a.triangle, tb = b.triangle;
  const auto &va = s.a.triangles()[static_cast<size_t>(ta)], &vb = s.b.triangles()[static_cast<size_t>(tb)];
  const auto &ea = s.a.triangleEdges()[static_cast<size_t>(ta)], &eb = s.b.triangleEdges()[static_cast<size_t>(tb)];
  if (!da.plane_known) makePlane(s, s.a, ta, da);
  float apart = gapAlongNormal(s, da, s.b, tb);
  if (!(apart > s.box_reach)) {
    if (!db.plane_known) makePlane(s, s.b, tb, db);
    apart = std::max(apart, gapAlongNormal(s, db, s.a, ta));
  }
  if (apart > s.box_reach) {
    s.noteDistance(apart);
    return;
  }
  // most features of triangles that meet are apart by their own boxes
  if (!da.boxes_known) makeBoxes(s.a, ta, da);
  if (!db.boxes_known) makeBoxes(s.b, tb, db);
  for (int i = 0; i < 3; ++i) {
    const auto k = static_cast<size_t>(i);
    if (s.a.ownsCorner(ta, i) && s.meetClosely(da.corner[k], b.box)) testVertexFace(s, true, va[k], ta, tb);
    if (s.b.ownsCorner(tb, i) && s.meetClosely(db.corner[k], a.box)) testVertexFace(s, false, vb[k], tb, ta);
  }
  const bool no_hits = s.settings.ahead || !s.hitsWithin(apart);  // of hollow edges
  for (int i = 0; i < 3; ++i) {
    const auto k = static_cast<size_t>(i);
    if (!s.a.ownsEdge(ta, i) || !s.meetClosely(da.edge[k], b.box)) continue;
    for (int j = 0; j < 3; ++j) {
      const auto l = static_cast<size_t>(j);
      if (!s.b.ownsEdge(tb, j) || !s.meetClosely(da.edge[k], db.edge[l])) continue;
      if (no_hits && (s.a.hollow(ea[k]) || s.b.hollow(eb[l]))) {
        s.noteDistance(apart);
      } else {
        testEdgeEdge(s, ea[k], eb[l]);
      }
    }
  }
}

}  // namespace palpate
