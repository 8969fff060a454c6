#include "palpate/study/examiner.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "palpate/contact/neighbor_exclusion.h"

namespace palpate {
namespace {

constexpr double kRounding = 1e-9;  // of a triangle's size

using Triangle = std::array<Vec3, 3>;

Triangle triangleAt(const CollisionSurface& s, int t) {
  const auto& v = s.triangles()[static_cast<std::size_t>(t)];
  return {s.start[v[0]], s.start[v[1]], s.start[v[2]]};
}

bool shareVertex(const CollisionSurface& s, int t, int u) {
  for (const int v : s.triangles()[static_cast<std::size_t>(t)])
    for (const int w : s.triangles()[static_cast<std::size_t>(u)])
      if (v == w) return true;
  return false;
}

bool boxesMeet(const MovingBox& p, const MovingBox& q) {
  return (p.start_low + q.start_negative_high).max(p.start_negative_high + q.start_low).maxCoeff() <= 0;
}

// Whether a segment passes through a triangle, from one side of its plane to the other.
bool passes(const Vec3& p, const Vec3& q, double height_p, double height_q, const Triangle& t) {
  if (!((height_p < 0 && height_q > 0) || (height_p > 0 && height_q < 0))) return false;
  const Vec3 d = q - p, a = t[0] - p, b = t[1] - p, c = t[2] - p;
  const double wa = d.dot(b.cross(c)), wb = d.dot(c.cross(a)), wc = d.dot(a.cross(b));
  return (wa >= 0 && wb >= 0 && wc >= 0) || (wa <= 0 && wb <= 0 && wc <= 0);
}

// Heights of the corners of u over the plane of t, times twice its area; what may be rounding is zero, as parts of a
// flat face would else cross. @returns whether they are on both sides
bool straddles(const Triangle& t, const Triangle& u, std::array<double, 3>& height) {
  const Vec3 n = (t[1] - t[0]).cross(t[2] - t[0]);
  const double area = n.norm(), rounding = kRounding * area * std::sqrt(area);
  for (int k = 0; k < 3; ++k) {
    height[k] = n.dot(u[k] - t[0]);
    if (std::abs(height[k]) < rounding) height[k] = 0;
  }
  return std::min({height[0], height[1], height[2]}) < 0 && std::max({height[0], height[1], height[2]}) > 0;
}

bool anyEdgePasses(const Triangle& u, const std::array<double, 3>& height, const Triangle& t) {
  for (int k = 0; k < 3; ++k) {
    const int l = (k + 1) % 3;
    if (passes(u[k], u[l], height[k], height[l], t)) return true;
  }
  return false;
}

bool intersect(const Triangle& t, const Triangle& u) {
  std::array<double, 3> of_u{}, of_t{};
  return straddles(t, u, of_u) && straddles(u, t, of_t) && (anyEdgePasses(u, of_u, t) || anyEdgePasses(t, of_t, u));
}

// Of two clusters, or of one with itself.
void intersectClusters(const CollisionSurface& s, int c, int d, std::vector<std::array<int, 2>>& out) {
  const auto boxes_c = s.triangleBoxes(c), boxes_d = s.triangleBoxes(d);
  const auto triangles_c = s.trianglesOfCluster(c), triangles_d = s.trianglesOfCluster(d);
  MovingBox around = boxes_d.front();
  for (const MovingBox& box : boxes_d) around.include(box);
  for (std::size_t i = 0; i < boxes_c.size(); ++i) {
    if (!boxesMeet(boxes_c[i], around)) continue;
    for (std::size_t j = c == d ? i + 1 : 0; j < boxes_d.size(); ++j) {
      const int t = triangles_c[i], u = triangles_d[j];
      if (!boxesMeet(boxes_c[i], boxes_d[j]) || shareVertex(s, t, u)) continue;
      if (intersect(triangleAt(s, t), triangleAt(s, u))) out.push_back({std::min(t, u), std::max(t, u)});
    }
  }
}

bool isFinite(const World& world) {
  for (int i = 0; i < world.bodies(); ++i) {
    if (!world.body(i).state.isFinite()) return false;
  }
  return true;
}

}  // namespace

void findSelfIntersections(const CollisionSurface& surface, std::vector<std::array<int, 2>>& out) {
  const auto& nodes = surface.nodes();
  if (nodes.empty()) return;
  std::vector<std::pair<int, int>> stack{{0, 0}};
  while (!stack.empty()) {
    const auto [i, j] = stack.back();
    stack.pop_back();
    const auto &a = nodes[static_cast<std::size_t>(i)], &b = nodes[static_cast<std::size_t>(j)];
    if (i != j && !boxesMeet(surface.nodeBox(i), surface.nodeBox(j))) continue;
    if (a.right < 0 && b.right < 0) {
      intersectClusters(surface, a.cluster, b.cluster, out);
    } else if (i == j) {
      stack.emplace_back(i + 1, i + 1);
      stack.emplace_back(a.right, a.right);
      stack.emplace_back(i + 1, a.right);
    } else if (b.right < 0 || (a.right >= 0 && surface.nodeBox(i).size() >= surface.nodeBox(j).size())) {
      stack.emplace_back(i + 1, j);
      stack.emplace_back(a.right, j);
    } else {
      stack.emplace_back(i, j + 1);
      stack.emplace_back(i, b.right);
    }
  }
}

int invertedTetrahedra(const TetrahedralMesh& mesh, const VecX& positions) {
  int count = 0;
  for (const auto& t : mesh.tetrahedra) {
    const auto at = [&](int k) { return positions.segment<3>(3 * t[k]); };
    const Vec3 u = at(1) - at(0), v = at(2) - at(0), w = at(3) - at(0);
    if (!(u.cross(v).dot(w) > 0)) ++count;
  }
  return count;
}

Examiner::Examiner(const World& world, double inside, const std::vector<int>& crossable) : inside_(inside) {
  for (int i = 0; i < world.bodies(); ++i) {
    const BodyModel& model = world.body(i).model;
    const SimulationMesh& mesh = model.mesh();
    surfaces_.emplace_back(mesh.surface);
    const bool may = std::find(crossable.begin(), crossable.end(), i) != crossable.end();
    Own own{EmbeddingMap(mesh.mesh, mesh.embedding), !model.isRigid() && !may, {}, {}};
    if (own.self) {
      std::vector<int> tetrahedron;
      for (const EmbeddedPoint& p : mesh.embedding) tetrahedron.push_back(p.tetrahedron);
      own.neighbors = excludeNeighbors(surfaces_.back(), tetrahedron, mesh.mesh);
    }
    own_.push_back(std::move(own));
  }
  for (const Obstacle& o : world.obstacles) {
    if (const std::optional<Surface> s = surfaceOf(o)) surfaces_.emplace_back(*s);
  }
  place(world);
  for (std::size_t i = 0; i < own_.size(); ++i) {
    if (!own_[i].self) continue;
    findSelfIntersections(surfaces_[i], own_[i].from_start);
    std::sort(own_[i].from_start.begin(), own_[i].from_start.end());
  }
}

void Examiner::place(const World& world) {
  for (int i = 0; i < world.bodies(); ++i) {
    CollisionSurface& s = surfaces_[i];
    own_[i].embedding.interpolate(world.body(i).state.positions.data(), s.start.data()->data());
    s.end = s.start;
    s.refit();
  }
}

void Examiner::examinePlanes(const World& world, Examination& out) const {
  for (const Obstacle& o : world.obstacles) {
    const auto* plane = std::get_if<PlaneShape>(&o.shape);
    if (plane == nullptr) continue;
    for (std::size_t i = 0; i < own_.size(); ++i) {
      for (const Vec3& p : surfaces_[i].start) {
        const double depth = -gap(*plane, p);
        out.depth = std::max(out.depth, depth);
        if (depth > inside_) ++out.wrong_side;
      }
    }
  }
}

void Examiner::examineOverlaps(Examination& out) {
  for (std::size_t b = 1; b < surfaces_.size(); ++b) {
    for (std::size_t a = 0; a < std::min(b, own_.size()); ++a) {
      points_.clear();
      findOverlaps(surfaces_[a], surfaces_[b], points_);
      for (const OverlapPoint& p : points_) {
        out.depth = std::max(out.depth, p.depth);
        if (p.vertex[1] < 0 && p.depth > inside_) ++out.wrong_side;
      }
    }
  }
}

void Examiner::examineSelf(int body, Examination& out) {
  const CollisionSurface& surface = surfaces_[body];
  const auto& known = own_[body].from_start;
  pairs_.clear();
  findSelfIntersections(surface, pairs_);
  for (const auto& pair : pairs_) {
    if (std::binary_search(known.begin(), known.end(), pair)) continue;
    ++out.self_intersections;
    if (!own_[body].neighbors.excludes(surface.triangles()[pair[0]], surface.triangles()[pair[1]])) ++out.passed;
  }
}

Examination Examiner::examine(const World& world) {
  Examination out;
  out.finite = isFinite(world);
  if (!out.finite) return out;
  place(world);
  examinePlanes(world, out);
  examineOverlaps(out);
  for (int i = 0; i < world.bodies(); ++i) {
    const Body body = world.body(i);
    if (!body.model.isRigid()) out.inverted += invertedTetrahedra(body.model.mesh().mesh, body.state.positions);
    if (own_[i].self) examineSelf(i, out);
  }
  return out;
}

}  // namespace palpate
