#include "palpate/study/mesh_stiffness.h"

#include <numeric>

#include "palpate/common/error.h"
#include "palpate/fem/elastic_mesh.h"
#include "palpate/linear/sparse_cholesky.h"
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

// Weights, sum 1, of the surface's vertices in [low, high] along an axis, by node: what they share out to each node.
struct End {
  std::vector<std::pair<int, double>> vertices;

  End(const SimulationMesh& mesh, const std::vector<double>& area, Eigen::Index axis, double low, double high) {
    double sum = 0;
    for (std::size_t v = 0; v < area.size(); ++v) {
      const double at = mesh.surface.vertices[v][axis];
      if (at < low || at > high) continue;
      vertices.emplace_back(static_cast<int>(v), area[v]);
      sum += area[v];
    }
    for (auto& [v, weight] : vertices) weight /= sum;
  }
};

// a += spring * sum over the end's vertices of weight * (interpolation)^T (interpolation)
void addSprings(const SimulationMesh& mesh, const End& end, double spring, SymmetricBlockMatrix& a) {
  for (const auto& [v, weight] : end.vertices) {
    const EmbeddedPoint& point = mesh.embedding[v];
    const auto& node = mesh.mesh.tetrahedra[point.tetrahedron];
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) {
        if (node[i] < node[j]) continue;
        a.block(a.find(node[i], node[j])).diagonal().array() += spring * weight * point.weights[i] * point.weights[j];
      }
    }
  }
}

// Row: the mean displacement of the end along an axis, of the nodes' displacements.
VecX meanOver(const SimulationMesh& mesh, const End& end, int axis) {
  VecX row = VecX::Zero(static_cast<Eigen::Index>(3 * mesh.mesh.nodes.size()));
  for (const auto& [v, weight] : end.vertices) {
    const EmbeddedPoint& point = mesh.embedding[v];
    for (int k = 0; k < 4; ++k) row[3 * mesh.mesh.tetrahedra[point.tetrahedron][k] + axis] += weight * point.weights[k];
  }
  return row;
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
  const std::vector<double> area = vertexAreas(mesh.surface);
  const End held(mesh, area, axis, box.low[axis], box.low[axis] + kEnds * side);
  const End pulled(mesh, area, axis, box.high[axis] - kEnds * side, box.high[axis]);
  addSprings(mesh, held, kHolding * kYoungsModulus * side, a);
  SparseCholesky factor;
  factor.analyze(a);
  if (!factor.factorize(a)) throw InputError(options.name, "", "has a mesh that cannot hold a load");
  for (int d = 0; d < 3; ++d) {
    const VecX load = meanOver(mesh, pulled, d);
    MatX displacement = load;
    factor.solve(displacement);
    out.stiffness[d] = 1 / load.dot(displacement.col(0));
  }
  return out;
}

}  // namespace palpate
