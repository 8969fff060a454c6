#include "palpate/contact/collision_surface.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "palpate/common/error.h"
#include "palpate/math/stable_norm.h"

namespace palpate {
namespace {

constexpr int kLargestGroup = 64;
constexpr int kLargestCluster = 32;

void checkSurface(const Surface& surface, std::span<const int> groups) {
  const auto fail = [](size_t i, const std::string& what) {
    throw InputError("surface", "triangle " + std::to_string(i), what);
  };
  const int n = static_cast<int>(surface.vertices.size());
  for (size_t i = 0; i < surface.triangles.size(); ++i) {
    const auto& t = surface.triangles[i];
    for (const int v : t)
      if (v < 0 || v >= n) fail(i, "vertex " + std::to_string(v) + " does not exist");
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) fail(i, "names a vertex twice");
  }
  for (size_t i = 0; i < surface.vertices.size(); ++i)
    if (!surface.vertices[i].allFinite()) throw InputError("surface", "vertex " + std::to_string(i), "is not finite");
  if (!groups.empty() && groups.size() != surface.triangles.size())
    throw InputError("surface", "cluster_of_triangle", "needs one entry a triangle");
  for (size_t i = 0; i < groups.size(); ++i)
    if (groups[i] < 0) fail(i, "has a negative cluster");
}

// Axis along which points spread most.
template <class Points, class Indices>
int widestAxis(const Points& points, const Indices& indices, int first, int last) {
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (int i = first; i < last; ++i) {
    const Vec3& p = points[static_cast<size_t>(indices[static_cast<size_t>(i)])];
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  int axis = 0;
  (high - low).maxCoeff(&axis);
  return axis;
}

// Puts the lower half along the widest axis first; equal coordinates go by index, so that the result is one.
template <class Points>
int medianSplit(const Points& points, std::vector<int>& indices, int first, int last) {
  const int axis = widestAxis(points, indices, first, last);
  const int middle = first + (last - first) / 2;
  const auto at = indices.begin();
  std::nth_element(at + first, at + middle, at + last, [&](int a, int b) {
    const double x = points[static_cast<size_t>(a)][axis], y = points[static_cast<size_t>(b)][axis];
    return x < y || (x == y && a < b);
  });
  return middle;
}

struct PackedBounds {
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 high = Vec3::Constant(-std::numeric_limits<double>::infinity());
  void add(const Vec3& p) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
};

}  // namespace

CollisionSurface::CollisionSurface(const Surface& surface, std::span<const int> cluster_of_triangle)
    : start(surface.vertices), end(surface.vertices), rest_(surface.vertices), triangles_(surface.triangles) {
  checkSurface(surface, cluster_of_triangle);
  buildVertexTriangles();
  buildEdges();
  buildClusters(cluster_of_triangle);
  buildClusterVertices();
  std::vector<Vec3> centers;
  for (int c = 0; c < clusters(); ++c) {
    PackedBounds bounds;
    for (const int v : verticesOfCluster(c)) bounds.add(rest_[static_cast<size_t>(v)]);
    centers.push_back(0.5 * (bounds.low + bounds.high));
  }
  std::vector<int> all(centers.size());
  std::iota(all.begin(), all.end(), 0);
  if (!all.empty()) buildTree(centers, all, 0, static_cast<int>(all.size()));
  node_boxes_.resize(nodes_.size());
  node_made_at_.assign(nodes_.size(), 0);
  boxes_made_at_.assign(all.size(), 0);
  triangle_boxes_.resize(triangles_.size());
  refit();
  double size = 0;
  for (int i = 0; i < static_cast<int>(nodes_.size()); ++i) {
    if (nodes_[static_cast<size_t>(i)].right < 0) size += static_cast<double>(nodeBox(i).size());
  }
  if (!all.empty()) cluster_size_ = size / clusters() / 3;
}

void CollisionSurface::buildVertexTriangles() {
  vertex_offset_.assign(rest_.size() + 1, 0);
  for (const auto& t : triangles_)
    for (const int v : t) ++vertex_offset_[static_cast<size_t>(v) + 1];
  std::partial_sum(vertex_offset_.begin(), vertex_offset_.end(), vertex_offset_.begin());
  vertex_triangles_.resize(3 * triangles_.size());
  owned_.assign(triangles_.size(), 0);
  std::vector<int> next(vertex_offset_.begin(), vertex_offset_.end() - 1);
  for (size_t i = 0; i < triangles_.size(); ++i)
    for (size_t k = 0; k < 3; ++k) {
      const auto v = static_cast<size_t>(triangles_[i][k]);
      if (next[v] == vertex_offset_[v]) owned_[i] = static_cast<std::uint8_t>(owned_[i] | 1u << k);
      vertex_triangles_[static_cast<size_t>(next[v]++)] = static_cast<int>(i);
    }
}

void CollisionSurface::buildEdges() {
  struct Use {
    int low, high, triangle, corner;
    bool forward;
  };
  std::vector<Use> uses;
  uses.reserve(3 * triangles_.size());
  for (size_t i = 0; i < triangles_.size(); ++i)
    for (size_t k = 0; k < 3; ++k) {
      const int a = triangles_[i][k], b = triangles_[i][(k + 1) % 3];
      uses.push_back({std::min(a, b), std::max(a, b), static_cast<int>(i), static_cast<int>(k), a < b});
    }
  std::sort(uses.begin(), uses.end(), [](const Use& a, const Use& b) {
    return std::array{a.low, a.high, a.triangle} < std::array{b.low, b.high, b.triangle};
  });
  triangle_edges_.resize(triangles_.size());
  closed_ = !triangles_.empty();
  for (size_t i = 0; i < uses.size();) {
    size_t j = i;
    const int edge = static_cast<int>(edges_.size());
    int balance = 0;
    for (; j < uses.size() && uses[j].low == uses[i].low && uses[j].high == uses[i].high; ++j) {
      triangle_edges_[static_cast<size_t>(uses[j].triangle)][static_cast<size_t>(uses[j].corner)] = edge;
      balance += uses[j].forward ? 1 : -1;
    }
    const auto owner = static_cast<size_t>(uses[i].triangle);
    owned_[owner] = static_cast<std::uint8_t>(owned_[owner] | 8u << uses[i].corner);
    edges_.push_back({uses[i].low, uses[i].high});
    edge_triangles_.push_back({uses[i].triangle, j - i > 1 ? uses[i + 1].triangle : -1});
    closed_ = closed_ && j - i == 2 && balance == 0;
    i = j;
  }
}

void CollisionSurface::buildClusters(std::span<const int> cluster_of_triangle) {
  std::vector<Vec3> centers;
  centers.reserve(triangles_.size());
  for (const auto& t : triangles_) {
    Vec3 sum = Vec3::Zero();
    for (const int v : t) sum += rest_[static_cast<size_t>(v)];
    centers.push_back(sum / 3);
  }
  order_.resize(triangles_.size());
  std::iota(order_.begin(), order_.end(), 0);
  const int n = static_cast<int>(order_.size());
  if (cluster_of_triangle.empty()) {
    if (n > 0) splitCluster(centers, 0, n, kLargestCluster);
    return;
  }
  const auto group = [&](int triangle) { return cluster_of_triangle[static_cast<size_t>(triangle)]; };
  std::stable_sort(order_.begin(), order_.end(), [&](int a, int b) { return group(a) < group(b); });
  for (int first = 0, last = 0; first < n; first = last) {
    while (last < n && group(order_[static_cast<size_t>(last)]) == group(order_[static_cast<size_t>(first)])) ++last;
    splitCluster(centers, first, last, kLargestGroup);
  }
}

void CollisionSurface::splitCluster(const std::vector<Vec3>& centers, int first, int last, int limit) {
  if (last - first <= limit) {
    cluster_offset_.push_back(last);
    return;
  }
  const int middle = medianSplit(centers, order_, first, last);
  splitCluster(centers, first, middle, limit);
  splitCluster(centers, middle, last, limit);
}

void CollisionSurface::buildClusterVertices() {
  std::vector<int> vertices;
  for (int c = 0; c < clusters(); ++c) {
    vertices.clear();
    for (const int t : trianglesOfCluster(c))
      for (const int v : triangles_[static_cast<size_t>(t)]) vertices.push_back(v);
    std::sort(vertices.begin(), vertices.end());
    vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
    cluster_vertices_.insert(cluster_vertices_.end(), vertices.begin(), vertices.end());
    cluster_vertex_offset_.push_back(static_cast<int>(cluster_vertices_.size()));
  }
}

int CollisionSurface::buildTree(const std::vector<Vec3>& centers, std::vector<int>& clusters, int first, int last) {
  const int node = static_cast<int>(nodes_.size());
  nodes_.emplace_back();
  if (last - first == 1) {
    nodes_.back().cluster = clusters[static_cast<size_t>(first)];
    return node;
  }
  const int middle = medianSplit(centers, clusters, first, last);
  buildTree(centers, clusters, first, middle);
  const int right = buildTree(centers, clusters, middle, last);
  nodes_[static_cast<size_t>(node)].right = right;
  return node;
}

Vec3 CollisionSurface::areaNormal(int triangle, double time) const {
  const auto& t = triangles_[static_cast<size_t>(triangle)];
  const Vec3 a = position(t[0], time);
  return (position(t[1], time) - a).cross(position(t[2], time) - a);
}

Vec3 CollisionSurface::edgeNormal(int edge, double time) const {
  Vec3 sum = Vec3::Zero();
  for (const int t : edge_triangles_[static_cast<size_t>(edge)])
    if (t >= 0) sum += areaNormal(t, time).stableNormalized();
  return sum;
}

Vec3 CollisionSurface::inward(int edge, int triangle, double time) const {
  const auto& [from, to] = edges_[static_cast<size_t>(edge)];
  const Vec3 x = position(from, time), along = position(to, time) - x;
  const double length2 = along.squaredNorm();
  int opposite = -1;
  for (const int v : triangles_[static_cast<size_t>(triangle)])
    if (v != from && v != to) opposite = v;
  Vec3 inward = position(opposite, time) - x;
  if (length2 > 0) inward -= (inward.dot(along) / length2) * along;
  return inward;
}

Vec3 CollisionSurface::cornerNormal(int vertex, double time) const {
  Vec3 sum = Vec3::Zero();
  const Vec3 x = position(vertex, time);
  for (const int triangle : trianglesAtVertex(vertex)) {
    const auto& t = triangles_[static_cast<size_t>(triangle)];
    const size_t k = t[0] == vertex ? 0 : t[1] == vertex ? 1 : 2;
    const Vec3 u = position(t[(k + 1) % 3], time) - x, v = position(t[(k + 2) % 3], time) - x;
    const Vec3 n = u.cross(v);
    sum += std::atan2(n.norm(), u.dot(v)) * n.stableNormalized();
  }
  return sum;
}

Vec3 CollisionSurface::outwardNormal(int triangle, const std::array<double, 3>& weight, double time) const {
  const auto t = static_cast<size_t>(triangle);
  size_t used = 0, corner = 0, opposite = 0;
  for (size_t i = 0; i < 3; ++i) {
    if (weight[i] > kOutline) {
      ++used;
      corner = i;
    } else {
      opposite = i;
    }
  }
  Vec3 sum = Vec3::Zero();
  if (used == 1) sum = cornerNormal(triangles_[t][corner], time);
  if (used == 2) sum = edgeNormal(triangle_edges_[t][(opposite + 1) % 3], time);
  if (!(sum.norm() > 1e-6)) sum = areaNormal(triangle, time);  // inside, or faces folded onto each other
  const double length = stableNorm(sum);
  return length > 0 ? Vec3(sum / length) : Vec3(Vec3::UnitZ());
}

void CollisionSurface::findHollow(std::span<const int> carrier) {
  constexpr double kRounding = 1e-10;  // sine of the angle by which one face falls away from the other
  hollow_.clear();
  if (!closed_) return;
  const auto carrierOf = [&](int v) { return carrier.empty() ? 0 : carrier[static_cast<size_t>(v)]; };
  hollow_.resize(edges_.size());
  for (size_t e = 0; e < edges_.size(); ++e) {
    const auto& [own, other] = edge_triangles_[e];
    const int with = carrierOf(edges_[e][0]);
    const auto movesWith = [&](int triangle) {
      const auto& corners = triangles_[static_cast<size_t>(triangle)];
      return std::all_of(corners.begin(), corners.end(), [&](int v) { return carrierOf(v) == with; });
    };
    if (!movesWith(own) || !movesWith(other)) continue;
    const Vec3 way = inward(static_cast<int>(e), other, 0), normal = areaNormal(own, 0);
    hollow_[e] = way.dot(normal) > -kRounding * way.norm() * normal.norm() ? 1 : 0;  // not where there is no area
  }
}

void CollisionSurface::refit() {
  if (!embedding_.nodes().empty()) placeAll();
  PackedBounds moves, places;
  start_side_.rounded.resize(start.size());
  end_side_.rounded.resize(end.size());
  const auto rounded = [](const Vec3& p) {
    return MovingBox::Corner(static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), 0.0f);
  };
  for (size_t v = 0; v < start.size(); ++v) {
    start_side_.rounded[v] = rounded(start[v]);
    end_side_.rounded[v] = rounded(end[v]);
    moves.add(end[v] - start[v]);
    places.add(start[v]);
    places.add(end[v]);
  }
  MotionBounds bounds;
  if (!start.empty())
    bounds = {places.low.cwiseAbs().cwiseMax(places.high.cwiseAbs()).maxCoeff(), moves.low, moves.high};
  ++refits_;
  bounds_ = bounds;
}

void CollisionSurface::refit(const MotionBounds& bounds) {
  if (!sparse_ && !ends_placed_) placeAll(end_side_, end);
  ends_placed_ = true;
  ++refits_;
  bounds_ = bounds;
}

void CollisionSurface::makeNodeBox(int node) const {
  const auto i = static_cast<size_t>(node);
  MovingBox& box = node_boxes_[i];
  node_made_at_[i] = refits_;
  if (nodes_[i].right < 0) {
    box = sparse_ && exact_at_ != refits_ ? boundOf(nodes_[i].cluster) : boxOf(verticesOfCluster(nodes_[i].cluster));
  } else {
    box = nodeBox(node + 1);
    box.include(nodeBox(nodes_[i].right));
  }
}

void CollisionSurface::makeTriangleBoxes(int cluster) const {
  const auto c = static_cast<size_t>(cluster);
  const auto first = static_cast<size_t>(cluster_offset_[c]), last = static_cast<size_t>(cluster_offset_[c + 1]);
  for (size_t i = first; i < last; ++i) triangle_boxes_[i] = boxOf(triangles_[static_cast<size_t>(order_[i])]);
}

}  // namespace palpate
