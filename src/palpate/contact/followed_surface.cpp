// Surfaces whose vertices follow nodes: where these are, and what bounds them before they are placed.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "palpate/common/parallel.h"
#include "palpate/contact/collision_surface.h"

namespace palpate {
namespace {

// Fewer vertices are placed in less time than it takes to bound them.
constexpr double kVerticesOfPart = 8;

float roundedUp(double x) {
  const auto f = static_cast<float>(x);
  return static_cast<double>(f) < x ? std::nextafter(f, std::numeric_limits<float>::infinity()) : f;
}

}  // namespace

void CollisionSurface::follow(EmbeddingMap embedding) {
  embedding_ = std::move(embedding);
  ends_placed_ = true;
  buildParts();
  sparse_ = static_cast<double>(cluster_vertices_.size()) > kVerticesOfPart * static_cast<double>(parts_.size());
  if (!sparse_) {
    part_offset_.assign(1, 0);
    parts_.clear();
    return;
  }
  buildRings();
  for (Side* side : {&start_side_, &end_side_}) side->placed_at.assign(start.size(), 0);
  leaf_made_at_.assign(static_cast<size_t>(clusters()), 0);
  leaf_boxes_.resize(static_cast<size_t>(clusters()));
}

void CollisionSurface::buildParts() {
  std::vector<int> vertices;
  part_offset_.assign(1, 0);
  parts_.clear();
  const auto nodesOf = [&](int v) { return embedding_.nodes().data() + 4 * v; };
  const auto weightsOf = [&](int v) { return embedding_.weights().data() + 4 * v; };
  for (int c = 0; c < clusters(); ++c) {
    const auto all = verticesOfCluster(c);
    vertices.assign(all.begin(), all.end());
    std::stable_sort(vertices.begin(), vertices.end(), [&](int v, int w) {
      return std::lexicographical_compare(nodesOf(v), nodesOf(v) + 4, nodesOf(w), nodesOf(w) + 4);
    });
    for (size_t first = 0, last = 0; first < vertices.size(); first = last) {
      const int* node = nodesOf(vertices[first]);
      while (last < vertices.size() && std::equal(node, node + 4, nodesOf(vertices[last]))) ++last;
      Part part{};
      double size = 1, rest = 1, off = 0;
      for (size_t k = 0; k < 4; ++k) {
        double low = std::numeric_limits<double>::infinity(), high = -low, half = 0;
        for (size_t i = first; i < last; ++i) {
          const double w = weightsOf(vertices[i])[k];
          low = std::min(low, w);
          high = std::max(high, w);
        }
        const auto middle = static_cast<float>(0.5 * (low + high));
        half = std::max(high - static_cast<double>(middle), static_cast<double>(middle) - low);
        part.node[k] = node[k];
        part.middle[k] = middle;
        part.half[k] = roundedUp(half);
        rest -= static_cast<double>(middle);
        size += std::abs(static_cast<double>(middle)) + half;
      }
      for (size_t i = first; i < last; ++i) {
        const double* w = weightsOf(vertices[i]);
        off = std::max(off, std::abs(w[0] + w[1] + w[2] + w[3] - 1));
      }
      part.rest = static_cast<float>(rest);
      constexpr double kRounding = 2e-6;  // more than ten roundings to single precision
      part.rounding = roundedUp(kRounding * (size + std::abs(rest)) + 2 * off);
      parts_.push_back(part);
    }
    part_offset_.push_back(static_cast<int>(parts_.size()));
  }
}

// What the tests of a cluster's features look at: faces at their vertices, and no others.
void CollisionSurface::buildRings() {
  std::vector<int> vertices;
  ring_offset_.assign(1, 0);
  ring_.clear();
  for (int c = 0; c < clusters(); ++c) {
    vertices.clear();
    for (const int v : verticesOfCluster(c))
      for (const int t : trianglesAtVertex(v))
        for (const int w : triangles_[static_cast<size_t>(t)]) vertices.push_back(w);
    std::sort(vertices.begin(), vertices.end());
    vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
    ring_.insert(ring_.end(), vertices.begin(), vertices.end());
    ring_offset_.push_back(static_cast<int>(ring_.size()));
  }
}

void CollisionSurface::move(const VecX& nodes, Side& side) {
  const Eigen::Index n = nodes.size() / 3;
  side.nodes.resize(static_cast<size_t>(n));
  for (Eigen::Index i = 0; i < n; ++i) side.nodes[static_cast<size_t>(i)] << nodes.segment<3>(3 * i), 0.0;
  side.moved_at = ++moves_;
  if (!sparse_) return;
  side.rounded_nodes.resize(side.nodes.size());
  for (size_t i = 0; i < side.nodes.size(); ++i) side.rounded_nodes[i] = side.nodes[i].cast<float>().array();
  side.extent = roundedUp(nodes.lpNorm<Eigen::Infinity>());
}

void CollisionSurface::moveStart(const VecX& nodes) {
  move(nodes, start_side_);
  if (!sparse_) placeAll(start_side_, start);
}

void CollisionSurface::moveEnd(const VecX& nodes) {
  move(nodes, end_side_);
  ends_placed_ = false;
}

void CollisionSurface::placeAll(const Side& side, std::vector<Vec3>& exact) const {
  constexpr int kLeast = 512, kMostParts = 32;
  const int count = embedding_.points(), parts = std::min(1 + count / kLeast, kMostParts);
  parallelRanges(parts, count, [&](int begin, int end_of_part) {
    for (int v = begin; v < end_of_part; ++v) place(v, side, exact);
  });
}

void CollisionSurface::placeAll() {
  if (sparse_) placeAll(start_side_, start);
  if (sparse_ || !ends_placed_) placeAll(end_side_, end);
  ends_placed_ = true;
  if (sparse_) exact_at_ = ++refits_;
}

// A weight of middle + d moves a vertex by d (x - c), and the d of all four sum up to `rest`, whose share is at c: any
// point will do, the middle of the nodes is a good one. This holds for weights below 0 and above 1, too.
void CollisionSurface::bound(const Part& part, const Side& side, MovingBox::Corner& low,
                             MovingBox::Corner& negative_high) {
  using Corner = MovingBox::Corner;
  const auto at = [&](size_t k) -> const Corner& { return side.rounded_nodes[static_cast<size_t>(part.node[k])]; };
  const Corner c = 0.25f * (at(0) + at(1) + at(2) + at(3));
  const float rounding = part.rounding * side.extent;
  Corner middle = part.rest * c, reach(rounding, rounding, rounding, 0.0f);
  for (size_t k = 0; k < 4; ++k) {
    middle += part.middle[k] * at(k);
    reach += part.half[k] * (at(k) - c).abs();
  }
  low = low.min(middle - reach);
  negative_high = negative_high.min(-middle - reach);
}

MovingBox CollisionSurface::boundOf(int cluster) const {
  const auto c = static_cast<size_t>(cluster);
  constexpr float kFar = std::numeric_limits<float>::max();
  const MovingBox::Corner none(kFar, kFar, kFar, 0.0f);
  MovingBox box{none, none, none, none};
  for (auto i = static_cast<size_t>(part_offset_[c]); i < static_cast<size_t>(part_offset_[c + 1]); ++i) {
    bound(parts_[i], start_side_, box.start_low, box.start_negative_high);
    bound(parts_[i], end_side_, box.end_low, box.end_negative_high);
  }
  return box;
}

void CollisionSurface::makeLeafBox(int cluster) const {
  const auto c = static_cast<size_t>(cluster);
  leaf_made_at_[c] = refits_;
  for (const int v : verticesOfCluster(cluster)) {
    placeStart(v);
    placeEnd(v);
  }
  leaf_boxes_[c] = boxOf(verticesOfCluster(cluster));
}

void CollisionSurface::placeAround(int cluster) const {
  const auto c = static_cast<size_t>(cluster);
  for (auto i = static_cast<size_t>(ring_offset_[c]); i < static_cast<size_t>(ring_offset_[c + 1]); ++i) {
    placeStart(ring_[i]);
    placeEnd(ring_[i]);
  }
}

}  // namespace palpate
