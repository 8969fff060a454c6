#include "palpate/contact/surface_pairs.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <tuple>

#include "palpate/common/error.h"
#include "palpate/common/parallel.h"
#include "palpate/contact/feature_distance.h"

namespace palpate {
namespace {

constexpr double kOutline = CollisionSurface::kOutline;
constexpr double kBehind =
    0.2;                        // sine by which a line must enter a solid at a vertex or edge that is not nearest to it
constexpr double kFlat = 1e-6;  // sine of the angle below which a face is square to the shortest line

const Vec3& at(const std::vector<Vec3>& points, int i) { return points[static_cast<size_t>(i)]; }

Vec3 displacement(const CollisionSurface& s, int v) { return at(s.end, v) - at(s.start, v); }

// Distance so small that the line between the points has no meaning.
bool touching(double distance, const Vec3& p) { return distance <= 1e-13 + 1e-12 * p.cwiseAbs().maxCoeff(); }

TrianglePoint vertexFaceAt(const CollisionSurface& sv, int v, const CollisionSurface& sf, int face, double t) {
  const auto& f = sf.triangles()[static_cast<size_t>(face)];
  return closestOnTriangle(sv.position(v, t), sf.position(f[0], t), sf.position(f[1], t), sf.position(f[2], t));
}

SegmentPair edgesAt(const CollisionSurface& sa, const std::array<int, 2>& a, const CollisionSurface& sb,
                    const std::array<int, 2>& b, double t) {
  return closestOnSegments(sa.position(a[0], t), sa.position(a[1], t), sb.position(b[0], t), sb.position(b[1], t));
}

Vec3 unitOr(const Vec3& v, const Vec3& other) {
  const double n = v.stableNorm();
  if (n > 0) return v / n;
  const double m = other.stableNorm();
  return m > 0 ? Vec3(other / m) : Vec3(Vec3::UnitZ());
}

// How an edge's faces lie to the shortest line that leaves it along `outward` (unit).
struct EdgeFaces {
  bool nearer = false;  // a face at the edge comes nearer than the edge
  bool flat = false;    // two faces, both square to the line
};
EdgeFaces edgeFaces(const CollisionSurface& s, int edge, double t, const Vec3& outward) {
  const auto& e = s.edges()[static_cast<size_t>(edge)];
  const Vec3 a = s.position(e[0], t), along = s.position(e[1], t) - a;
  const double length2 = along.squaredNorm();
  EdgeFaces result;
  int faces = 0, square = 0;
  for (const int f : s.edgeTriangles()[static_cast<size_t>(edge)]) {
    if (f < 0) continue;
    ++faces;
    int opposite = -1;
    for (const int v : s.triangles()[static_cast<size_t>(f)])
      if (v != e[0] && v != e[1]) opposite = v;
    Vec3 inward = s.position(opposite, t) - a;
    if (length2 > 0) inward -= (inward.dot(along) / length2) * along;
    const double rise = inward.dot(outward), limit = kFlat * inward.norm();
    if (rise > limit) result.nearer = true;
    if (std::abs(rise) <= limit) ++square;
  }
  result.flat = faces == 2 && square == 2;
  return result;
}

}  // namespace

SelfExclusion::SelfExclusion(const CollisionSurface& surface, std::vector<int> group, std::vector<int> offset,
                             std::vector<int> neighbor)
    : group_(std::move(group)), offset_(std::move(offset)), neighbor_(std::move(neighbor)) {
  const auto check = [](bool good, const char* what) {
    if (!good) throw InputError("self exclusion", "", what);
  };
  check(group_.size() == surface.rest().size(), "needs a group for each vertex");
  check(!offset_.empty() && offset_.front() == 0 && std::is_sorted(offset_.begin(), offset_.end()) &&
            static_cast<size_t>(offset_.back()) == neighbor_.size(),
        "offsets do not fit the neighbors");
  const int groups = static_cast<int>(offset_.size()) - 1;
  for (const int g : group_) check(g >= -1 && g < groups, "a vertex is in a group that does not exist");
  for (int g = 0; g < groups; ++g)
    check(std::is_sorted(neighbor_.begin() + offset_[static_cast<size_t>(g)],
                         neighbor_.begin() + offset_[static_cast<size_t>(g) + 1]),
          "neighbors are not sorted");
  relateClusters(surface);
}

bool SelfExclusion::excludesGroups(int g, int h) const {
  if (g < 0 || h < 0) return false;
  if (g == h) return true;
  const auto first = neighbor_.begin() + offset_[static_cast<size_t>(g)];
  return std::binary_search(first, neighbor_.begin() + offset_[static_cast<size_t>(g) + 1], h);
}

bool SelfExclusion::excludes(const std::array<int, 3>& first, const std::array<int, 3>& second) const {
  for (const int v : first)
    for (const int w : second)
      if (v >= 0 && v == w) return true;
  if (group_.empty()) return false;
  for (const int v : first)
    for (const int w : second)
      if (v >= 0 && w >= 0 && excludesGroups(group_[static_cast<size_t>(v)], group_[static_cast<size_t>(w)]))
        return true;
  return false;
}

bool SelfExclusion::excludesAll(std::span<const int> groups, std::span<const int> others) const {
  for (const int g : groups)
    for (const int h : others)
      if (!excludesGroups(g, h)) return false;
  return true;
}

bool SelfExclusion::Relation::contains(int a, int b) const {
  if (offset.empty()) return false;
  const auto first = other.begin() + offset[static_cast<size_t>(a)];
  return std::binary_search(first, other.begin() + offset[static_cast<size_t>(a) + 1], b);
}

void SelfExclusion::relateClusters(const CollisionSurface& surface) {
  const auto clusters = static_cast<size_t>(surface.clusters());
  const auto sortUnique = [](std::vector<int>& v) {
    std::sort(v.begin(), v.end());
    v.erase(std::unique(v.begin(), v.end()), v.end());
  };
  // groups of the clusters' triangles (by their first vertices), and of all of their vertices
  std::vector<std::vector<int>> owned(clusters), all(clusters);
  std::vector<std::vector<int>> owners(offset_.size()), users(offset_.size()), at_vertex(group_.size());
  for (size_t c = 0; c < clusters; ++c) {
    const int cluster = static_cast<int>(c);
    for (const int t : surface.trianglesOfCluster(cluster)) {
      owned[c].push_back(group_[static_cast<size_t>(surface.triangles()[static_cast<size_t>(t)][0])]);
    }
    for (const int v : surface.verticesOfCluster(cluster)) {
      all[c].push_back(group_[static_cast<size_t>(v)]);
      at_vertex[static_cast<size_t>(v)].push_back(cluster);
    }
    sortUnique(owned[c]);
    sortUnique(all[c]);
    for (const int g : owned[c])
      if (g >= 0) owners[static_cast<size_t>(g)].push_back(cluster);
    for (const int g : all[c])
      if (g >= 0) users[static_cast<size_t>(g)].push_back(cluster);
  }
  // clusters with a vertex in group g or in a neighbor of it
  const auto addAround = [&](int g, const std::vector<std::vector<int>>& of, std::vector<int>& out) {
    const auto i = static_cast<size_t>(g);
    out.insert(out.end(), of[i].begin(), of[i].end());
    for (int k = offset_[i]; k < offset_[i + 1]; ++k) {
      const int h = neighbor_[static_cast<size_t>(k)];
      if (h < 0 || static_cast<size_t>(h) + 1 >= offset_.size()) continue;
      const auto& more = of[static_cast<size_t>(h)];
      out.insert(out.end(), more.begin(), more.end());
    }
  };
  clusters_.endRow();
  touching_clusters_.endRow();
  std::vector<int> near;
  for (size_t c = 0; c < clusters; ++c) {
    near.clear();
    if (!owned[c].empty() && owned[c].front() >= 0)  // only clusters near any one group can be near all
      addAround(owned[c].front(), owners, near);
    sortUnique(near);
    for (const int d : near)
      if (excludesAll(owned[c], owned[static_cast<size_t>(d)])) clusters_.other.push_back(d);
    clusters_.endRow();

    near.clear();
    for (const int g : all[c])
      if (g >= 0) addAround(g, users, near);
    for (const int v : surface.verticesOfCluster(static_cast<int>(c))) {
      const auto& more = at_vertex[static_cast<size_t>(v)];
      near.insert(near.end(), more.begin(), more.end());
    }
    sortUnique(near);
    touching_clusters_.other.insert(touching_clusters_.other.end(), near.begin(), near.end());
    touching_clusters_.endRow();
  }
}

struct SurfacePairFinder::Search {
  const CollisionSurface& a;
  const CollisionSurface& b;
  const SelfExclusion* exclusion;  // of a search within one surface
  double reach;
  std::vector<FeaturePair>* out;

  PairFront* front = nullptr;
  double relative = 0;       // bound of how far vertices move relative to each other [m]
  bool may_exclude = false;  // among the features of the present clusters
  float clearance = 0;       // no two triangles of the present clusters start nearer to each other [m]
  float box_reach = 0;       // reach, and what single precision loses
  bool fast = false;         // boxes move by more than their size: worth asking when they meet
  double from = 0, to = 1;
  double first_hit = std::numeric_limits<double>::infinity();

  bool self() const { return exclusion != nullptr; }
  bool excluded(const std::array<int, 3>& p, const std::array<int, 3>& q) const {
    return exclusion != nullptr && exclusion->excludes(p, q);
  }
  // What some axis keeps the boxes apart by at the start and at the end, hence throughout.
  static float gap(const MovingBox& p, const MovingBox& q) {
    const MovingBox::Corner low = (p.start_low + q.start_negative_high).min(p.end_low + q.end_negative_high);
    const MovingBox::Corner high = (p.start_negative_high + q.start_low).min(p.end_negative_high + q.end_low);
    return low.max(high).maxCoeff();
  }
  bool meet(const MovingBox& p, const MovingBox& q) const {
    return gap(p, q) <= box_reach && (!fast || meetInTime(p, q));
  }
  // For triangles: keeps what is left of the clearance.
  bool meetClosely(const MovingBox& p, const MovingBox& q) {
    const float apart = gap(p, q);
    if (apart > box_reach) {
      clearance = std::min(clearance, apart);
      return false;
    }
    if (!fast || meetInTime(p, q)) return true;
    clearance = 0;
    return false;
  }
  bool meetInTime(const MovingBox& p, const MovingBox& q) const;
  double threshold(double start_distance, double fraction) const { return fraction * std::min(start_distance, reach); }
  /// Whether a pair is to be reported now: near the start in the first piece, near the end in the last, hits in theirs.
  bool wanted(const FeaturePair& pair) const {
    if (pair.start_distance < reach) return from <= 0;
    if (pair.hit) return pair.toi <= to;
    return to >= 1 && pair.end_distance < reach;
  }
  void report(FeaturePair& pair) {
    if (pair.hit) first_hit = std::min(first_hit, pair.toi);
    out->push_back(pair);
  }
};

float startDistance(const MovingBox& p, const MovingBox& q) {
  const MovingBox::Corner gap = (p.start_low + q.start_negative_high).max(p.start_negative_high + q.start_low);
  return std::sqrt(gap.max(0.0f).square().sum());
}

// Each axis gives two conditions, linear in time; boxes are apart where one fails throughout, or where they do not hold
// at any one time together.
bool SurfacePairFinder::Search::meetInTime(const MovingBox& p, const MovingBox& q) const {
  using Corner = MovingBox::Corner;
  Corner low0 = p.start_low + q.start_negative_high, high0 = p.start_negative_high + q.start_low;
  Corner low1 = p.end_low + q.end_negative_high, high1 = p.end_negative_high + q.end_low;
  if (from > 0 || to < 1) {
    const float f = static_cast<float>(from), t = static_cast<float>(to);
    const Corner low = low1 - low0, high = high1 - high0;
    low1 = low0 + t * low;
    high1 = high0 + t * high;
    low0 += f * low;
    high0 += f * high;
    if (low0.min(low1).max(high0.min(high1)).maxCoeff() > box_reach) return false;
  }
  float enter = 0, leave = 1;
  const auto restrict = [&](const Corner& begin, const Corner& finish) {
    for (int i = 0; i < 3; ++i) {
      const float f0 = begin[i] - box_reach, f1 = finish[i] - box_reach;
      if (f0 > 0)
        enter = std::max(enter, f0 / (f0 - f1));
      else if (f1 > 0)
        leave = std::min(leave, f0 / (f0 - f1));
    }
  };
  restrict(low0, low1);
  restrict(high0, high1);
  return enter <= leave + 1e-4f;
}

void SurfacePairFinder::find(const CollisionSurface& a, const CollisionSurface& b, double reach,
                             std::vector<FeaturePair>& out, PairFront* front) {
  if (a.nodes().empty() || b.nodes().empty()) return;
  Search s{a, b, nullptr, reach, &out};
  s.front = front;
  search(s);
}

void SurfacePairFinder::findSelf(const CollisionSurface& a, const SelfExclusion& exclusion, double reach,
                                 std::vector<FeaturePair>& out, PairFront* front) {
  if (a.nodes().empty()) return;
  Search s{a, a, &exclusion, reach, &out};
  s.front = front;
  search(s);
}

void SurfacePairFinder::search(Search& s) {
  const double extent = std::max(s.a.bounds().extent, s.b.bounds().extent);
  s.box_reach = static_cast<float>(s.reach * (1 + 1e-6)) + 1e-6f * static_cast<float>(extent);
  const size_t begin = s.out->size();
  s.relative = relativeMotion(s.a.bounds(), s.b.bounds());
  const double size = std::max(1e-9, 0.5 * (s.a.clusterSize() + s.b.clusterSize()));
  const double ratio = s.relative / (size + s.reach);
  s.fast = ratio > 0.5;
  const int pieces =
      std::isfinite(ratio)
          ? static_cast<int>(std::clamp(std::ceil(0.5 * ratio), 1.0, static_cast<double>(settings_.max_pieces)))
          : 1;
  meeting_.clear();
  if (s.front != nullptr && pieces == 1) {
    continueFrom(*s.front, s);
    testMeeting(s);
  } else {
    s.front = nullptr;
    for (int i = 0; i < pieces; ++i) {
      s.from = static_cast<double>(i) / pieces;
      s.to = static_cast<double>(i + 1) / pieces;
      descendFromRoots(s);
      testMeeting(s);
      if (s.first_hit <= s.to) break;
    }
  }
  // each pair of features comes once
  std::sort(s.out->begin() + static_cast<std::ptrdiff_t>(begin), s.out->end(),
            [](const FeaturePair& p, const FeaturePair& q) {
              return std::tuple(p.kind, p.first_feature, p.second_feature) <
                     std::tuple(q.kind, q.first_feature, q.second_feature);
            });
}

void SurfacePairFinder::continueFrom(PairFront& front, Search& s) {
  if (front.worn(s.reach)) {
    front.forget();
    front.reach_ = s.reach;
    descendFromRoots(s);
    front.roots_size_ = front.pairs_.size() + meeting_.size() + 1;
    return;
  }
  const double now = front.odometer_ + s.relative;
  const size_t size = front.pairs_.size();
  bool opened = false;
  for (size_t i = 0; i < size; ++i) {
    if (now < front.until_[i]) continue;
    const NodePair pair = front.pairs_[i];
    front.pairs_[i].a = -1;
    opened = true;
    descend(s, pair);
  }
  if (opened) front.removeMarked();
}

void SurfacePairFinder::descendFromRoots(Search& s) {
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

void SurfacePairFinder::descend(Search& s, NodePair root) {
  stack_.clear();
  stack_.push_back(root);
  while (!stack_.empty()) {
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
bool SurfacePairFinder::visit(Search& s, NodePair p) {
  const auto &na = s.a.nodes()[static_cast<size_t>(p.a)], &nb = s.b.nodes()[static_cast<size_t>(p.b)];
  const bool leaves = na.right < 0 && nb.right < 0;
  if (leaves && s.self() && s.exclusion->excludesClusters(na.cluster, nb.cluster)) return false;
  const MovingBox &box_a = s.a.nodeBox(p.a), &box_b = s.b.nodeBox(p.b);
  if (!s.meet(box_a, box_b)) {
    if (s.front != nullptr) {
      s.front->add(p, s.front->odometer_ + static_cast<double>(startDistance(box_a, box_b) - s.box_reach));
    }
    return false;
  }
  if (!leaves) return true;
  meeting_.push_back({p, 0});
  return false;
}

// Tests the clusters that meet, and leaves them to the front.
void SurfacePairFinder::testMeeting(Search& s) {
  constexpr int kMostParts = 64, kBoxParts = 8;
  const int count = static_cast<int>(meeting_.size());
  const auto cluster = [](const CollisionSurface& surface, int node) {
    return surface.nodes()[static_cast<size_t>(node)].cluster;
  };
  boxless_a_.clear();
  boxless_b_.clear();
  for (const Meeting& m : meeting_) {
    const int ca = cluster(s.a, m.leaves.a), cb = cluster(s.b, m.leaves.b);
    if (s.a.claimTriangleBoxes(ca)) boxless_a_.push_back(ca);
    if (s.b.claimTriangleBoxes(cb)) boxless_b_.push_back(cb);
  }
  const int size_a = static_cast<int>(boxless_a_.size()), boxless = size_a + static_cast<int>(boxless_b_.size());
  const int box_parts = std::min(boxless, kBoxParts);
  parallelFor(box_parts, [&](int part) {
    for (int i = partBegin(part, box_parts, boxless); i < partBegin(part + 1, box_parts, boxless); ++i) {
      if (i < size_a) {
        s.a.makeTriangleBoxes(boxless_a_[static_cast<size_t>(i)]);
      } else {
        s.b.makeTriangleBoxes(boxless_b_[static_cast<size_t>(i - size_a)]);
      }
    }
  });
  const int parts = std::min(count, kMostParts);
  workspace_.resize(kMostParts);
  parallelFor(parts, [&](int part) {
    Workspace& workspace = workspace_[static_cast<size_t>(part)];
    workspace.found.clear();
    Search own = s;
    own.out = &workspace.found;
    for (int i = partBegin(part, parts, count); i < partBegin(part + 1, parts, count); ++i) {
      Meeting& m = meeting_[static_cast<size_t>(i)];
      testClusters(own, m.leaves, workspace);
      m.clearance = own.clearance;
    }
    workspace.first_hit = own.first_hit;
  });
  // which part finds how much changes from search to search: room in one is room in all
  std::array<size_t, 3> room{};
  const auto roomOf = [](const Workspace& w) {
    return std::array<size_t, 3>{w.a.capacity(), w.b.capacity(), w.found.capacity()};
  };
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
  for (int part = 0; part < parts; ++part) {
    const Workspace& workspace = workspace_[static_cast<size_t>(part)];
    s.out->insert(s.out->end(), workspace.found.begin(), workspace.found.end());
    s.first_hit = std::min(s.first_hit, workspace.first_hit);
  }
  if (s.front != nullptr) {
    for (const Meeting& m : meeting_) {
      const double until = s.front->odometer_ + static_cast<double>(m.clearance - s.box_reach);
      s.front->add(m.leaves, m.clearance > s.box_reach ? until : PairFront::kAlways);
    }
  }
  meeting_.clear();
}

void SurfacePairFinder::testClusters(Search& s, NodePair leaves, Workspace& workspace) {
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
  s.may_exclude = s.self() && s.exclusion->touchesClusters(ca, cb);
  s.clearance = std::numeric_limits<float>::infinity();
  MovingBox around_a, around_b;
  gather(s.a, ca, s.b.nodeBox(leaves.b), workspace.a, around_a);
  if (workspace.a.empty()) return;
  gather(s.b, cb, same ? s.b.nodeBox(leaves.b) : around_a, workspace.b, around_b);
  for (const Local& p : workspace.a)
    for (const Local& q : workspace.b)
      if ((!same || p.triangle < q.triangle) && s.meetClosely(p.box, q.box)) testTriangles(s, p, q);
}

// By how much planes square to the first triangle at its start keep the two apart at the start and at the end, hence
// throughout; below zero if they do not.
float SurfacePairFinder::gapAlongNormal(const CollisionSurface& sp, const std::array<int, 3>& p,
                                        const CollisionSurface& sq, const std::array<int, 3>& q) {
  using Vec3f = Eigen::Vector3f;
  const auto start = [](const CollisionSurface& s, int v) -> Vec3f { return s.roundedStart(v).head<3>(); };
  const auto end = [](const CollisionSurface& s, int v) -> Vec3f { return s.roundedEnd(v).head<3>(); };
  const Vec3f origin = start(sp, p[0]);
  const Vec3f normal = (start(sp, p[1]) - origin).cross(start(sp, p[2]) - origin);
  float p_low = 0, p_high = 0, q_low = std::numeric_limits<float>::infinity(), q_high = -q_low;  // start of p: all 0
  for (size_t i = 0; i < 3; ++i) {
    const float pe = normal.dot(end(sp, p[i]) - origin);
    p_low = std::min(p_low, pe);
    p_high = std::max(p_high, pe);
    const float qs = normal.dot(start(sq, q[i]) - origin), qe = normal.dot(end(sq, q[i]) - origin);
    q_low = std::min(q_low, std::min(qs, qe));
    q_high = std::max(q_high, std::max(qs, qe));
  }
  constexpr float kShortest = 1e-15f;  // square meters; squares of shorter ones run out of single precision's exponents
  const float length = normal.norm();
  return length > kShortest ? std::max(q_low - p_high, p_low - q_high) / length : 0.0f;
}

void SurfacePairFinder::testTriangles(Search& s, const Local& a, const Local& b) {
  const int ta = a.triangle, tb = b.triangle;
  const auto &va = s.a.triangles()[static_cast<size_t>(ta)], &vb = s.b.triangles()[static_cast<size_t>(tb)];
  const auto &ea = s.a.triangleEdges()[static_cast<size_t>(ta)], &eb = s.b.triangleEdges()[static_cast<size_t>(tb)];
  float apart = gapAlongNormal(s.a, va, s.b, vb);
  if (!(apart > s.box_reach)) apart = gapAlongNormal(s.b, vb, s.a, va);
  if (apart > s.box_reach) {
    s.clearance = std::min(s.clearance, apart);
    return;
  }
  s.clearance = 0;
  // most features of triangles that meet are apart by their own boxes
  std::array<MovingBox, 3> box_a, box_b;
  for (size_t k = 0; k < 3; ++k) {
    box_a[k] = s.a.vertexBox(va[k]);
    box_b[k] = s.b.vertexBox(vb[k]);
  }
  for (int i = 0; i < 3; ++i) {
    const auto k = static_cast<size_t>(i);
    if (s.a.ownsCorner(ta, i) && s.meet(box_a[k], b.box)) testVertexFace(s, true, va[k], ta, tb);
    if (s.b.ownsCorner(tb, i) && s.meet(box_b[k], a.box)) testVertexFace(s, false, vb[k], tb, ta);
  }
  for (size_t k = 0; k < 3; ++k) box_b[k].include(s.b.vertexBox(vb[(k + 1) % 3]));
  for (int i = 0; i < 3; ++i) {
    if (!s.a.ownsEdge(ta, i)) continue;
    const auto k = static_cast<size_t>(i);
    MovingBox edge = box_a[k];
    edge.include(box_a[(k + 1) % 3]);
    if (!s.meet(edge, b.box)) continue;
    for (int j = 0; j < 3; ++j) {
      const auto l = static_cast<size_t>(j);
      if (s.b.ownsEdge(tb, j) && s.meet(edge, box_b[l])) testEdgeEdge(s, ea[k], eb[l]);
    }
  }
}

// A vertex against faces of another surface (or of its own), within one search.
struct SurfacePairFinder::Faces {
  const Search& s;
  const PairSettings& settings;
  const CollisionSurface& sv;
  const CollisionSurface& sf;

  bool excluded(int v, int face) const { return s.excluded({v, -1, -1}, sf.triangles()[static_cast<size_t>(face)]); }
  Approach approach(int v, int face, double min_distance) const {
    const auto& f = sf.triangles()[static_cast<size_t>(face)];
    return timeOfApproach(
        FeatureKind::vertex_face, {at(sv.start, v), at(sf.start, f[0]), at(sf.start, f[1]), at(sf.start, f[2])},
        {at(sv.end, v), at(sf.end, f[0]), at(sf.end, f[1]), at(sf.end, f[2])}, min_distance, settings.max_iterations);
  }
  /// Bound of how far the vertex moves relative to any point of the face.
  double travel(int v, int face) const {
    const Vec3 dv = displacement(sv, v);
    double l2 = 0;
    for (const int w : sf.triangles()[static_cast<size_t>(face)])
      l2 = std::max(l2, (dv - displacement(sf, w)).squaredNorm());
    return std::sqrt(l2);
  }
  Vec3 normalByFace(int face) const { return unitOr(sf.areaNormal(face, 0), Vec3::UnitZ()); }
  /// Touching at the start: a hit unless the end is clear of the face's plane.
  Approach leaving(int v, int face, const TrianglePoint& q, const Vec3& n) const {
    const auto& f = sf.triangles()[static_cast<size_t>(face)];
    double end_gap = n.dot(at(sv.end, v));
    for (size_t i = 0; i < 3; ++i) end_gap -= q.weight[i] * n.dot(at(sf.end, f[i]));
    return end_gap > 0 ? Approach{1, false} : Approach{0, true};
  }
  /// The hit of a vertex with a face, from scratch.
  Approach hit(int v, int face) const {
    const TrianglePoint q = vertexFaceAt(sv, v, sf, face, 0);
    if (touching(q.distance, at(sv.start, v))) return leaving(v, face, q, normalByFace(face));
    const double least = s.threshold(q.distance, settings.hit_fraction);
    if (q.distance - travel(v, face) >= least) return {1, false};
    return approach(v, face, least);
  }
  /// Calls visit(other face) for the other faces at the edge or corner where q is, until it returns true.
  template <class Visit>
  bool anyNeighbor(int face, const TrianglePoint& q, Visit visit) const {
    int inside = 0, last = 0;
    for (int i = 0; i < 3; ++i)
      if (q.weight[static_cast<size_t>(i)] > kOutline) {
        ++inside;
        last = i;
      }
    if (inside == 3) return false;
    if (inside == 1) {
      for (const int f : sf.trianglesAtVertex(sf.triangles()[static_cast<size_t>(face)][static_cast<size_t>(last)]))
        if (f != face && visit(f)) return true;
      return false;
    }
    int edge = 0;  // opposite the corner without weight: from the next corner on
    for (int i = 0; i < 3; ++i)
      if (!(q.weight[static_cast<size_t>(i)] > kOutline)) edge = (i + 1) % 3;
    const int e = sf.triangleEdges()[static_cast<size_t>(face)][static_cast<size_t>(edge)];
    for (const int f : sf.edgeTriangles()[static_cast<size_t>(e)])
      if (f >= 0 && f != face && visit(f)) return true;
    return false;
  }
  /// Another face at the same edge or corner is nearer at time t, or as near and lower.
  bool neighborNearer(int v, int face, const TrianglePoint& q, double t) const {
    return anyNeighbor(face, q, [&](int f) {
      if (excluded(v, f)) return false;
      const double d = vertexFaceAt(sv, v, sf, f, t).distance;
      return d < q.distance || (d == q.distance && f < face);
    });
  }
  bool neighborHitFirst(int v, int face, const TrianglePoint& q, double toi) const {
    return anyNeighbor(face, q, [&](int f) {
      if (excluded(v, f)) return false;
      const Approach other = hit(v, f);
      return other.reached && (other.time < toi || (other.time == toi && f < face));
    });
  }
  /// The nearest point is on the face's outline, and a face at the vertex is nearer to it than the vertex is: then this
  /// is a vertex beside an edge, and the edge's own pairs say more.
  bool besideEdge(int v, int face, const TrianglePoint& q, double t) const {
    if (std::min({q.weight[0], q.weight[1], q.weight[2]}) > kOutline) return false;
    const auto& f = sf.triangles()[static_cast<size_t>(face)];
    const Vec3 x = sv.position(v, t);
    Vec3 line = -x;
    for (size_t i = 0; i < 3; ++i) line += q.weight[i] * sf.position(f[i], t);
    for (const int g : sv.trianglesAtVertex(v))
      for (const int w : sv.triangles()[static_cast<size_t>(g)]) {
        const Vec3 along = sv.position(w, t) - x;
        if (w != v && line.dot(along) > kFlat * line.norm() * along.norm()) return true;
      }
    return false;
  }
  /// Worth a pair at time t, which is not an impact.
  bool nearest(int v, int face, const TrianglePoint& q, double t) const {
    return !neighborNearer(v, face, q, t) && !besideEdge(v, face, q, t);
  }
  /// Vertex v is nearest to a vertex w, and w to v: one of the two pairs is enough.
  bool mirrored(int v, int face, const TrianglePoint& q, double t, bool vertex_first) const {
    int corner = -1;
    for (size_t i = 0; i < 3; ++i)
      if (q.weight[i] > 1 - kOutline) corner = sf.triangles()[static_cast<size_t>(face)][i];
    if (corner < 0 || (s.self() ? v < corner : vertex_first)) return false;
    for (const int f : sv.trianglesAtVertex(v)) {
      if (s.excluded({corner, -1, -1}, sv.triangles()[static_cast<size_t>(f)])) return false;
      if (vertexFaceAt(sf, corner, sv, f, t).distance < q.distance * (1 - 1e-9)) return false;
    }
    return true;
  }
};

void SurfacePairFinder::testVertexFace(Search& s, bool vertex_first, int vertex, int owner, int face) {
  const Faces faces{s, settings_, vertex_first ? s.a : s.b, vertex_first ? s.b : s.a};
  const CollisionSurface &sv = faces.sv, &sf = faces.sf;
  if (s.may_exclude && faces.excluded(vertex, face)) return;
  TrianglePoint q = vertexFaceAt(sv, vertex, sf, face, 0);
  FeaturePair pair;
  pair.start_distance = q.distance;
  const bool near_start = q.distance < s.reach;
  if (near_start && s.from > 0) return;
  const double travel = faces.travel(vertex, face);
  if (q.distance - travel > s.reach) return;

  const bool touch = touching(q.distance, at(sv.start, vertex));
  const double least = s.threshold(q.distance, settings_.hit_fraction);
  Approach approach;
  if (touch)
    approach = faces.leaving(vertex, face, q, faces.normalByFace(face));
  else if (q.distance - travel < least)
    approach = faces.approach(vertex, face, least);
  pair.hit = approach.reached;
  pair.toi = pair.hit ? approach.time : 1;
  const TrianglePoint q_end = vertexFaceAt(sv, vertex, sf, face, 1);
  pair.end_distance = q_end.distance;
  if (!s.wanted(pair)) return;

  if (pair.hit) {
    pair.reference_time = pair.toi;
    q = vertexFaceAt(sv, vertex, sf, face, pair.toi);
    if (faces.neighborHitFirst(vertex, face, q, pair.toi)) return;
  } else if (near_start && faces.nearest(vertex, face, q, 0)) {
    pair.reference_time = 0;
  } else if (pair.end_distance < s.reach && faces.nearest(vertex, face, q_end, 1)) {
    pair.reference_time = 1;
    q = q_end;
  } else {
    return;
  }
  const double t = pair.reference_time;
  if (faces.mirrored(vertex, face, q, t, vertex_first)) return;

  const auto& f = sf.triangles()[static_cast<size_t>(face)];
  Vec3 line = sv.position(vertex, t), line_end = at(sv.end, vertex);
  const bool clear = !touching(q.distance, line);
  for (size_t i = 0; i < 3; ++i) {
    line -= q.weight[i] * sf.position(f[i], t);
    line_end -= q.weight[i] * at(sf.end, f[i]);
  }
  Vec3 normal = clear ? unitOr(line, Vec3::UnitZ()) : faces.normalByFace(face);
  if (pair.hit) pair.end_distance = normal.dot(line_end);
  if (s.self()) {
    const auto& rest = sv.rest();
    const double d = closestOnTriangle(at(rest, vertex), at(rest, f[0]), at(rest, f[1]), at(rest, f[2])).distance;
    if (d < s.reach) pair.rest_distance = d;
  }
  const Vec3 out = sv.cornerNormal(vertex, t);
  pair.behind = normal.dot(sf.outwardNormal(face, q.weight, t)) < 0 || normal.dot(out) > kBehind * out.norm();
  pair.kind = vertex_first ? FeaturePair::Kind::vertex_face : FeaturePair::Kind::face_vertex;
  const std::array<int, 3> corner{vertex, -1, -1};
  const std::array<double, 3> one{1, 0, 0};
  pair.normal = vertex_first ? normal : Vec3(-normal);
  pair.first_vertex = vertex_first ? corner : f;
  pair.second_vertex = vertex_first ? f : corner;
  pair.first_weight = vertex_first ? one : q.weight;
  pair.second_weight = vertex_first ? q.weight : one;
  pair.first_feature = vertex_first ? vertex : face;
  pair.second_feature = vertex_first ? face : vertex;
  pair.first_triangle = vertex_first ? owner : face;
  pair.second_triangle = vertex_first ? face : owner;
  s.report(pair);
}

void SurfacePairFinder::testEdgeEdge(Search& s, int edge_a, int edge_b) {
  const auto &a = s.a.edges()[static_cast<size_t>(edge_a)], &b = s.b.edges()[static_cast<size_t>(edge_b)];
  FeaturePair pair;
  pair.first_vertex = {a[0], a[1], -1};
  pair.second_vertex = {b[0], b[1], -1};
  if (s.may_exclude && s.excluded(pair.first_vertex, pair.second_vertex)) return;
  SegmentPair q = edgesAt(s.a, a, s.b, b, 0);
  pair.start_distance = q.distance;
  const bool near_start = q.distance < s.reach;
  if (near_start && s.from > 0) return;
  double travel2 = 0;
  for (const int v : a)
    for (const int w : b) travel2 = std::max(travel2, (displacement(s.a, v) - displacement(s.b, w)).squaredNorm());
  const double travel = std::sqrt(travel2);
  if (q.distance - travel > s.reach) return;

  const Faces a_on_b{s, settings_, s.a, s.b}, b_on_a{s, settings_, s.b, s.a};
  const auto inside = [](const SegmentPair& p) {
    return p.s > kOutline && p.s < 1 - kOutline && p.t > kOutline && p.t < 1 - kOutline;
  };
  const auto line = [&](const SegmentPair& p, double t) {
    return Vec3((1 - p.s) * s.a.position(a[0], t) + p.s * s.a.position(a[1], t) - (1 - p.t) * s.b.position(b[0], t) -
                p.t * s.b.position(b[1], t));
  };
  // out of both surfaces' faces where the edges touch; square to both edges where they have a common normal
  const auto touchingNormal = [&](double t) {
    const Vec3 out = s.b.edgeNormal(edge_b, t) - s.a.edgeNormal(edge_a, t);
    const Vec3 da = s.a.position(a[1], t) - s.a.position(a[0], t);
    const Vec3 db = s.b.position(b[1], t) - s.b.position(b[0], t);
    const Vec3 across = da.cross(db);
    if (!(across.norm() > 1e-6 * da.norm() * db.norm())) return unitOr(out, Vec3::UnitZ());
    return unitOr(across.dot(out) < 0 ? Vec3(-across) : across, out);
  };
  const auto normalAt = [&](const SegmentPair& p, double t) {
    if (touching(p.distance, s.a.position(a[0], t))) return touchingNormal(t);
    return unitOr(line(p, t), Vec3::UnitZ());
  };
  // worth a contact of its own at time t, which is not an impact
  const auto sharp = [&](const SegmentPair& p, double t) {
    if (!inside(p)) return false;
    const Vec3 n = normalAt(p, t);
    const EdgeFaces fa = edgeFaces(s.a, edge_a, t, -n), fb = edgeFaces(s.b, edge_b, t, n);
    return !fa.nearer && !fb.nearer && !fa.flat && !fb.flat;
  };
  const auto vertexHits = [&](const Faces& faces, int v, int edge) {
    for (const int f : faces.sf.edgeTriangles()[static_cast<size_t>(edge)])
      if (f >= 0 && !faces.excluded(v, f) && faces.hit(v, f).reached) return true;
    return false;
  };
  // a hit that others stand for
  const auto redundantHit = [&](const SegmentPair& p, double t) {
    if (p.s <= kOutline && vertexHits(a_on_b, a[0], edge_b)) return true;
    if (p.s >= 1 - kOutline && vertexHits(a_on_b, a[1], edge_b)) return true;
    if (p.t <= kOutline && vertexHits(b_on_a, b[0], edge_a)) return true;
    if (p.t >= 1 - kOutline && vertexHits(b_on_a, b[1], edge_a)) return true;
    if (!inside(p)) return false;
    const Vec3 n = normalAt(p, t);
    return edgeFaces(s.a, edge_a, t, -n).flat || edgeFaces(s.b, edge_b, t, n).flat;
  };

  Approach approach;
  const double least = s.threshold(q.distance, settings_.hit_fraction);
  if (touching(q.distance, at(s.a.start, a[0]))) {
    approach = touchingNormal(0).dot(line(q, 1)) > 0 ? Approach{1, false} : Approach{0, true};
  } else if (q.distance - travel < least) {
    approach = timeOfApproach(
        FeatureKind::edge_edge, {at(s.a.start, a[0]), at(s.a.start, a[1]), at(s.b.start, b[0]), at(s.b.start, b[1])},
        {at(s.a.end, a[0]), at(s.a.end, a[1]), at(s.b.end, b[0]), at(s.b.end, b[1])}, least, settings_.max_iterations);
  }
  pair.hit = approach.reached;
  pair.toi = pair.hit ? approach.time : 1;
  const SegmentPair q_end = edgesAt(s.a, a, s.b, b, 1);
  pair.end_distance = q_end.distance;
  if (!s.wanted(pair)) return;

  if (pair.hit) {
    pair.reference_time = pair.toi;
    q = edgesAt(s.a, a, s.b, b, pair.toi);
    if (redundantHit(q, pair.toi)) return;
  } else if (near_start && sharp(q, 0)) {
    pair.reference_time = 0;
  } else if (pair.end_distance < s.reach && sharp(q_end, 1)) {
    pair.reference_time = 1;
    q = q_end;
  } else {
    return;
  }
  pair.kind = FeaturePair::Kind::edge_edge;
  pair.normal = normalAt(q, pair.reference_time);
  if (pair.hit) pair.end_distance = pair.normal.dot(line(q, 1));
  const double t = pair.reference_time;
  const Vec3 out_a = s.a.edgeNormal(edge_a, t), out_b = s.b.edgeNormal(edge_b, t);
  pair.behind = -pair.normal.dot(out_b) > kBehind * out_b.norm() || pair.normal.dot(out_a) > kBehind * out_a.norm();
  if (s.self()) {
    const auto& rest = s.a.rest();
    const double d = closestOnSegments(at(rest, a[0]), at(rest, a[1]), at(rest, b[0]), at(rest, b[1])).distance;
    if (d < s.reach) pair.rest_distance = d;
  }
  pair.first_weight = {1 - q.s, q.s, 0};
  pair.second_weight = {1 - q.t, q.t, 0};
  pair.first_feature = edge_a;
  pair.second_feature = edge_b;
  pair.first_triangle = s.a.ownerOfEdge(edge_a);
  pair.second_triangle = s.b.ownerOfEdge(edge_b);
  s.report(pair);
}

}  // namespace palpate
