#include "palpate/simulation/body_model.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/mesh/surface_measures.h"

namespace palpate {
namespace {

/// A regular tetrahedron around the surface, whose nodes carry the surface's vertices.
SimulationMesh tetrahedronAround(const Surface& surface, const Vec3& center, double side) {
  SimulationMesh mesh;
  mesh.surface = surface;
  for (const Vec3& corner : {Vec3(1, 1, 1), Vec3(1, -1, -1), Vec3(-1, 1, -1), Vec3(-1, -1, 1)}) {
    mesh.mesh.nodes.push_back(center + side * corner);
  }
  mesh.mesh.tetrahedra = {{0, 2, 1, 3}};
  mesh.fill = {1.0};
  mesh.share = {{0.25, 0.25, 0.25, 0.25}};
  mesh.embedding.reserve(surface.vertices.size());
  for (const Vec3& p : surface.vertices) {
    // of a regular tetrahedron centered on c with corners side * d_k: w_k = 1/4 + d_k . (p - c) / (4 side)
    const Vec3 r = (p - center) / (4.0 * side);
    EmbeddedPoint point;
    point.tetrahedron = 0;
    for (int k = 0; k < 4; ++k) {
      const Vec3 d = (mesh.mesh.nodes[mesh.mesh.tetrahedra[0][k]] - center) / side;
      point.weights[k] = 0.25 + d.dot(r);
    }
    mesh.embedding.push_back(point);
  }
  return mesh;
}

}  // namespace

BodyModel::BodyModel(std::string name, SimulationMesh mesh, const Material& material, double friction,
                     const Vec6& velocity, const std::vector<ElementMaterial>& parts)
    : name_(std::move(name)),
      mesh_(std::move(mesh)),
      fem_(mesh_, material, parts),
      finder_(mesh_),
      friction_(friction),
      velocity_(velocity) {
  const int n = fem_.nodes();
  row_.resize(n);
  free_.resize(n);
  for (int i = 0; i < n; ++i) row_[i] = free_[i] = i;
  attached_.assign(n, -1);
  pattern_ = fem_.pattern(row_);
}

BodyModel BodyModel::rigid(std::string name, const Surface& surface, double density, double friction,
                           const Vec6& velocity, double damping_alpha) {
  const MassProperties solid = surfaceMassProperties(surface, density, name);
  const Vec3 center = solid.center_of_mass;
  double radius = 0;
  for (const Vec3& p : surface.vertices) radius = std::max(radius, (p - center).norm());
  const double side = radius / std::sqrt(3.0);
  SimulationMesh mesh = tetrahedronAround(surface, center, side);
  Material material;  // never strained: all that counts is the mass
  material.youngs_modulus = 1.0;
  material.poisson_ratio = 0.0;
  material.density = solid.mass / (8.0 / 3.0 * side * side * side);
  material.damping_alpha = damping_alpha;
  material.damping_beta = 0.0;
  Handle frame;
  frame.name = name;
  frame.nodes = {0, 1, 2, 3};
  for (const Vec3& p : mesh.mesh.nodes) frame.offsets.push_back(p - center);
  frame.mass = frame.attached_mass = solid.mass;
  frame.inertia = frame.attached_inertia = solid.inertia;
  frame.start.pose.position = center;
  frame.start.twist = velocity;
  BodyModel body(std::move(name), std::move(mesh), material, friction, velocity);
  body.attach(frame);
  return body;
}

void BodyModel::hold(const Handle& handle) {
  attach(handle);
  held_ = true;
  if (free_.empty()) throw InputError("handle " + handle.name, "region", "holds every node: nothing is left to deform");
  if (boundary_.empty())
    throw InputError("handle " + handle.name, "region", "is not connected to the rest of the tool");
}

void BodyModel::attach(const Handle& handle) {
  handle_ = handle;
  free_.clear();
  boundary_.clear();
  for (std::size_t k = 0; k < handle.nodes.size(); ++k) attached_[handle.nodes[k]] = static_cast<int>(k);
  for (int i = 0; i < nodes(); ++i) {
    row_[i] = attached_[i] >= 0 ? -1 : static_cast<int>(free_.size());
    if (row_[i] >= 0) free_.push_back(i);
  }
  for (int e = 0; e < static_cast<int>(fem_.elements().size()); ++e) {
    const auto& node = fem_.elements()[e].node;
    const auto count = std::count_if(node.begin(), node.end(), [&](int n) { return attached_[n] >= 0; });
    if (count > 0 && count < 4) boundary_.push_back(e);
  }
  pattern_ = fem_.pattern(row_);
}

double BodyModel::totalMass() const {
  return fem_.mass().sum() + (framed() ? handle_->mass - handle_->attached_mass : 0.0);
}

BodyState BodyModel::startState() const {
  BodyState state;
  const int n = nodes();
  state.positions.resize(3 * n);
  state.velocities.resize(3 * n);
  Vec3 center = Vec3::Zero();
  for (int i = 0; i < n; ++i) center += fem_.mass()[i] * mesh_.mesh.nodes[i] / fem_.mass().sum();
  for (int i = 0; i < n; ++i) {
    state.positions.segment<3>(3 * i) = mesh_.mesh.nodes[i];
    state.velocities.segment<3>(3 * i) =
        velocity_.head<3>() + Vec3(velocity_.tail<3>()).cross(mesh_.mesh.nodes[i] - center);
  }
  state.elastic = fem_.stateAt(state.positions);
  if (framed()) setHandle(handle_->start, state);
  return state;
}

void BodyModel::setHandle(const HandleState& handle, BodyState& state) const {
  state.handle = handle;
  for (std::size_t k = 0; k < handle_->nodes.size(); ++k) {
    state.positions.segment<3>(3 * handle_->nodes[k]) = handle_->nodePosition(static_cast<int>(k), handle.pose);
    state.velocities.segment<3>(3 * handle_->nodes[k]) = handle_->nodeVelocity(static_cast<int>(k), handle);
  }
}

VecX BodyModel::placesInHandle(const BodyState& state) const {
  const Mat3 rt = state.handle.pose.matrix().transpose();
  VecX places(3 * nodes());
  for (const int i : free_) {
    places.segment<3>(3 * i) = rt * (state.positions.segment<3>(3 * i) - state.handle.pose.position);
  }
  for (std::size_t k = 0; k < handle_->nodes.size(); ++k) {
    places.segment<3>(3 * handle_->nodes[k]) = handle_->offsets[k];
  }
  return places;
}

double BodyModel::kineticEnergy(const BodyState& state) const {
  double sum = 0;
  for (int i = 0; i < nodes(); ++i) {
    if (attached_[i] < 0) sum += 0.5 * fem_.mass()[i] * state.velocities.segment<3>(3 * i).squaredNorm();
  }
  if (framed()) {
    sum += 0.5 * state.handle.twist.dot(handle_->massMatrix(state.handle.pose) * state.handle.twist);
  }
  return sum;
}

}  // namespace palpate
