#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "palpate/math/types.h"
#include "palpate/mesh/embedding_map.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// Box around points that move along straight lines: around their starts and around their ends. Between the two, the
/// box at time t is at most the interpolated one. Single precision, rounded outward; upper bounds are kept negated.
struct MovingBox {
  using Corner = Eigen::Array4f;  // x, y, z, 0
  Corner start_low = Corner::Zero();
  Corner start_negative_high = Corner::Zero();
  Corner end_low = Corner::Zero();
  Corner end_negative_high = Corner::Zero();

  /// Of one point; coordinates rounded to the nearest.
  static MovingBox around(const Corner& start, const Corner& end) {
    constexpr float kRounding = std::numeric_limits<float>::epsilon();
    const Corner of_start = start.abs() * kRounding, of_end = end.abs() * kRounding;
    return {start - of_start, -start - of_start, end - of_end, -end - of_end};
  }
  void include(const MovingBox& other) {
    start_low = start_low.min(other.start_low);
    start_negative_high = start_negative_high.min(other.start_negative_high);
    end_low = end_low.min(other.end_low);
    end_negative_high = end_negative_high.min(other.end_negative_high);
  }
  /// What keeps the boxes apart at the start on each axis, below zero where nothing does [m].
  Corner startGaps(const MovingBox& other) const {
    return (start_low + other.start_negative_high).max(start_negative_high + other.start_low);
  }
  /// Sum of the extents at the start [m].
  float size() const { return -(start_low + start_negative_high).sum(); }
};

/// What holds for all vertices of a surface in a step.
struct MotionBounds {
  double extent = 0;             ///< no coordinate is larger, at the start or the end [m]
  Vec3 least = Vec3::Zero();     ///< displacement from start to end, axis by axis [m]
  Vec3 greatest = Vec3::Zero();  ///< [m]
  /// One motion after the other.
  void follow(const MotionBounds& next) {
    extent = std::max(extent, next.extent);
    least += next.least;
    greatest += next.greatest;
  }
};

/// Bound of how far any vertex of one surface moves relative to any of another [m].
inline double relativeMotion(const MotionBounds& a, const MotionBounds& b) {
  return (a.greatest - b.least).cwiseMax(b.greatest - a.least).norm();
}

/// Triangle surface prepared for collision: topology and a tree of boxes, both fixed, over vertices that move from
/// `start` to `end` in a step. Not for use by several threads at once, as boxes are made when
/// asked for; once they are made, any number may read them.
class CollisionSurface {
 public:
  CollisionSurface() = default;
  /// @param cluster_of_triangle  group of each triangle, >= 0 (such as the tetrahedron it lies in), or empty. Groups of
  ///                             more than 64 triangles are split; without groups, clusters have up to 32.
  /// Throws InputError for indices out of range, triangles that name a vertex twice and positions that are not finite.
  explicit CollisionSurface(const Surface& surface, std::span<const int> cluster_of_triangle = {});

  /// Of each vertex [m]; to be followed by refit(). Of a sparse() surface they hold only where they were asked for.
  mutable std::vector<Vec3> start, end;
  /// Boxes of the present start and end. Needed once for a surface that never moves; the constructor does it.
  void refit();
  /// The same for vertices that follow nodes, with bounds that are known otherwise: places the ends, unless the surface
  /// is sparse, and makes no box before it is asked for.
  void refit(const MotionBounds& bounds);
  /// Finds the edges that stay hollow(), as their faces move as one. Of a closed surface, where it was built.
  /// @param carrier  of each vertex: what it moves with affinely; none: all with the same, or not at all
  void findHollow(std::span<const int> carrier = {});
  /// From now on the vertices follow nodes: moveStart() and moveEnd() say where they are. Where a cluster has many
  /// vertices, it is bounded from its nodes, and its vertices are placed when something comes near.
  void follow(EmbeddingMap embedding);
  const EmbeddingMap& embedding() const { return embedding_; }
  /// @param nodes  positions, x y z of each [m]
  void moveStart(const VecX& nodes);
  void moveEnd(const VecX& nodes);
  /// A vertex that follows nodes is where they are, ahead of the others.
  void placeStart(int vertex) const { place(vertex, start_side_, start); }
  void placeEnd(int vertex) const { place(vertex, end_side_, end); }
  /// Of a triangle, where they start; places them.
  std::array<Vec3, 3> startCorners(int triangle) const {
    const auto& [a, b, c] = triangles_[static_cast<size_t>(triangle)];
    for (const int v : {a, b, c}) placeStart(v);
    return {start[static_cast<size_t>(a)], start[static_cast<size_t>(b)], start[static_cast<size_t>(c)]};
  }
  /// All of them, after refit(): boxes are then as tight as those of other surfaces.
  void placeAll();
  /// Vertices are placed when they are asked for: by leafBox(), and with all that share a triangle with them by
  /// triangleBoxes().
  bool sparse() const { return sparse_; }
  /// The ends become the starts, and the other way round.
  void swapEnds() {
    start.swap(end);
    std::swap(start_side_, end_side_);
  }
  /// As of the last refit().
  const MotionBounds& bounds() const { return bounds_; }

  const std::vector<Vec3>& rest() const { return rest_; }
  const std::vector<std::array<int, 3>>& triangles() const { return triangles_; }
  /// Vertices of each edge, the lower one first.
  const std::vector<std::array<int, 2>>& edges() const { return edges_; }
  /// Triangles at each edge; the second is -1 at a border. Of more than two the lowest two.
  const std::vector<std::array<int, 2>>& edgeTriangles() const { return edge_triangles_; }
  /// Edge i of a triangle runs from its corner i to corner i + 1.
  const std::vector<std::array<int, 3>>& triangleEdges() const { return triangle_edges_; }
  std::span<const int> trianglesAtVertex(int vertex) const {
    const auto v = static_cast<size_t>(vertex);
    return {vertex_triangles_.data() + vertex_offset_[v],
            static_cast<size_t>(vertex_offset_[v + 1] - vertex_offset_[v])};
  }
  /// The lowest triangle at a vertex owns it, likewise for edges: bit i for corner i, bit 3 + i for edge i.
  std::uint8_t owned(int triangle) const { return owned_[static_cast<size_t>(triangle)]; }
  bool ownsCorner(int triangle, int i) const { return (owned(triangle) >> i & 1) != 0; }
  bool ownsEdge(int triangle, int i) const { return (owned(triangle) >> (3 + i) & 1) != 0; }
  /// Box of a vertex on its way, as of the present start and end.
  MovingBox vertexBox(int vertex) const { return MovingBox::around(roundedStart(vertex), roundedEnd(vertex)); }
  /// Start and end to single precision: x, y, z, 0.
  const MovingBox::Corner& roundedStart(int vertex) const { return start_side_.rounded[static_cast<size_t>(vertex)]; }
  const MovingBox::Corner& roundedEnd(int vertex) const { return end_side_.rounded[static_cast<size_t>(vertex)]; }
  int ownerOfEdge(int edge) const { return edge_triangles_[static_cast<size_t>(edge)][0]; }
  /// Every edge has exactly two triangles, which run along it in opposite directions.
  bool closed() const { return closed_; }

  /// As findHollow() found it: the faces at this edge lie in one plane or rise from each other, so that of no line that
  /// leaves the solid there the edge is the nearest place.
  bool hollow(int edge) const { return !hollow_.empty() && hollow_[static_cast<size_t>(edge)] != 0; }

  /// At a time in [0, 1] of the step, between start and end.
  Vec3 position(int vertex, double time) const {
    const auto v = static_cast<size_t>(vertex);
    if (time <= 0) return start[v];
    if (time >= 1) return end[v];
    return (1 - time) * start[v] + time * end[v];
  }
  /// Twice the area long.
  Vec3 areaNormal(int triangle, double time) const;
  /// Sum of the unit normals of the edge's triangles.
  Vec3 edgeNormal(int edge, double time) const;
  /// From an edge to the opposite corner of a triangle at it, square to the edge.
  Vec3 inward(int edge, int triangle, double time) const;
  /// Sum of the unit normals of the vertex's triangles, weighted by their angles there.
  Vec3 cornerNormal(int vertex, double time) const;
  /// Outward unit normal at the point of a triangle with these barycentric weights: of the triangle, of both triangles
  /// at an edge, weighted by angle at a corner. Its sign tells the sides apart everywhere (Baerentzen, Aanaes 2005).
  /// Unit z where there is no area.
  Vec3 outwardNormal(int triangle, const std::array<double, 3>& weight, double time) const;
  /// Weights below this mean that a point is on the outline of its triangle.
  static constexpr double kOutline = 1e-7;

  struct Node {
    int right = -1;    ///< second child; the first follows its parent. -1: leaf
    int cluster = -1;  ///< of a leaf
  };
  const std::vector<Node>& nodes() const { return nodes_; }
  const MovingBox& nodeBox(int node) const {
    const auto i = static_cast<size_t>(node);
    if (node_made_at_[i] != refits_) makeNodeBox(node);
    return node_boxes_[i];
  }
  /// Of a leaf, around the vertices themselves.
  const MovingBox& leafBox(int node) const {
    if (!sparse_ || exact_at_ == refits_) return nodeBox(node);
    const auto c = static_cast<size_t>(nodes_[static_cast<size_t>(node)].cluster);
    if (leaf_made_at_[c] != refits_) makeLeafBox(static_cast<int>(c));
    return leaf_boxes_[c];
  }
  int clusters() const { return static_cast<int>(cluster_offset_.size()) - 1; }
  std::span<const int> trianglesOfCluster(int cluster) const {
    const auto c = static_cast<size_t>(cluster);
    return {order_.data() + cluster_offset_[c], static_cast<size_t>(cluster_offset_[c + 1] - cluster_offset_[c])};
  }
  std::span<const int> verticesOfCluster(int cluster) const {
    const auto c = static_cast<size_t>(cluster);
    return {cluster_vertices_.data() + cluster_vertex_offset_[c],
            static_cast<size_t>(cluster_vertex_offset_[c + 1] - cluster_vertex_offset_[c])};
  }
  /// In the order of trianglesOfCluster().
  std::span<const MovingBox> triangleBoxes(int cluster) const {
    const auto c = static_cast<size_t>(cluster);
    if (boxes_made_at_[c] != refits_ && claimTriangleBoxes(cluster)) makeTriangleBoxes(cluster);
    return {triangle_boxes_.data() + cluster_offset_[c],
            static_cast<size_t>(cluster_offset_[c + 1] - cluster_offset_[c])};
  }
  /// True once after each refit(): the caller then makes the boxes before anyone asks for them. Different clusters' may
  /// be made at the same time.
  bool claimTriangleBoxes(int cluster) const {
    if (std::exchange(boxes_made_at_[static_cast<size_t>(cluster)], refits_) == refits_) return false;
    if (sparse_) placeAround(cluster);
    return true;
  }
  void makeTriangleBoxes(int cluster) const;
  /// Mean size of the clusters' boxes in the rest shape [m].
  double clusterSize() const { return cluster_size_; }

 private:
  using Rounded = std::vector<MovingBox::Corner, Eigen::aligned_allocator<MovingBox::Corner>>;
  using Positions = std::vector<Eigen::Vector4d, Eigen::aligned_allocator<Eigen::Vector4d>>;
  /// The starts, or the ends, beside their exact positions.
  struct Side {
    mutable Rounded rounded;  // vertices to single precision
    Positions nodes;          // that they follow, padded
    Rounded rounded_nodes;
    float extent = 0;                              // no coordinate of a node is larger
    std::uint64_t moved_at = 0;                    // value of moves_
    mutable std::vector<std::uint64_t> placed_at;  // of a vertex of a sparse surface: moved_at
  };
  /// Vertices of a cluster that follow the same four nodes, each with a weight of middle +- half.
  struct Part {
    std::array<int, 4> node;
    std::array<float, 4> middle, half;
    float rest;      // 1 - sum of middle
    float rounding;  // of the sums, for coordinates of 1
  };
  static void put(int vertex, const Eigen::Vector4d& p, const Side& side, std::vector<Vec3>& exact) {
    exact[static_cast<size_t>(vertex)] = p.head<3>();
    side.rounded[static_cast<size_t>(vertex)] = p.cast<float>().array();
  }
  Eigen::Vector4d followed(int vertex, const Side& side) const {
    const int* node = embedding_.nodes().data() + 4 * vertex;
    const double* weight = embedding_.weights().data() + 4 * vertex;
    const auto at = [&](int k) -> const Eigen::Vector4d& { return side.nodes[static_cast<size_t>(node[k])]; };
    return weight[0] * at(0) + weight[1] * at(1) + weight[2] * at(2) + weight[3] * at(3);
  }
  void place(int vertex, const Side& side, std::vector<Vec3>& exact) const {
    if (side.nodes.empty()) return;
    if (sparse_) {
      auto& placed_at = side.placed_at[static_cast<size_t>(vertex)];
      if (placed_at == side.moved_at) return;
      placed_at = side.moved_at;
    }
    put(vertex, followed(vertex, side), side, exact);
  }
  void move(const VecX& nodes, Side& side);
  void placeAll(const Side& side, std::vector<Vec3>& exact) const;
  void buildParts();
  void buildRings();
  static void bound(const Part& part, const Side& side, MovingBox::Corner& low, MovingBox::Corner& negative_high);
  MovingBox boundOf(int cluster) const;
  void makeLeafBox(int cluster) const;
  void placeAround(int cluster) const;
  void buildEdges();
  void buildVertexTriangles();
  void buildClusters(std::span<const int> cluster_of_triangle);
  void splitCluster(const std::vector<Vec3>& centers, int first, int last, int limit);
  void buildClusterVertices();
  int buildTree(const std::vector<Vec3>& centers, std::vector<int>& clusters, int first, int last);
  template <class Indices>
  MovingBox boxOf(const Indices& vertices) const {
    MovingBox box = vertexBox(vertices[0]);
    for (size_t i = 1; i < vertices.size(); ++i) box.include(vertexBox(vertices[i]));
    return box;
  }
  void makeNodeBox(int node) const;

  Side start_side_, end_side_;
  EmbeddingMap embedding_;
  std::uint64_t moves_ = 0;
  bool ends_placed_ = true;  // of a surface that follows nodes and is not sparse
  bool sparse_ = false;
  std::vector<int> part_offset_{0};
  std::vector<Part> parts_;                 // of a cluster
  std::vector<int> ring_offset_{0}, ring_;  // of a cluster: vertices of all triangles at its vertices
  std::vector<Vec3> rest_;
  std::vector<std::array<int, 3>> triangles_;
  std::vector<std::array<int, 2>> edges_;
  std::vector<std::array<int, 2>> edge_triangles_;
  std::vector<std::array<int, 3>> triangle_edges_;
  std::vector<int> vertex_offset_, vertex_triangles_;
  std::vector<std::uint8_t> owned_;
  bool closed_ = false;
  std::vector<char> hollow_;  // edges

  std::vector<int> order_;  // triangles, cluster by cluster
  std::vector<int> cluster_offset_{0};
  std::vector<int> cluster_vertex_offset_{0}, cluster_vertices_;
  std::vector<Node> nodes_;  // preorder
  double cluster_size_ = 0;
  MotionBounds bounds_;

  std::uint64_t refits_ = 0;
  mutable std::vector<std::uint64_t> node_made_at_;  // of a node: value of refits_
  mutable std::vector<MovingBox> node_boxes_;
  mutable std::vector<std::uint64_t> boxes_made_at_;  // of a cluster: value of refits_
  mutable std::vector<MovingBox> triangle_boxes_;     // as order_
  std::uint64_t exact_at_ = 0;                        // value of refits_: nodes' boxes are around vertices
  mutable std::vector<std::uint64_t> leaf_made_at_;   // of a cluster of a sparse surface: value of refits_
  mutable std::vector<MovingBox> leaf_boxes_;
};

}  // namespace palpate
