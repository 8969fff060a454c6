#include "palpate/study/examiner.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "palpate/contact/neighbor_exclusion.h"
#include "palpate/mesh/mesh_quality.h"

namespace palpate {
namespace {

bool isFinite(const World& world) {
  for (int i = 0; i < world.bodies(); ++i) {
    if (!world.body(i).state.isFinite()) return false;
  }
  return true;
}

}  // namespace

int invertedTetrahedra(const TetrahedralMesh& mesh, const VecX& positions) {
  return static_cast<int>(std::count_if(mesh.tetrahedra.begin(), mesh.tetrahedra.end(),
                                        [&](const auto& t) { return isTurnedOver(t, positions); }));
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

void Examiner::examineOverlaps(const World& world, Examination& out) {
  for (std::size_t b = 1; b < surfaces_.size(); ++b) {
    for (std::size_t a = 0; a < std::min(b, own_.size()); ++a) {
      points_.clear();
      findOverlaps(surfaces_[a], surfaces_[b], points_);
      const PairExclusion* glued = b < own_.size() ? world.leftOut(static_cast<int>(a), static_cast<int>(b)) : nullptr;
      for (const OverlapPoint& p : points_) {
        if (glued != nullptr && glued->excludes(p)) continue;
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
  examineOverlaps(world, out);
  for (int i = 0; i < world.bodies(); ++i) {
    const Body body = world.body(i);
    if (!body.model.isRigid()) out.inverted += invertedTetrahedra(body.model.mesh().mesh, body.state.positions);
    if (own_[i].self) examineSelf(i, out);
  }
  return out;
}

}  // namespace palpate
