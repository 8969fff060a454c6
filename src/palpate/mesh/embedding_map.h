#pragma once

#include <vector>

#include "palpate/mesh/types.h"

namespace palpate {

/// Node indices and weights of embedded points in flat arrays, for every step: positions out, forces back.
/// spread is the transpose of interpolate, so virtual work is conserved.
class EmbeddingMap {
 public:
  EmbeddingMap() = default;
  EmbeddingMap(const TetrahedralMesh& mesh, const std::vector<EmbeddedPoint>& points);

  int points() const { return static_cast<int>(nodes_.size() / 4); }
  int meshNodes() const { return mesh_nodes_; }
  /// Four node indices and four weights a point.
  const std::vector<int>& nodes() const { return nodes_; }
  const std::vector<double>& weights() const { return weights_; }

  /// point_values (points() x 3) = W node_values (meshNodes() x 3); x y z of each in turn.
  void interpolate(const double* node_values, double* point_values) const;
  /// node_values += W^T point_values.
  void spread(const double* point_values, double* node_values) const;

  std::vector<Vec3> interpolate(const std::vector<Vec3>& node_values) const;
  std::vector<Vec3> spread(const std::vector<Vec3>& point_values) const;
  VecX interpolate(const VecX& node_values) const;
  VecX spread(const VecX& point_values) const;

 private:
  int mesh_nodes_ = 0;
  std::vector<int> nodes_;
  std::vector<double> weights_;
};

}  // namespace palpate
