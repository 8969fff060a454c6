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
  attached_.assign(fem_.nodes(), -1);
  fixed_.assign(fem_.nodes(), 0);
  glued_.assign(fem_.nodes(), 0);
  row_.resize(fem_.nodes());
  number();
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
  body.attachTo(frame);
  return body;
}

void BodyModel::holdRigid(const std::string& name, double own_mass, const Vec3& own_inertia, const Quat& rotation) {
  Handle& handle = *handle_;
  const Mat3 turn = rotation.normalized().toRotationMatrix();
  handle.name = name;
  for (Vec3& offset : handle.offsets) offset = (turn.transpose() * offset).eval();
  handle.start.pose.rotation = rotation.normalized();
  handle.attached_inertia = turn.transpose() * handle.attached_inertia * turn;
  addOwnMass(own_mass, own_inertia, kLeastHandleRadius, handle);
  held_ = true;
}

void BodyModel::hold(const Handle& handle) {
  for (const int n : handle.nodes) {
    if (fixed_[n] != 0) throw InputError("handle " + handle.name, "region", "holds nodes that are fixed to the world");
    if (glued_[n] != 0) throw InputError("handle " + handle.name, "region", "holds nodes that are glued to a body");
  }
  attachTo(handle);
  held_ = true;
  if (free_.empty()) throw InputError("handle " + handle.name, "region", "holds every node: nothing is left to deform");
  if (boundary_.empty())
    throw InputError("handle " + handle.name, "region", "is not connected to the rest of the tool");
}

void BodyModel::attachTo(const Handle& handle) {
  handle_ = handle;
  for (std::size_t k = 0; k < handle.nodes.size(); ++k) attached_[handle.nodes[k]] = static_cast<int>(k);
  number();
}

void BodyModel::attach(Attachment attachment) {
  const auto fail = [&](const std::string& cause) {
    throw InputError(name_ + ": attachment " + attachment.name, "region", cause);
  };
  for (std::size_t k = 0; k < attachment.nodes.size(); ++k) {
    const int n = attachment.nodes[k];
    if (attachment.stiffness.size() > 0) {
      if (spring_stiffness_.size() == 0) {
        spring_stiffness_.setZero(nodes());
        spring_damping_.setZero(nodes());
      }
      spring_stiffness_[n] += attachment.stiffness[static_cast<Eigen::Index>(k)];
      spring_damping_[n] += attachment.damping[static_cast<Eigen::Index>(k)];
      continue;
    }
    const std::string does = attachment.glued ? "glues" : "fixes";
    if (fixed_[n] != 0) fail(does + " nodes that another attachment fixes");
    if (glued_[n] != 0) fail(does + " nodes that another attachment glues");
    if (attached_[n] >= 0) fail(does + " nodes that the handle holds");
    (attachment.glued ? glued_ : fixed_)[n] = 1;
  }
  number();
  if (free_.empty()) fail("fixes every node: nothing is left to deform");
  attachment.middle.setZero();
  for (const int n : attachment.nodes) attachment.middle += mesh_.mesh.nodes[n];
  attachment.middle /= static_cast<double>(attachment.nodes.size());
  driven_ = driven_ || attachment.motion;
  glues_ = glues_ || attachment.glued;
  attachments_.push_back(std::move(attachment));
}

// Free nodes get rows; elements are sorted by what holds their nodes.
void BodyModel::number() {
  free_.clear();
  boundary_.clear();
  fixed_elements_.clear();
  for (int i = 0; i < nodes(); ++i) {
    row_[i] = attached_[i] >= 0 || fixed_[i] != 0 ? -1 : static_cast<int>(free_.size());
    if (row_[i] >= 0) free_.push_back(i);
  }
  for (int e = 0; e < static_cast<int>(fem_.elements().size()); ++e) {
    const auto& node = fem_.elements()[e].node;
    const auto count = std::count_if(node.begin(), node.end(), [&](int n) { return attached_[n] >= 0; });
    if (count > 0 && count < 4) boundary_.push_back(e);
    if (std::any_of(node.begin(), node.end(), [&](int n) { return fixed_[n] != 0; })) fixed_elements_.push_back(e);
  }
  pattern_ = fem_.pattern(row_);
}

VecX BodyModel::anchors(double time) const {
  VecX out(3 * nodes());
  for (int i = 0; i < nodes(); ++i) out.segment<3>(3 * i) = mesh_.mesh.nodes[i];
  for (const Attachment& a : attachments_) {
    if (!a.motion) continue;
    const Pose moved = a.motion(time);
    for (const int n : a.nodes) {
      if (!a.fixed() && fixed_[n] != 0) continue;
      out.segment<3>(3 * n) = a.middle + moved.position + moved.rotation * (mesh_.mesh.nodes[n] - a.middle);
    }
  }
  return out;
}

double BodyModel::springEnergy(const VecX& x, const VecX& anchors) const {
  double sum = 0;
  if (spring_stiffness_.size() == 0) return sum;
  for (const int i : free_) {
    sum += 0.5 * spring_stiffness_[i] * (x.segment<3>(3 * i) - anchors.segment<3>(3 * i)).squaredNorm();
  }
  return sum;
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
    if (fixed_[i] != 0) state.velocities.segment<3>(3 * i).setZero();
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
  for (int i = 0; i < nodes(); ++i) {
    places.segment<3>(3 * i) = rt * (state.positions.segment<3>(3 * i) - state.handle.pose.position);
  }
  for (std::size_t k = 0; k < handle_->nodes.size(); ++k) {
    places.segment<3>(3 * handle_->nodes[k]) = handle_->offsets[k];
  }
  return places;
}

VecX BodyModel::speedsInHandle(const BodyState& state, const VecX& places) const {
  const Mat3 rt = state.handle.pose.matrix().transpose();
  const Vec3 v = state.handle.twist.head<3>(), w = rt * state.handle.twist.tail<3>();
  VecX speeds(3 * freeNodes());
  for (int r = 0; r < freeNodes(); ++r) {
    const int i = free()[r];
    const Vec3 y = places.segment<3>(3 * i);
    speeds.segment<3>(3 * r) = rt * (state.velocities.segment<3>(3 * i) - v) - w.cross(y);
  }
  return speeds;
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
