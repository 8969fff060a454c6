#include "palpate/study/mesh_stiffness.h"

#include <numeric>

#include "palpate/common/error.h"
#include "palpate/fem/elastic_mesh.h"
#include "palpate/linear/sparse_cholesky.h"
#include "palpate/mesh/embedding_map.h"
#include "palpate/mesh/surface_measures.h"

namespace palpate {
namespace {

constexpr double kYoungsModulus = 1e3, kPoissonsRatio = 0.4;
constexpr double kEnds = 0.1;     // of the longest side
constexpr double kHolding = 1e3;  // times Young's modulus by that side: springs of the held end

VecX flat(const std::vector<Vec3>& points) {
  VecX x(static_cast<Eigen::Index>(3 * points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) x.segment<3>(static_cast<Eigen::Index>(3 * i)) = points[i];
  return x;
}

// Thirds of its triangles' areas, a vertex; sums to the surface's area.
std::vector<double> vertexAreas(const Surface& s) {
  std::vector<double> area(s.vertices.size(), 0.0);
  for (const auto& t : s.triangles) {
    const Vec3& a = s.vertices[t[0]];
    const double third = (s.vertices[t[1]] - a).cross(s.vertices[t[2]] - a).norm() / 6;
    for (const int v : t) area[v] += third;
  }
  return area;
}

// Weights, sum 1, of the surface's vertices in [low, high] along an axis; 0 elsewhere.
std::vector<double> endWeights(const Surface& surface, Eigen::Index axis, double low, double high) {
  std::vector<double> weights = vertexAreas(surface);
  for (std::size_t v = 0; v < weights.size(); ++v) {
    const double at = surface.vertices[v][axis];
    if (at < low || at > high) weights[v] = 0;
  }
  const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
  for (double& w : weights) w /= sum;
  return weights;
}

// a += spring * sum over the surface's vertices of weight * (interpolation)^T (interpolation)
void addSprings(const SimulationMesh& mesh, const std::vector<double>& weights, double spring,
                SymmetricBlockMatrix& a) {
  for (std::size_t v = 0; v < weights.size(); ++v) {
    if (weights[v] == 0) continue;
    const EmbeddedPoint& point = mesh.embedding[v];
    const auto& node = mesh.mesh.tetrahedra[point.tetrahedron];
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) {
        if (node[i] < node[j]) continue;
        a.block(a.find(node[i], node[j])).diagonal().array() +=
            spring * weights[v] * point.weights[i] * point.weights[j];
      }
    }
  }
}

}  // namespace

MeshStiffness meshStiffness(const Surface& surface, const EmbedOptions& options) {
  MeshStiffness out;
  const SimulationMesh mesh = embedSurface(surface, options, &out.embed);
  ElasticMesh elastic(mesh, Material{kYoungsModulus, kPoissonsRatio});
  std::vector<int> row(mesh.mesh.nodes.size());
  std::iota(row.begin(), row.end(), 0);
  SymmetricBlockMatrix a = elastic.pattern(row);
  elastic.assemble(0, 1, elastic.stateAt(flat(mesh.mesh.nodes)), a);

  const Bounds box = boundsOf(mesh.surface.vertices);
  Eigen::Index axis = 0;
  const double side = (box.high - box.low).maxCoeff(&axis);
  const auto held = endWeights(mesh.surface, axis, box.low[axis], box.low[axis] + kEnds * side);
  const auto pulled = endWeights(mesh.surface, axis, box.high[axis] - kEnds * side, box.high[axis]);
  addSprings(mesh, held, kHolding * kYoungsModulus * side, a);
  SparseCholesky factor;
  factor.analyze(a);
  if (!factor.factorize(a)) throw InputError(options.name, "", "has a mesh that cannot hold a load");
  const EmbeddingMap embedding(mesh.mesh, mesh.embedding);
  for (int d = 0; d < 3; ++d) {
    VecX traction = VecX::Zero(static_cast<Eigen::Index>(3 * pulled.size()));
    for (std::size_t v = 0; v < pulled.size(); ++v) traction[3 * v + d] = pulled[v];
    const VecX load = embedding.spread(traction);
    MatX displacement = load;
    factor.solve(displacement);
    out.stiffness[d] = 1 / load.dot(displacement.col(0));
  }
  return out;
}

}  // namespace palpate
