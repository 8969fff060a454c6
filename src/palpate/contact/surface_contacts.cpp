#include "palpate/contact/surface_contacts.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "palpate/common/parallel.h"
#include "palpate/contact/feature_distance.h"
#include "palpate/contact/nearest_place.h"
#include "palpate/contact/neighbor_exclusion.h"
#include "palpate/contact/self_intersections.h"
#include "palpate/mesh/mesh_quality.h"

namespace palpate {
namespace {

constexpr double kSlackShare = 0.5;     // of the thickness that a pass may leave open
constexpr int kFirstPartner = 1 << 20;  // partners below are obstacles

Vec3 at(const std::vector<Vec3>& positions, const std::array<int, 3>& vertex, const std::array<double, 3>& weight) {
  Vec3 p = Vec3::Zero();
  for (int i = 0; i < 3; ++i) {
    if (vertex[i] >= 0) p += weight[i] * positions[vertex[i]];
  }
  return p;
}

int heaviest(const std::array<int, 3>& vertex, const std::array<double, 3>& weight) {
  int best = 0;
  for (int i = 1; i < 3; ++i) {
    if (vertex[i] >= 0 && weight[i] > weight[best]) best = i;
  }
  return vertex[best];
}

const int* nodesOf(const EmbeddingMap& embedding, int vertex) { return embedding.nodes().data() + 4 * vertex; }
const double* weightsOf(const EmbeddingMap& embedding, int vertex) { return embedding.weights().data() + 4 * vertex; }

std::uint64_t number(int i) { return static_cast<std::uint64_t>(static_cast<std::int64_t>(i)); }

// Gradients of the barycentric coordinates of a tetrahedron where it now is; zero if it has next to no volume.
std::array<Vec3, 4> gradients(const std::array<Vec3, 4>& x) {
  const Vec3 a = x[1] - x[0];
  const Vec3 b = x[2] - x[0];
  const Vec3 c = x[3] - x[0];
  const double volume = a.dot(b.cross(c));
  const double size = std::max({a.norm(), b.norm(), c.norm()});
  constexpr double kFlat = 1e-3;  // of size^3: flatter ones would take huge weights to move a point by a little
  std::array<Vec3, 4> g;
  g.fill(Vec3::Zero());
  if (std::abs(volume) < kFlat * size * size * size) return g;
  g[1] = b.cross(c) / volume;
  g[2] = c.cross(a) / volume;
  g[3] = a.cross(b) / volume;
  g[0] = -g[1] - g[2] - g[3];
  return g;
}

// Volume of a tetrahedron for the cube of its size.
double fullness(const std::array<Vec3, 4>& x) {
  const Vec3 a = x[1] - x[0];
  const Vec3 b = x[2] - x[0];
  const Vec3 c = x[3] - x[0];
  const double size = std::max({a.norm(), b.norm(), c.norm(), (b - a).norm(), (c - a).norm(), (c - b).norm()});
  return std::abs(a.dot(b.cross(c))) / (size * size * size);
}

// The direction in which two overlapping surfaces are to be moved apart. Nearest exits differ from point to point, near
// an edge by right angles, and would hold the surfaces in each other. Where there is a common one, points that leave in
// another direction wait: they are examined again in the next step.
class CommonExit {
 public:
  explicit CommonExit(const std::vector<OverlapPoint>& points) {
    double depth = 0;
    for (const OverlapPoint& p : points) {
      sum_ += p.depth * ofFirst(p);
      depth += p.depth;
    }
    const double agreement = sum_.norm() / std::max(depth, 1e-300);
    constexpr double kCommon = 0.3, kLeast = 0.5;  // cosines
    // the mean of the points is at `agreement`, so some are kept
    if (agreement > kCommon) least_ = std::min(kLeast, (1.0 - 1e-9) * agreement) * sum_.norm();
  }
  bool takes(const OverlapPoint& p) const { return ofFirst(p).dot(sum_) >= least_; }

 private:
  static Vec3 ofFirst(const OverlapPoint& p) { return p.of_first ? p.normal : Vec3(-p.normal); }
  Vec3 sum_ = Vec3::Zero();
  double least_ = -std::numeric_limits<double>::infinity();
};

// Whether each vertex of the surface is a node. Then any two features without a common vertex have nodes of their own,
// by which contact can hold them apart: so nothing need be left out, and no crease passes through itself.
bool isOfNodes(const SimulationMesh& mesh) {
  constexpr double kRounding = 1e-9;
  return std::all_of(mesh.embedding.begin(), mesh.embedding.end(), [&](const EmbeddedPoint& p) {
    return std::count_if(p.weights.begin(), p.weights.end(), [&](double w) { return std::abs(w) > kRounding; }) == 1;
  });
}

}  // namespace

int SurfaceContacts::id(const Item& item) {
  return item.body >= 0 ? item.body : FrictionTable::obstacle(item.obstacle);
}

void SurfaceContacts::addBody(int body, const SimulationMesh& mesh, bool self) {
  if (mesh.surface.triangles.empty()) return;
  Item item;
  item.body = body;
  item.self = self;
  std::vector<int> clusters;
  clusters.reserve(mesh.surface.triangles.size());
  for (const auto& t : mesh.surface.triangles) clusters.push_back(mesh.embedding[t[0]].tetrahedron);
  // one carrier: let the surface's own places make the groups
  if (mesh.mesh.tetrahedra.size() == 1) clusters.clear();
  item.surface = CollisionSurface(mesh.surface, clusters);
  item.surface.follow(EmbeddingMap(mesh.mesh, mesh.embedding));
  for (const EmbeddedPoint& p : mesh.embedding) {
    item.patch.push_back(p.tetrahedron);
    double extension = 0;
    for (const double w : p.weights) extension += std::abs(w);
    item.extension = std::max(item.extension, extension);
  }
  item.surface.findHollow(item.patch);
  item.start.resize(static_cast<Eigen::Index>(3 * mesh.mesh.nodes.size()));
  for (std::size_t n = 0; n < mesh.mesh.nodes.size(); ++n) {
    item.start.segment<3>(static_cast<Eigen::Index>(3 * n)) = mesh.mesh.nodes[n];
  }
  item.rest = item.end = item.start;
  item.end_placed = false;
  if (self && !clusters.empty()) {  // one alone does not touch itself
    item.tetrahedra = mesh.mesh.tetrahedra;
  }
  if (self && !isOfNodes(mesh)) item.exclusion = excludeNeighbors(item.surface, item.patch, mesh.mesh);
  if (clusters.empty()) {
    for (int c = 0; c < item.surface.clusters(); ++c) {
      for (const int v : item.surface.verticesOfCluster(c)) item.patch[v] = c;
    }
  }
  items_.push_back(std::move(item));
  pairs_.resize(items_.size() * (items_.size() - 1) / 2);
  groupSelves();
}

void SurfaceContacts::addObstacle(int obstacle, const Surface& surface) {
  if (surface.triangles.empty()) return;
  Item item;
  item.obstacle = obstacle;
  item.surface = CollisionSurface(surface);
  item.surface.findHollow();
  items_.push_back(std::move(item));
  pairs_.resize(items_.size() * (items_.size() - 1) / 2);
}

// Number of items: the body has no surface.
std::size_t SurfaceContacts::itemOf(int body) const {
  const auto at = std::find_if(items_.begin(), items_.end(), [&](const Item& i) { return i.body == body; });
  return static_cast<std::size_t>(at - items_.begin());
}

bool SurfaceContacts::leaveOut(int first, const std::vector<char>& marks, int second, double near) {
  constexpr double kRounding = 1e-6;  // [m], of surfaces that lie on each other
  const std::size_t a = itemOf(first), b = itemOf(second);
  if (a == b || a == items_.size() || b == items_.size()) return false;
  for (const std::size_t i : {a, b}) {
    refit(items_[i]);
    items_[i].surface.placeAll();
  }
  const std::vector<char> others = marksNear(items_[a].surface, marks, items_[b].surface, near);
  PairExclusion& out = pair(std::min(a, b), std::max(a, b)).left_out;
  const auto add = [](const std::vector<char>& more, std::vector<char>& to) {
    to.resize(more.size(), 0);
    for (std::size_t v = 0; v < more.size(); ++v) to[v] = static_cast<char>(to[v] | more[v]);
  };
  add(a < b ? marks : others, out.first);
  add(a < b ? others : marks, out.second);
  std::vector<OverlapPoint> inside;
  findOverlaps(items_[std::min(a, b)].surface, items_[std::max(a, b)].surface, inside);
  std::erase_if(inside,
                [&](const OverlapPoint& p) { return p.depth < kRounding || (p.depth < near && out.excludes(p)); });
  if (inside.empty()) return false;
  std::fill(out.first.begin(), out.first.end(), 1);
  std::fill(out.second.begin(), out.second.end(), 1);
  return true;
}

const PairExclusion* SurfaceContacts::leftOut(int first, int second) const {
  const std::size_t a = itemOf(first), b = itemOf(second);
  return a < b && b < items_.size() ? pair(a, b).leftOut() : nullptr;
}

bool SurfaceContacts::active() const {
  const auto moving = std::count_if(items_.begin(), items_.end(), [](const Item& i) { return i.body >= 0; });
  return moving > 0 && (items_.size() > 1 || items_.front().self);
}

// A few vertices, ahead of the others.
void SurfaceContacts::place(const Item& item, const std::array<int, 3>& vertices) {
  for (const int v : vertices) {
    if (v < 0) continue;
    item.surface.placeStart(v);
    item.surface.placeEnd(v);
  }
}

// Of vertices that follow nodes. With c the middle of the nodes' displacements, a vertex's differs from it by
// sum w_k (d_k - c), whatever its weights are.
MotionBounds SurfaceContacts::motionOf(const Item& item, const VecX& from, const VecX& to) {
  Vec3 least = Vec3::Constant(std::numeric_limits<double>::infinity()), greatest = -least;
  Vec3 low = least, high = greatest;
  for (Eigen::Index i = 0; i < from.size(); i += 3) {
    const Vec3 a = from.segment<3>(i), b = to.segment<3>(i);
    least = least.cwiseMin(b - a);
    greatest = greatest.cwiseMax(b - a);
    low = low.cwiseMin(a).cwiseMin(b);
    high = high.cwiseMax(a).cwiseMax(b);
  }
  const auto widen = [&](Vec3& from_here, Vec3& to_here) {
    const Vec3 middle = 0.5 * (from_here + to_here), half = (0.5 + 1e-9) * item.extension * (to_here - from_here);
    from_here = middle - half;
    to_here = middle + half;
  };
  widen(least, greatest);
  widen(low, high);
  return {low.cwiseAbs().cwiseMax(high.cwiseAbs()).maxCoeff(), least, greatest};
}

void SurfaceContacts::setStart(int body, const VecX& x) {
  for (Item& item : items_) {
    if (item.body != body) continue;
    if (item.end_placed && item.end.size() == x.size() && item.end == x) {  // where the last step's search ended
      if (item.end_bounded) {
        item.moved.follow(item.surface.bounds());
      } else {
        item.moved.follow(motionOf(item, item.start, x));
      }
      item.surface.swapEnds();
    } else if (!item.start_known || item.start != x) {
      item.moved.follow(motionOf(item, item.start, x));
      item.surface.moveStart(x);
    }
    if (!item.start_known || item.start != x) item.tangle_known = false;  // not where a step is done again
    item.start_known = true;
    item.start = x;
    moveEnd(item, x);
  }
}

void SurfaceContacts::setEnd(int body, const VecX& x) {
  for (Item& item : items_) {
    if (item.body == body) moveEnd(item, x);
  }
}

void SurfaceContacts::moveEnd(Item& item, const VecX& x) {
  item.end = x;
  item.surface.moveEnd(x);
  item.end_placed = false;
  item.end_bounded = false;
  item.stale = true;
}

void SurfaceContacts::refit(Item& item) {
  if (!item.stale) return;
  item.end_placed = true;
  constexpr double kTight = 2.0;
  if (item.extension < kTight) {
    item.surface.refit(motionOf(item, item.start, item.end));
  } else {
    item.surface.refit();
  }
  item.end_bounded = true;
  item.stale = false;
}

void SurfaceContacts::recheckOverlaps() {
  for (PairState& p : pairs_) p.may_overlap = true;
  for (Item& item : items_) {
    item.tangled = item.self;
    item.tangle_known = false;
  }
}

SurfaceContactsState SurfaceContacts::state() const {
  SurfaceContactsState out;
  for (const PairState& p : pairs_) out.may_overlap.push_back(p.may_overlap ? 1 : 0);
  for (const Item& item : items_) out.tangled.push_back(item.tangled ? 1 : 0);
  return out;
}

void SurfaceContacts::restore(const SurfaceContactsState& state) {
  if (state.may_overlap.size() != pairs_.size() || state.tangled.size() != items_.size())
    throw std::invalid_argument("SurfaceContacts::restore: another number of surfaces");
  for (std::size_t i = 0; i < pairs_.size(); ++i) {
    pairs_[i].may_overlap = state.may_overlap[i] != 0;
    pairs_[i].points.clear();  // examineOverlaps() finds those of pairs that may overlap
  }
  for (std::size_t i = 0; i < items_.size(); ++i) {
    items_[i].tangled = state.tangled[i] != 0;
    items_[i].tangle_known = false;
  }
}

void SurfaceContacts::findTangle(Item& item) {
  refit(item);
  crossings_.clear();
  // what is excluded is never a contact
  findSelfIntersections(item.surface, crossings_, &item.exclusion, &item.front, relativeMotion(item.moved, item.moved));
  item.tangled = !crossings_.empty();
  item.tangle_known = true;
  item.crossed.assign(item.surface.start.size(), 0);
  for (const auto& [t, u] : crossings_) {
    const auto& first = item.surface.triangles()[static_cast<std::size_t>(t)];
    const auto& second = item.surface.triangles()[static_cast<std::size_t>(u)];
    for (const auto* triangle : {&first, &second}) {
      for (const int v : *triangle) item.crossed[static_cast<std::size_t>(v)] = 1;
    }
  }
}

// Contact of what passes through itself, at the crossing or from within.
bool SurfaceContacts::inTangle(const Item& item, const FeaturePair& pair) {
  const auto any = [](const std::array<int, 3>& vertices, const std::vector<char>& marks) {
    return std::any_of(vertices.begin(), vertices.end(),
                       [&](int v) { return v >= 0 && marks[static_cast<std::size_t>(v)] != 0; });
  };
  if (!item.tangled) return false;
  return pair.from_inside || (any(pair.first_vertex, item.crossed) && any(pair.second_vertex, item.crossed));
}

void SurfaceContacts::examineOverlaps(bool trouble) {
  overlap_ = 0;
  for (Item& item : items_) {
    if (!item.self) continue;
    const bool folded = std::any_of(item.tetrahedra.begin(), item.tetrahedra.end(),
                                    [&](const auto& t) { return isTurnedOver(t, item.start); });
    if ((trouble || item.tangled || folded) && !item.tangle_known) findTangle(item);
  }
  for (std::size_t b = 1; b < items_.size(); ++b) {
    for (std::size_t a = 0; a < b; ++a) {
      PairState& state = pair(a, b);
      if (!state.may_overlap || (items_[a].body < 0 && items_[b].body < 0)) continue;
      for (const std::size_t i : {a, b}) {
        refit(items_[i]);
        items_[i].surface.placeAll();
      }
      state.points.clear();
      findOverlaps(items_[a].surface, items_[b].surface, state.points);
      if (const PairExclusion* left_out = state.leftOut()) {
        std::erase_if(state.points, [&](const OverlapPoint& p) { return left_out->excludes(p); });
      }
      state.may_overlap = !state.points.empty();
      for (const OverlapPoint& p : state.points) overlap_ = std::max(overlap_, p.depth);
    }
  }
}

int SurfaceContacts::patch(const Item& item, int vertex) { return item.body < 0 ? -1 : item.patch[vertex]; }

// Whether the pair's normal points out of both surfaces, as it does wherever they do not overlap.
bool SurfaceContacts::facesOutward(const Item& a, const Item& b, const FeaturePair& pair) {
  const auto outward = [](const CollisionSurface& s, bool edge, int feature, int triangle) -> Vec3 {
    if (!edge) return s.areaNormal(triangle, 0);
    Vec3 n = s.areaNormal(s.edgeTriangles()[feature][0], 0);
    if (s.edgeTriangles()[feature][1] >= 0) n += s.areaNormal(s.edgeTriangles()[feature][1], 0);
    return n;
  };
  const bool edges = pair.kind == FeaturePair::Kind::edge_edge;
  if (edges || pair.kind == FeaturePair::Kind::vertex_face) {
    if (pair.normal.dot(outward(b.surface, edges, pair.second_feature, pair.second_triangle)) < 0) return false;
  }
  if (edges || pair.kind == FeaturePair::Kind::face_vertex) {
    if (pair.normal.dot(outward(a.surface, edges, pair.first_feature, pair.first_triangle)) > 0) return false;
  }
  return true;
}

// A surface point by its triangle's vertices.
ContactPoint SurfaceContacts::point(const Item& item, const std::array<int, 3>& vertex,
                                    const std::array<double, 3>& weight) {
  ContactPoint out;
  out.body = item.body;
  if (item.body < 0) return out;
  for (int i = 0; i < 3; ++i) {
    if (vertex[i] < 0 || weight[i] == 0) continue;
    const int* node = nodesOf(item.surface.embedding(), vertex[i]);
    const double* share = weightsOf(item.surface.embedding(), vertex[i]);
    for (int k = 0; k < 4; ++k) {
      const double w = weight[i] * share[k];
      if (w != 0) out.add(node[k], w);
    }
  }
  return out;
}

// In a tetrahedron that is pressed flat a small offset is a multiple of its height, and its nodes' motion would say
// more of the contact than the surface's own: a moment is then the lesser evil.
double SurfaceContacts::shareOfShift(const Item& item, const int* node, const std::array<Vec3, 4>& x,
                                     const std::array<Vec3, 4>& gradient, const Vec3& offset) {
  constexpr double kMost = 0.15;                 // sum of weights
  constexpr double kPressed = 0.4, kWell = 0.7;  // of the height for its size that it has at rest
  double sum = 0;
  for (const Vec3& g : gradient) sum += std::abs(g.dot(offset));
  if (sum <= kMost) return 1.0;
  std::array<Vec3, 4> built;
  for (int k = 0; k < 4; ++k) built[k] = item.rest.segment<3>(3 * node[k]);
  const double well =
      std::clamp((fullness(x) / std::max(fullness(built), 1e-12) - kPressed) / (kWell - kPressed), 0.0, 1.0);
  return well + (1.0 - well) * kMost / sum;
}

// Moves the point off the surface by a little, along with the tetrahedron of one of its vertices. So both bodies'
// points of a contact lie at the same place, and equal and opposite impulses have no moment.
void SurfaceContacts::shift(const Item& item, int vertex, const Vec3& offset, ContactPoint& point) {
  if (item.body < 0) return;
  const int* node = nodesOf(item.surface.embedding(), vertex);
  std::array<Vec3, 4> x;
  for (int k = 0; k < 4; ++k) x[k] = item.start.segment<3>(3 * node[k]);
  const std::array<Vec3, 4> g = gradients(x);
  const double share = shareOfShift(item, node, x, g, offset);
  for (int k = 0; k < 4; ++k) point.add(node[k], share * g[k].dot(offset));
}

void SurfaceContacts::add(std::size_t ia, std::size_t ib, const FeaturePair& pair, const ContactSettings& settings,
                          double mu, bool overlapping, std::vector<Contact>& out) {
  const Item& a = items_[ia];
  const Item& b = items_[ib];
  const Vec3 start_a = at(a.surface.start, pair.first_vertex, pair.first_weight);
  const Vec3 start_b = at(b.surface.start, pair.second_vertex, pair.second_weight);
  const Vec3 end_a = at(a.surface.end, pair.first_vertex, pair.first_weight);
  const Vec3 end_b = at(b.surface.end, pair.second_vertex, pair.second_weight);
  if (overlapping && !facesOutward(a, b, pair)) return;
  Contact c;
  c.thickness = settings.thickness;
  if (ia == ib) c.thickness = std::min(c.thickness, kSlackShare * pair.rest_distance);
  c.slack = kSlackShare * c.thickness;
  c.normal = pair.normal;
  c.gap = c.normal.dot(start_a - start_b) - c.thickness;
  c.end_gap = (pair.hit ? c.normal.dot(end_a - end_b) : pair.end_distance) - c.thickness;
  if (pair.hit && !overlapping) c.impact_time = std::min(pair.toi, 1.0 - 1e-12);
  c.position = 0.5 * (end_a + end_b);
  c.friction = mu;
  c.partner = kFirstPartner + static_cast<int>(ia * items_.size() + ib);
  const int vertex_a = heaviest(pair.first_vertex, pair.first_weight);
  const int vertex_b = heaviest(pair.second_vertex, pair.second_weight);
  c.patch = contactKey(number(patch(a, vertex_a)), number(patch(b, vertex_b)));
  const auto kind = static_cast<std::uint64_t>(pair.kind);
  const std::uint64_t surfaces = contactKey(ia, ib, kind);
  c.key = contactKey(surfaces, number(pair.first_feature), number(pair.second_feature));
  c.track = pair.kind == FeaturePair::Kind::vertex_face   ? contactKey(surfaces, number(pair.first_feature))
            : pair.kind == FeaturePair::Kind::face_vertex ? contactKey(surfaces, number(pair.second_feature))
                                                          : c.key;
  c.features = {static_cast<int>(ia), static_cast<int>(ib), static_cast<int>(pair.kind), pair.first_feature,
                pair.second_feature};
  c.first = point(a, pair.first_vertex, pair.first_weight);
  c.second = point(b, pair.second_vertex, pair.second_weight);
  if (b.body >= 0 && (start_a - start_b).norm() < 2.0 * settings.surfaceReach()) {
    const Vec3 middle = 0.5 * (start_a + start_b);
    shift(a, vertex_a, middle - start_a, c.first);
    shift(b, vertex_b, middle - start_b, c.second);
  }
  setTangents(c);
  out.push_back(c);
}

// Surfaces that start in each other: the inner point against the other's nearest outer place.
void SurfaceContacts::addOverlap(std::size_t ia, std::size_t ib, const OverlapPoint& overlap,
                                 const ContactSettings& settings, double mu, std::vector<Contact>& out) {
  const Item& inner = items_[overlap.of_first ? ia : ib];
  const Item& outer = items_[overlap.of_first ? ib : ia];
  Contact c;
  c.thickness = settings.thickness;
  c.slack = std::numeric_limits<double>::infinity();  // recovers step by step, not in passes
  c.gap = c.end_gap = -overlap.depth - c.thickness;
  c.friction = mu;
  c.partner = kFirstPartner + static_cast<int>(ia * items_.size() + ib);
  const int vertex_outer = heaviest(overlap.other_vertex, overlap.other_weight);
  c.patch = contactKey(number(patch(inner, overlap.vertex[0])), number(patch(outer, vertex_outer)), 1);
  c.key = c.track =
      contactKey(contactKey(ia, ib, 3), number(overlap.vertex[0]), number(overlap.vertex[1]), overlap.of_first ? 1 : 0);
  c.normal = overlap.normal;
  c.first = point(inner, overlap.vertex, overlap.weight);
  c.second = point(outer, overlap.other_vertex, overlap.other_weight);
  place(inner, overlap.vertex);
  c.position = at(inner.surface.end, overlap.vertex, overlap.weight);
  if (c.first.body < 0) c = turnedAround(c);
  setTangents(c);
  out.push_back(c);
}

// The pair of features where it is at the start: closest points, distance and normal.
FeaturePair SurfaceContacts::pairAtStart(const ContactFeatures& f, const Item& item_a, const Item& item_b) {
  const CollisionSurface &a = item_a.surface, &b = item_b.surface;
  FeaturePair pair;
  pair.kind = static_cast<FeaturePair::Kind>(f.kind);
  pair.first_feature = f.first;
  pair.second_feature = f.second;
  if (pair.kind == FeaturePair::Kind::edge_edge) {
    const auto& ea = a.edges()[f.first];
    const auto& eb = b.edges()[f.second];
    place(item_a, {ea[0], ea[1], -1});
    place(item_b, {eb[0], eb[1], -1});
    const SegmentPair q = closestOnSegments(a.start[ea[0]], a.start[ea[1]], b.start[eb[0]], b.start[eb[1]]);
    pair.first_vertex = {ea[0], ea[1], -1};
    pair.second_vertex = {eb[0], eb[1], -1};
    pair.first_weight = {1 - q.s, q.s, 0};
    pair.second_weight = {1 - q.t, q.t, 0};
  } else {
    const bool vertex_first = pair.kind == FeaturePair::Kind::vertex_face;
    const auto& face = vertex_first ? b.triangles()[f.second] : a.triangles()[f.first];
    const std::vector<Vec3>& x = vertex_first ? b.start : a.start;
    const int vertex = vertex_first ? f.first : f.second;
    place(vertex_first ? item_a : item_b, {vertex, -1, -1});
    place(vertex_first ? item_b : item_a, face);
    const Vec3& p = vertex_first ? a.start[vertex] : b.start[vertex];
    const TrianglePoint q = closestOnTriangle(p, x[face[0]], x[face[1]], x[face[2]]);
    (vertex_first ? pair.first_vertex : pair.second_vertex) = {vertex, -1, -1};
    (vertex_first ? pair.first_weight : pair.second_weight) = {1, 0, 0};
    (vertex_first ? pair.second_vertex : pair.first_vertex) = face;
    (vertex_first ? pair.second_weight : pair.first_weight) = q.weight;
  }
  const Vec3 line =
      at(a.start, pair.first_vertex, pair.first_weight) - at(b.start, pair.second_vertex, pair.second_weight);
  pair.start_distance = line.norm();
  pair.normal = line / pair.start_distance;
  return pair;
}

void SurfaceContacts::follow(const Contact& earlier, const ContactSettings& settings, const FrictionTable& friction,
                             std::vector<Contact>& out) {
  const ContactFeatures& f = earlier.features;
  if (f.first < 0) return;
  const auto ia = static_cast<std::size_t>(f.first_surface);
  const auto ib = static_cast<std::size_t>(f.second_surface);
  if (ia != ib && !pair(std::min(ia, ib), std::max(ia, ib)).points.empty()) return;
  const Item& a = items_[ia];
  const Item& b = items_[ib];
  FeaturePair pair = pairAtStart(f, a, b);
  if (ia == ib && inTangle(a, pair)) return;
  const double distance = pair.start_distance;
  if (!(distance < settings.surfaceReach()) || !(distance > 1e-3 * settings.thickness)) return;
  // turned far since: another side of the features, which has pairs of its own
  if (pair.normal.dot(earlier.normal) < 0.7) return;
  const Vec3 end = at(a.surface.end, pair.first_vertex, pair.first_weight) -
                   at(b.surface.end, pair.second_vertex, pair.second_weight);
  pair.end_distance = pair.normal.dot(end);
  if (ia == ib)
    pair.rest_distance = (earlier.thickness < settings.thickness ? earlier.thickness / kSlackShare
                                                                 : std::numeric_limits<double>::infinity());
  add(ia, ib, pair, settings, friction(id(a), id(b)), false, out);
}

bool SurfaceContacts::isNearest(const Contact& earlier, const ContactSettings& settings) {
  const ContactFeatures& f = earlier.features;
  if (f.first < 0) return false;
  const Item& a = items_[static_cast<std::size_t>(f.first_surface)];
  const Item& b = items_[static_cast<std::size_t>(f.second_surface)];
  const FeaturePair pair = pairAtStart(f, a, b);
  const auto placeAround = [](const Item& item, const std::array<int, 3>& vertices) {
    for (const int v : vertices) {
      if (v < 0) continue;
      for (const int t : item.surface.trianglesAtVertex(v)) place(item, item.surface.triangles()[t]);
    }
  };
  placeAround(a, pair.first_vertex);
  placeAround(b, pair.second_vertex);
  return finder_.isNearest(a.surface, b.surface, &a == &b ? &a.exclusion : nullptr, settings.surfaceReach(), pair);
}

SurfaceFeature SurfaceContacts::featureOn(int body, const Contact& contact) const {
  const ContactFeatures& f = contact.features;
  if (f.first < 0 || f.first_surface == f.second_surface) return {};
  const bool second = items_[f.second_surface].body == body;
  if (!second && items_[f.first_surface].body != body) return {};
  return featureAt(contact, second);
}

SurfaceFeature SurfaceContacts::featureAt(const Contact& contact, bool second) const {
  const ContactFeatures& f = contact.features;
  SurfaceFeature out;
  const CollisionSurface& surface = items_[second ? f.second_surface : f.first_surface].surface;
  out.surface = &surface;
  const int feature = second ? f.second : f.first;
  const auto addCorners = [&](const auto& vertices) {
    for (const int v : vertices) {
      surface.placeStart(v);
      out.corners.push_back(surface.start[v]);
    }
  };
  const auto kind = static_cast<FeaturePair::Kind>(f.kind);
  if (kind == FeaturePair::Kind::edge_edge) {
    for (const int t : surface.edgeTriangles()[feature]) {
      if (t >= 0) out.triangles.push_back(t);
    }
    addCorners(surface.edges()[feature]);
  } else if ((kind == FeaturePair::Kind::vertex_face) == second) {
    out.triangles = {feature};
    addCorners(surface.triangles()[feature]);
  } else {
    const auto around = surface.trianglesAtVertex(feature);
    out.triangles.assign(around.begin(), around.end());
    addCorners(std::array{feature});
  }
  return out;
}

Vec3 SurfaceFeature::nearestTo(const Vec3& point) const {
  const std::size_t count = corners.size();  // one that is named twice adds nothing
  const Vec3 &a = corners[0], &b = corners[1 % count], &c = corners[2 % count];
  const TrianglePoint p = closestOnTriangle(point, a, b, c);
  return p.weight[0] * a + p.weight[1] * b + p.weight[2] * c;
}

void SurfaceContacts::renew(int body, Contact& contact) const {
  contact.gap = 0;
  if (contact.features.first < 0) return;
  const bool turned = contact.first.body != body;
  Contact own = turned ? turnedAround(contact) : contact;
  if (!slidesOff(own)) return;
  contact = turned ? turnedAround(own) : own;
  setTangents(contact);
}

// Of renew(), with the point that stays as the first.
bool SurfaceContacts::slidesOff(Contact& contact) const {
  constexpr double kSame = 0.95;  // cosine
  ContactFeatures& f = contact.features;
  const Item& own = items_[f.first_surface];
  const Item& other = items_[f.second_surface];
  const SurfaceFeature on = featureAt(contact, true);
  const Vec3 at_own = contact.first.at(own.start);
  const NearestPlace place = nearestFrom(other.surface, on.triangles, at_own);
  if (place.normal.dot(contact.normal) >= kSame) return false;
  const SurfaceFeature from = featureAt(contact, false);
  const NearestPlace back = nearestFrom(own.surface, from.triangles, on.nearestTo(at_own));
  if (-back.normal.dot(contact.normal) >= kSame) return false;
  const std::array<int, 3>& face = other.surface.triangles()[place.triangle];
  const std::array<int, 3>& corners = own.surface.triangles()[from.triangles.front()];
  // around the end of a fold, to where the point itself is
  if (&own == &other && std::find_first_of(face.begin(), face.end(), corners.begin(), corners.end()) != face.end())
    return false;
  const int vertex = *std::min_element(corners.begin(), corners.end(), [&](int a, int b) {
    return (own.surface.start[a] - at_own).squaredNorm() < (own.surface.start[b] - at_own).squaredNorm();
  });
  contact.normal = place.normal;
  contact.gap = std::max(0.0, place.distance - contact.thickness);
  contact.second = point(other, face, place.weight);
  f.kind = static_cast<int>(FeaturePair::Kind::vertex_face);
  f.first = vertex;
  f.second = place.triangle;
  return true;
}

// A path that runs into the other surface tells little about what comes after: edges that hit late do so from odd
// sides, and what is near at its end is near from within. Those wait for the next pass, whose path stops at the first.
void SurfaceContacts::keepDependable(std::vector<FeaturePair>& found) const {
  constexpr double kTogether = 0.05;  // of the step
  // A tool that was corrected may be in what it touches, by micrometers: on its way out it is not to be held.
  if (finder_.ahead()) std::erase_if(found, [](const FeaturePair& p) { return p.from_inside; });
  double first = 1.0;
  for (const FeaturePair& p : found) {
    if (p.hit) first = std::min(first, p.toi);
  }
  const bool hits = first < 1.0;
  std::erase_if(found, [&](const FeaturePair& p) {
    if (!p.hit) return p.from_inside || (hits && p.reference_time == 1);
    if (p.toi <= first + kTogether) return false;
    return p.from_inside || p.kind == FeaturePair::Kind::edge_edge;
  });
}

std::vector<SurfaceOverlap> SurfaceContacts::overlaps() const {
  std::vector<SurfaceOverlap> out;
  for (std::size_t b = 1; b < items_.size(); ++b) {
    for (std::size_t a = 0; a < b; ++a) {
      SurfaceOverlap overlap{{items_[a].body, items_[b].body}, {items_[a].obstacle, items_[b].obstacle}, 0};
      for (const OverlapPoint& p : pair(a, b).points) overlap.depth = std::max(overlap.depth, p.depth);
      if (overlap.depth > 0) out.push_back(overlap);
    }
  }
  return out;
}

void SurfaceContacts::findOverlapping(const ContactSettings& settings, const FrictionTable& friction,
                                      std::vector<Contact>& out) {
  for (std::size_t b = 1; b < items_.size(); ++b) {
    for (std::size_t a = 0; a < b; ++a) {
      const PairState& state = pair(a, b);
      if (state.points.empty()) continue;
      const double mu = friction(id(items_[a]), id(items_[b]));
      const CommonExit exit(state.points);
      for (const OverlapPoint& p : state.points) {
        if (exit.takes(p)) addOverlap(a, b, p, settings, mu, out);
      }
    }
  }
}

// Which surfaces are searched together depends on their sizes alone: what is given up must be the same on any number of
// threads.
void SurfaceContacts::groupSelves() {
  std::vector<std::size_t> selves;
  for (std::size_t i = 0; i < items_.size(); ++i) {
    if (items_[i].self) selves.push_back(i);
  }
  const auto clusters = [&](std::size_t i) { return items_[i].surface.clusters(); };
  std::stable_sort(selves.begin(), selves.end(),
                   [&](std::size_t i, std::size_t j) { return clusters(i) > clusters(j); });
  for (SelfGroup& group : groups_) group.items.clear();
  std::array<int, kMostGroups> sizes{};
  for (const std::size_t i : selves) {
    const auto least = std::min_element(sizes.begin(), sizes.end());
    groups_[static_cast<std::size_t>(least - sizes.begin())].items.push_back(i);
    *least += clusters(i);
  }
}

// Pairs within each surface, into its item; at the same time, unless one surface is most of the work.
void SurfaceContacts::searchSelves(double reach, int body) {
  const auto work = [&](int k) {
    double pairs = 0;
    for (const std::size_t i : groups_[static_cast<std::size_t>(k)].items) {
      if (items_[i].isOf(body)) pairs += static_cast<double>(items_[i].front.size() + items_[i].surface.nodes().size());
    }
    return pairs;
  };
  const double allowed = allowed_ - tested_;
  for (SelfGroup& group : groups_) group.finder.allow(allowed);
  parallelByWeight(static_cast<int>(groups_.size()), work, [&](int k) {
    SelfGroup& group = groups_[static_cast<std::size_t>(k)];
    for (const std::size_t i : group.items) {
      Item& item = items_[i];
      refit(item);
      item.found.clear();
      if (item.isOf(body)) group.finder.findSelf(item.surface, item.exclusion, reach, item.found, &item.front);
    }
  });
  for (const SelfGroup& group : groups_) account(group.finder);
}

void SurfaceContacts::account(const SurfacePairFinder& finder) {
  tested_ += finder.tested();
  gave_up_ = gave_up_ || finder.gaveUp() || tested_ > allowed_;
}

void SurfaceContacts::find(const ContactSettings& settings, const FrictionTable& friction, std::vector<Contact>& out,
                           int body) {
  for (Item& item : items_) {
    if (item.self) item.front.moved(relativeMotion(item.moved, item.moved));
  }
  searchSelves(settings.surfaceReach(), body);
  for (Item& item : items_) refit(item);
  for (std::size_t b = 0; b < items_.size(); ++b) {
    if (items_[b].self && items_[b].isOf(body)) addSelf(b, settings, friction, out);
    for (std::size_t a = 0; a < b; ++a) {
      if (items_[a].body < 0 && items_[b].body < 0) continue;
      // the first one moves
      const std::size_t first = items_[a].body < 0 ? b : a;
      const std::size_t second = first == a ? b : a;
      pair(a, b).front.moved(relativeMotion(items_[first].moved, items_[second].moved));
      if (items_[a].isOf(body) || items_[b].isOf(body)) findPair(first, second, pair(a, b), settings, friction, out);
    }
  }
  for (Item& item : items_) item.moved = {};
}

void SurfaceContacts::addSelf(std::size_t i, const ContactSettings& settings, const FrictionTable& friction,
                              std::vector<Contact>& out) {
  Item& item = items_[i];
  const double mu = friction(id(item), id(item));
  keepDependable(item.found);
  std::erase_if(item.found, [&](const FeaturePair& p) { return inTangle(item, p); });
  for (const FeaturePair& p : item.found) add(i, i, p, settings, mu, false, out);
}

void SurfaceContacts::findPair(std::size_t first, std::size_t second, PairState& state, const ContactSettings& settings,
                               const FrictionTable& friction, std::vector<Contact>& out) {
  if (gave_up_) return;
  found_.clear();
  finder_.allow(allowed_ - tested_);
  finder_.find(items_[first].surface, items_[second].surface, settings.surfaceReach(), found_, &state.front,
               state.leftOut());
  account(finder_);
  keepDependable(found_);
  const double mu = friction(id(items_[first]), id(items_[second]));
  for (const FeaturePair& p : found_) add(first, second, p, settings, mu, !state.points.empty(), out);
}

}  // namespace palpate
