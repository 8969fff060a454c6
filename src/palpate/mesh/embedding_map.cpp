#include "palpate/mesh/embedding_map.h"

#include <stdexcept>

namespace palpate {

static_assert(sizeof(Vec3) == 3 * sizeof(double));

EmbeddingMap::EmbeddingMap(const TetrahedralMesh& mesh, const std::vector<EmbeddedPoint>& points)
    : mesh_nodes_(static_cast<int>(mesh.nodes.size())) {
  nodes_.reserve(4 * points.size());
  weights_.reserve(4 * points.size());
  for (const EmbeddedPoint& point : points) {
    const auto& t = mesh.tetrahedra.at(static_cast<size_t>(point.tetrahedron));
    nodes_.insert(nodes_.end(), t.begin(), t.end());
    weights_.insert(weights_.end(), point.weights.begin(), point.weights.end());
  }
}

void EmbeddingMap::interpolate(const double* node_values, double* point_values) const {
  const int* node = nodes_.data();
  const double* weight = weights_.data();
  for (double *out = point_values, *end = out + 3 * points(); out != end; out += 3, node += 4, weight += 4) {
    double x = 0, y = 0, z = 0;
    for (int k = 0; k < 4; ++k) {
      const double* value = node_values + 3 * node[k];
      x += weight[k] * value[0];
      y += weight[k] * value[1];
      z += weight[k] * value[2];
    }
    out[0] = x;
    out[1] = y;
    out[2] = z;
  }
}

void EmbeddingMap::spread(const double* point_values, double* node_values) const {
  const int* node = nodes_.data();
  const double* weight = weights_.data();
  for (const double* in = point_values, *end = in + 3 * points(); in != end; in += 3, node += 4, weight += 4) {
    for (int k = 0; k < 4; ++k) {
      double* value = node_values + 3 * node[k];
      value[0] += weight[k] * in[0];
      value[1] += weight[k] * in[1];
      value[2] += weight[k] * in[2];
    }
  }
}

namespace {
void requireSize(size_t given, int wanted) {
  if (given != static_cast<size_t>(wanted)) throw std::invalid_argument("EmbeddingMap: wrong number of values");
}
}  // namespace

std::vector<Vec3> EmbeddingMap::interpolate(const std::vector<Vec3>& node_values) const {
  requireSize(node_values.size(), mesh_nodes_);
  std::vector<Vec3> out(static_cast<size_t>(points()));
  if (!out.empty()) interpolate(node_values.data()->data(), out.data()->data());
  return out;
}

std::vector<Vec3> EmbeddingMap::spread(const std::vector<Vec3>& point_values) const {
  requireSize(point_values.size(), points());
  std::vector<Vec3> out(static_cast<size_t>(mesh_nodes_), Vec3::Zero());
  if (!point_values.empty()) spread(point_values.data()->data(), out.data()->data());
  return out;
}

VecX EmbeddingMap::interpolate(const VecX& node_values) const {
  requireSize(static_cast<size_t>(node_values.size()), 3 * mesh_nodes_);
  VecX out(3 * points());
  interpolate(node_values.data(), out.data());
  return out;
}

VecX EmbeddingMap::spread(const VecX& point_values) const {
  requireSize(static_cast<size_t>(point_values.size()), 3 * points());
  VecX out = VecX::Zero(3 * mesh_nodes_);
  spread(point_values.data(), out.data());
  return out;
}

}  // namespace palpate
