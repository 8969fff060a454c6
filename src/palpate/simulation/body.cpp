#include "palpate/simulation/body.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/common/parallel.h"
#include "palpate/linear/triangular_solve.h"
#include "palpate/math/rotation.h"
#include "palpate/mesh/surface_measures.h"

namespace palpate {

Body::Body(std::string name, SimulationMesh mesh, const Material& material, double friction, const Vec6& velocity,
           const std::vector<ElementMaterial>& parts)
    : name_(std::move(name)),
      mesh_(std::move(mesh)),
      fem_(mesh_, material, parts),
      finder_(mesh_),
      friction_(friction) {
  const int n = fem_.nodes();
  row_.resize(n);
  free_.resize(n);
  for (int i = 0; i < n; ++i) row_[i] = free_[i] = i;
  attached_.assign(n, -1);
  trailing_.assign(n, -1);
  x_.resize(3 * n);
  v_.resize(3 * n);
  Vec3 center = Vec3::Zero();
  for (int i = 0; i < n; ++i) center += fem_.mass()[i] * mesh_.mesh.nodes[i] / fem_.mass().sum();
  for (int i = 0; i < n; ++i) {
    x_.segment<3>(3 * i) = mesh_.mesh.nodes[i];
    v_.segment<3>(3 * i) = velocity.head<3>() + Vec3(velocity.tail<3>()).cross(mesh_.mesh.nodes[i] - center);
  }
  fem_.updateRotations(x_);
  a_ = fem_.pattern(row_);
}

VecX Body::ContactRows::gather(const VecX& all) const {
  VecX out(static_cast<Eigen::Index>(3 * contacts.size()));
  for (std::size_t k = 0; k < contacts.size(); ++k) {
    out.segment<3>(static_cast<Eigen::Index>(3 * k)) = all.segment<3>(3 * contacts[k]);
  }
  return out;
}

Body Body::rigid(std::string name, const Surface& surface, double density, double friction, const Vec6& velocity,
                 double damping_alpha) {
  const MassProperties solid = surfaceMassProperties(surface, density, name);
  const Vec3 center = solid.center_of_mass;
  const double mass = solid.mass;
  double radius = 0;
  for (const Vec3& p : surface.vertices) radius = std::max(radius, (p - center).norm());
  SimulationMesh mesh;
  mesh.surface = surface;
  const double side = radius / std::sqrt(3.0);
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
  Material material;  // never strained: all that counts is the mass
  material.youngs_modulus = 1.0;
  material.poisson_ratio = 0.0;
  material.density = mass / (8.0 / 3.0 * side * side * side);
  material.damping_alpha = damping_alpha;
  material.damping_beta = 0.0;
  Handle frame;
  frame.name = name;
  frame.nodes = {0, 1, 2, 3};
  for (const Vec3& p : mesh.mesh.nodes) frame.offsets.push_back(p - center);
  frame.mass = frame.attached_mass = mass;
  frame.inertia = frame.attached_inertia = solid.inertia;
  frame.pose.position = center;
  frame.twist = velocity;
  Body body(std::move(name), std::move(mesh), material, friction, velocity);
  body.attach(frame);
  return body;
}

void Body::hold(const Handle& handle) {
  attach(handle);
  linked_ = true;
  if (free_.empty()) throw InputError("handle " + handle.name, "region", "holds every node: nothing is left to deform");
  if (boundary_.empty())
    throw InputError("handle " + handle.name, "region", "is not connected to the rest of the tool");
}

void Body::attach(const Handle& handle) {
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
  a_ = fem_.pattern(row_);
  analyzed_ = false;
  setHandleState(handle.pose, handle.twist);
}

double Body::totalMass() const { return fem_.mass().sum() + (framed() ? handle_->mass - handle_->attached_mass : 0.0); }

Body::State Body::state() const {
  State s{x_, v_, {}, Vec6::Zero(), {}};
  if (framed()) {
    s.handle_pose = handle_->pose;
    s.handle_twist = handle_->twist;
  }
  s.rotations.reserve(fem_.elements().size());
  for (const ElasticElement& e : fem_.elements()) s.rotations.push_back(e.rotation);
  return s;
}

void Body::restore(const State& state) {
  ++restorations_;
  x_ = state.x;
  v_ = state.v;
  if (framed()) {
    handle_->pose = state.handle_pose;
    handle_->twist = state.handle_twist;
  }
  fem_.setRotations(state.rotations);
}

void Body::setHandleState(const Pose& pose, const Vec6& twist) {
  handle_->pose = pose;
  handle_->twist = twist;
  for (std::size_t k = 0; k < handle_->nodes.size(); ++k) {
    x_.segment<3>(3 * handle_->nodes[k]) = handle_->nodePosition(static_cast<int>(k));
    v_.segment<3>(3 * handle_->nodes[k]) = handle_->nodeVelocity(static_cast<int>(k));
  }
}

void Body::clearVelocities() {
  v_.setZero();
  if (framed()) handle_->twist.setZero();
}

double Body::kineticEnergy() const {
  double sum = 0;
  for (int i = 0; i < nodes(); ++i) {
    if (attached_[i] < 0) sum += 0.5 * fem_.mass()[i] * v_.segment<3>(3 * i).squaredNorm();
  }
  if (framed()) sum += 0.5 * handle_->twist.dot(handle_->massMatrix() * handle_->twist);
  return sum;
}

void Body::assemble(const StepInput& input) {
  input_ = input;
  const double h = input.step;
  c_ = h * fem_.material().damping_beta + h * h;
  x0_ = x_;
  v0_ = v_;
  fem_.updateRotations(x0_);
  fem_.forces(x0_, f_);
  parallelFor(ElasticMesh::kParts + 1, [&](int i) {
    if (i == 0) {
      assembleRightSides();
    } else {
      fem_.assemblePart(i - 1, 1.0 + h * fem_.material().damping_alpha, c_, a_);
    }
  });
}

void Body::assembleRightSides() {
  const double h = input_.step;
  const int columns = framed() ? 7 : 1;
  rhs_.resize(3 * freeNodes(), columns);
  for (int r = 0; r < freeNodes(); ++r) {
    const int i = free_[r];
    const double m = fem_.mass()[i];
    rhs_.col(columns - 1).segment<3>(3 * r) =
        m * v0_.segment<3>(3 * i) + h * (f_.segment<3>(3 * i) + m * input_.gravity);
  }
  if (framed()) assembleHandle();
}

void Body::assembleHandle() {
  const Handle& hd = *handle_;
  const double h = input_.step;
  pose0_ = hd.pose;
  twist0_ = hd.twist;
  // by columns of four doubles, which the processor adds at once
  const auto pad = [](const Vec3& v) { return Vec4(v[0], v[1], v[2], 0.0); };
  pulled_.setZero(4, 6 * freeNodes());
  gkg_.setZero();
  const Mat3 rotation = hd.pose.matrix();
  for (const int index : boundary_) {
    const ElasticElement& e = fem_.elements()[index];
    std::array<Vec3, 4> arm;
    std::array<Vec4, 4> c;
    // sum of K_ij G_j over the attached nodes j, G_j = [I, -[r_j]x]: as K_ij is made of products of gradients, so is
    // the sum, of the gradients' sum, moment and sum of mu c_j r_j^T
    Vec4 sum = Vec4::Zero(), moment = Vec4::Zero();
    std::array<Vec4, 3> spread{Vec4::Zero(), Vec4::Zero(), Vec4::Zero()};
    for (int j = 0; j < 4; ++j) {
      c[j] = pad(e.rotation * e.gradient[j]);
      if (attached_[e.node[j]] < 0) continue;
      arm[j] = rotation * hd.offsets[attached_[e.node[j]]];
      sum += c[j];
      moment += pad(arm[j].cross(c[j].head<3>()));
      for (int k = 0; k < 3; ++k) spread[k] += e.mu * arm[j][k] * c[j];
    }
    const Vec4 stretched = e.lambda * sum, turned = e.lambda * moment, sheared = e.mu * sum;
    for (int i = 0; i < 4; ++i) {
      const Vec4& ci = c[i];
      const double shear = ci.dot(sheared);
      const Vec3 q(spread[0].dot(ci), spread[1].dot(ci), spread[2].dot(ci));
      Eigen::Matrix<double, 4, 6> kg;
      for (int k = 0; k < 3; ++k) {
        const int next = (k + 1) % 3, last = (k + 2) % 3;
        kg.col(k) = stretched[k] * ci + ci[k] * sheared;
        kg(k, k) += shear;
        // column k of spread [c]x - [q]x
        kg.col(3 + k) = turned[k] * ci + ci[last] * spread[next] - ci[next] * spread[last];
        kg(next, 3 + k) -= q[last];
        kg(last, 3 + k) += q[next];
      }
      const int row = row_[e.node[i]];
      if (row >= 0) {
        pulled_.middleCols<6>(6 * row) += kg;
      } else {
        gkg_.topRows<3>() += kg.topRows<3>();
        gkg_.bottomRows<3>() += skew(arm[i]) * kg.topRows<3>();
      }
    }
  }
  a_th_.resize(3 * freeNodes(), 6);
  for (int r = 0; r < freeNodes(); ++r) a_th_.middleRows<3>(3 * r) = c_ * pulled_.block<3, 6>(0, 6 * r);
  rhs_.leftCols(6) = a_th_;

  Vec6 wrench = Vec6::Zero();
  for (std::size_t k = 0; k < hd.nodes.size(); ++k) {
    const Vec3 force = f_.segment<3>(3 * hd.nodes[k]);
    wrench.head<3>() += force;
    wrench.tail<3>() += (hd.pose.rotation * hd.offsets[k]).cross(force);
  }
  wrench.head<3>() += hd.mass * input_.gravity;  // no moment: the origin is the center of mass
  const Mat3 inertia = hd.worldInertia();
  const Vec3 w = hd.twist.tail<3>();
  wrench.tail<3>() -= w.cross(inertia * w);

  mass0_ = hd.massMatrix();
  a_hh_ = mass0_ + c_ * gkg_;
  const double drag = h * fem_.material().damping_alpha;
  a_hh_.topLeftCorner<3, 3>().diagonal().array() += drag * hd.attached_mass;
  a_hh_.bottomRightCorner<3, 3>() += drag * hd.pose.matrix() * hd.attached_inertia * hd.pose.matrix().transpose();
  if (linked_) addLink(wrench);
  b_h_ = mass0_ * hd.twist + h * wrench;
}

void Body::addLink(Vec6& wrench) {
  const Handle& hd = *handle_;
  const double h = input_.step;
  wrench -= linkWrenchOnDevice(input_.link, hd.pose, Vec6::Zero(), input_.device.pose, input_.device.twist);
  a_hh_.topLeftCorner<3, 3>().diagonal().array() += h * (input_.link.damping + h * input_.link.stiffness);
  // log(exp(h w) R Rd^T) = theta + h Jl^-1 w: its symmetric part keeps A symmetric, and positive up to |theta| = pi.
  const Vec3 theta = logRotation(hd.pose.rotation * input_.device.pose.rotation.conjugate());
  const Mat3 jacobian = leftJacobianInverse(theta);
  a_hh_.bottomRightCorner<3, 3>() += h * input_.link.rotational_damping * Mat3::Identity() +
                                     h * h * input_.link.rotational_stiffness * 0.5 * (jacobian + jacobian.transpose());
}

bool Body::contactNodesFit(const std::vector<int>& needed) {
  int missing = 0;
  int free = 0;
  seen_.assign(row_.size(), 0);
  for (const int n : needed) {
    if (row_[n] < 0 || seen_[n]) continue;
    seen_[n] = 1;
    ++free;
    if (trailing_[n] < 0) ++missing;
  }
  constexpr int kSlack = 12;     // nodes
  constexpr int kPatience = 20;  // steps
  const bool surplus = static_cast<int>(contact_nodes_.size()) > 3 * free + kSlack;
  surplus_steps_ = surplus ? surplus_steps_ + 1 : 0;
  return analyzed_ && (missing == 0 || !nodes_last_) && surplus_steps_ < kPatience;
}

bool Body::lacksNodes(const ContactPoint& point, int self) const {
  if (point.body != self || !nodes_last_) return false;
  for (int k = 0; k < point.count; ++k) {
    if (row_[point.node[k]] >= 0 && trailing_[point.node[k]] < 0) return true;
  }
  return false;
}

void Body::orderContactNodes(const std::vector<int>& nodes) {
  constexpr std::size_t kMany = 64;  // nodes; fewer are last in any case
  surplus_steps_ = 0;
  contact_nodes_.clear();
  std::fill(trailing_.begin(), trailing_.end(), -1);
  for (const int n : nodes) {
    if (row_[n] < 0 || trailing_[n] >= 0) continue;
    trailing_[n] = static_cast<int>(contact_nodes_.size());
    contact_nodes_.push_back(n);
  }
  std::vector<int> rows;
  rows.reserve(contact_nodes_.size());
  for (const int n : contact_nodes_) rows.push_back(row_[n]);
  nodes_last_ = true;
  if (!free_.empty()) factor_.analyze(a_, rows);
  if (rows.size() >= kMany) {
    // operations of the factor and of W for a contact on each node, either way
    const double dense = 3.0 * static_cast<double>(rows.size());
    const double last = factor_.statistics().flops + 2.0 * dense * dense * dense;
    SparseCholesky anywhere;
    anywhere.analyze(a_);
    if (anywhere.statistics().flops + anywhere.gramOperations(rows) < last) {
      factor_ = std::move(anywhere);
      nodes_last_ = false;
    }
  }
  analyzed_ = true;
  ++analyses_;
}

bool Body::factorize() { return free_.empty() || factor_.factorize(a_); }

void Body::solveFree() {
  solution_ = rhs_;
  if (!free_.empty()) factor_.solve(solution_);
  if (!framed()) {
    v_free_ = solution_.col(0);
  } else {
    // X^T b = A_th^T A_tt^-1 b, so one solve for all seven columns is enough
    x_th_ = solution_.leftCols(6);
    const Eigen::Matrix<double, 6, 6> q = a_th_.transpose() * x_th_;
    const Eigen::Matrix<double, 6, 6> s = a_hh_ - 0.5 * (q + q.transpose());
    s_inverse_ = s.inverse();
    u_free_ = s_inverse_ * (b_h_ - a_th_.transpose() * solution_.col(6));
    v_free_ = solution_.col(6) - x_th_ * u_free_;
  }
  v_end_ = v_free_;
  u_end_ = u_free_;
}

// Contact impulses on the free nodes, into prediction_, and on the handle; whether there are any.
bool Body::addImpulses(const std::vector<Contact>& contacts, const std::vector<int>& own, int self, const VecX& impulse,
                       Vec6& on_handle) {
  prediction_.setZero(3 * freeNodes(), 1);
  on_handle.setZero();
  for (const int i : own) {
    const Vec3 world = contacts[i].frame().transpose() * impulse.segment<3>(3 * i);
    const auto addPoint = [&](const ContactPoint& point, double sign) {
      if (point.body != self) return;
      for (int k = 0; k < point.count; ++k) {
        const int node = point.node[k];
        const Vec3 share = sign * point.weight[k] * world;
        if (row_[node] >= 0) {
          prediction_.block<3, 1>(3 * row_[node], 0) += share;
        } else {
          on_handle += handle_->jacobian(attached_[node]).transpose() * share;
        }
      }
    };
    addPoint(contacts[i].first, 1.0);
    addPoint(contacts[i].second, -1.0);
  }
  return !own.empty();
}

void Body::predict(const std::vector<Contact>& contacts, const std::vector<int>& own, int self, const VecX& impulse) {
  Vec6 on_handle;
  v_end_ = v_free_;
  u_end_ = u_free_;
  if (!addImpulses(contacts, own, self, impulse, on_handle)) return;
  if (!free_.empty()) factor_.solve(prediction_);
  v_end_ += prediction_.col(0);
  if (framed()) {
    const Vec6 du = s_inverse_ * (on_handle - a_th_.transpose() * prediction_.col(0));
    u_end_ += du;
    v_end_ -= x_th_ * du;
  }
}

void Body::solveFreeAgain() {
  const VecX v = v_end_;
  const Vec6 u = u_end_;
  solveFree();
  v_end_ = v;
  u_end_ = u;
}

// Appends J_t^T of a contact to columns_, and sets its columns of J_h^T and z.
void Body::addColumns(const Contact& c, int self, Eigen::Index column, ContactRows& rows) {
  const Mat3 frame = c.frame().transpose();
  if (framed()) {
    rows.handle.middleCols<3>(column).setZero();
    rows.z.middleCols<3>(column).setZero();
  }
  const auto addPoint = [&](const ContactPoint& point, double sign) {
    if (point.body != self) return;
    for (int k = 0; k < point.count; ++k) {
      const int node = point.node[k];
      const Mat3 block = sign * point.weight[k] * frame;
      if (row_[node] >= 0) {
        columns_.add(row_[node], block);
        if (framed()) rows.z.middleCols<3>(column) -= x_th_.middleRows<3>(3 * row_[node]).transpose() * block;
      } else {
        rows.handle.middleCols<3>(column) += handle_->jacobian(attached_[node]).transpose() * block;
      }
    }
  };
  addPoint(c.first, 1.0);
  addPoint(c.second, -1.0);
  columns_.close();
  if (framed()) rows.z.middleCols<3>(column) += rows.handle.middleCols<3>(column);
}

void Body::contactRows(const std::vector<Contact>& contacts, int self, const std::vector<char>& changed,
                       ContactRows& rows) {
  const auto count = static_cast<Eigen::Index>(3 * rows.contacts.size());
  changed_.clear();
  for (std::size_t k = 0; k < rows.contacts.size(); ++k) {
    if (k >= rows.known || changed[rows.contacts[k]]) changed_.push_back(static_cast<int>(k));
  }
  rows.known = rows.contacts.size();
  if (changed_.empty()) return;
  // a changed contact costs a solve with three columns; beyond some share of them all columns at once are cheaper
  constexpr std::size_t kFew = 4;
  const bool few = kFew * changed_.size() < rows.contacts.size();
  if (!few) {
    changed_.resize(rows.contacts.size());
    std::iota(changed_.begin(), changed_.end(), 0);
  }
  if (framed()) {
    rows.handle.conservativeResize(6, count);
    rows.z.conservativeResize(6, count);
  }
  columns_.clear();
  for (const int k : changed_) addColumns(contacts[rows.contacts[k]], self, 3 * k, rows);
  if (few) {
    rows.delassus.conservativeResize(count, count);
    updateDelassus(contacts, self, rows);
  } else {
    formDelassus(rows);
  }
}

// All of it, from columns_.
void Body::formDelassus(ContactRows& rows) {
  const auto count = static_cast<Eigen::Index>(3 * rows.contacts.size());
  if (free_.empty()) {
    rows.delassus.setZero(count, count);
  } else if (!nodes_last_) {
    factor_.gram(columns_, rows.delassus);
  } else {
    half_.setZero(static_cast<Eigen::Index>(3 * contact_nodes_.size()), count);
    for (Eigen::Index c = 0; c < columns_.size(); ++c) {
      for (int k = columns_.begin[c]; k < columns_.begin[c + 1]; ++k) {
        half_.block<3, 3>(3 * trailing_[free_[columns_.node[k]]], 3 * c) += columns_.block[k];
      }
    }
    rows.delassus.setZero(count, count);
    // Eigen divides by the number of rows to choose its blocks
    if (half_.rows() > 0) {
      solveLowerInPlace(factor_.trailing(), half_);
      rows.delassus.selfadjointView<Eigen::Lower>().rankUpdate(half_.transpose());
    }
  }
  if (!framed()) return;
  constexpr int kTile = 64;
  parallelFor(static_cast<int>((count + kTile - 1) / kTile), [&](int tile) {
    const Eigen::Index j = tile * kTile, width = std::min<Eigen::Index>(kTile, count - j), below = count - j - width;
    const Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, kTile> moved = s_inverse_ * rows.z.middleCols(j, width);
    rows.delassus.block(j, j, width, width).triangularView<Eigen::Lower>() +=
        rows.z.middleCols(j, width).transpose() * moved;
    rows.delassus.block(j + width, j, below, width).noalias() += rows.z.rightCols(below).transpose() * moved;
  });
}

// Rows and columns of the changed contacts, by a solve with their columns.
void Body::updateDelassus(const std::vector<Contact>& contacts, int self, ContactRows& rows) {
  response_.setZero(3 * freeNodes(), 3 * columns_.size());
  for (Eigen::Index c = 0; c < columns_.size(); ++c) {
    for (int k = columns_.begin[c]; k < columns_.begin[c + 1]; ++k) {
      response_.block<3, 3>(3 * columns_.node[k], 3 * c) += columns_.block[k];
    }
  }
  if (!free_.empty()) factor_.solve(response_);
  image_ = rowVelocity(contacts, rows.contacts, self, response_);
  if (framed()) {
    for (std::size_t c = 0; c < changed_.size(); ++c) {
      image_.middleCols<3>(static_cast<Eigen::Index>(3 * c)) +=
          rows.z.transpose() * (s_inverse_ * rows.z.middleCols<3>(3 * changed_[c]));
    }
  }
  for (std::size_t c = 0; c < changed_.size(); ++c) {
    const Eigen::Index own = 3 * changed_[c];
    const auto column = image_.middleCols<3>(static_cast<Eigen::Index>(3 * c));
    rows.delassus.block(own, own, rows.delassus.rows() - own, 3) = column.bottomRows(rows.delassus.rows() - own);
    rows.delassus.block(own, 0, 3, own) = column.topRows(own).transpose();
  }
}

MatX Body::rowVelocity(const std::vector<Contact>& contacts, const std::vector<int>& own, int self,
                       const MatX& v) const {
  MatX out = MatX::Zero(static_cast<Eigen::Index>(3 * own.size()), v.cols());
  for (std::size_t i = 0; i < own.size(); ++i) {
    const Contact& c = contacts[own[i]];
    auto rows = out.middleRows<3>(static_cast<Eigen::Index>(3 * i));
    const auto addPoint = [&](const ContactPoint& point, double sign) {
      if (point.body != self) return;
      for (int k = 0; k < point.count; ++k) {
        if (row_[point.node[k]] >= 0) rows += sign * point.weight[k] * v.middleRows<3>(3 * row_[point.node[k]]);
      }
    };
    addPoint(c.first, 1.0);
    addPoint(c.second, -1.0);
    const Mat3 frame = c.frame();
    for (Eigen::Index k = 0; k < rows.cols(); ++k) rows.col(k) = (frame * rows.col(k)).eval();
  }
  return out;
}

void Body::nodeVelocity(const ContactPoint& point, const VecX& v, const Vec6& u, Vec3& out) const {
  out.setZero();
  for (int k = 0; k < point.count; ++k) {
    const int node = point.node[k];
    if (row_[node] >= 0) {
      out += point.weight[k] * v.segment<3>(3 * row_[node]);
    } else {
      out += point.weight[k] * (handle_->jacobian(attached_[node]) * u);
    }
  }
}

void Body::addFreeRowVelocity(const std::vector<Contact>& contacts, const std::vector<int>& own, int self,
                              VecX& velocity) const {
  Vec3 v;
  for (const int i : own) {
    auto rows = velocity.segment<3>(3 * i);
    if (contacts[i].first.body == self) {
      nodeVelocity(contacts[i].first, v_free_, u_free_, v);
      rows += contacts[i].frame() * v;
    }
    if (contacts[i].second.body == self) {
      nodeVelocity(contacts[i].second, v_free_, u_free_, v);
      rows -= contacts[i].frame() * v;
    }
  }
}

void Body::applyImpulse(const std::vector<Contact>& contacts, const ContactRows& rows, int self, const VecX& lambda) {
  Vec6 on_handle;
  v_end_ = v_free_;
  u_end_ = u_free_;
  if (!addImpulses(contacts, rows.contacts, self, lambda, on_handle)) return;
  if (!free_.empty() && nodes_last_) {
    on_trailing_.resize(static_cast<Eigen::Index>(3 * contact_nodes_.size()));
    for (std::size_t k = 0; k < contact_nodes_.size(); ++k) {
      on_trailing_.segment<3>(static_cast<Eigen::Index>(3 * k)) =
          prediction_.block<3, 1>(3 * row_[contact_nodes_[k]], 0);
    }
    impulse_response_.resize(v_free_.size());
    factor_.solveFromTrailing(on_trailing_, impulse_response_);
    v_end_ += impulse_response_;
  } else if (!free_.empty()) {
    factor_.solve(prediction_);
    v_end_ += prediction_.col(0);
  }
  if (framed()) {
    const Vec6 du = s_inverse_ * (rows.z * rows.gather(lambda));
    u_end_ += du;
    v_end_ -= x_th_ * du;
  }
}

void Body::endPositions(VecX& x, double share) const {
  const double h = share * input_.step;
  x.resize(x0_.size());
  for (int r = 0; r < freeNodes(); ++r) {
    x.segment<3>(3 * free_[r]) = x0_.segment<3>(3 * free_[r]) + h * v_end_.segment<3>(3 * r);
  }
  if (framed()) {
    const Pose end = palpate::advance(pose0_, h * u_end_);
    for (std::size_t k = 0; k < handle_->nodes.size(); ++k) {
      x.segment<3>(3 * handle_->nodes[k]) = end.apply(handle_->offsets[k]);
    }
  }
}

Vec3 Body::arcOffset(const ContactPoint& point, const VecX& x_end) const {
  Vec3 offset = Vec3::Zero();
  for (int k = 0; k < point.count; ++k) {
    const int node = point.node[k];
    if (row_[node] >= 0) continue;
    const Vec3 straight = input_.step * (handle_->jacobian(attached_[node]) * u_end_);
    offset += point.weight[k] * (x_end.segment<3>(3 * node) - x0_.segment<3>(3 * node) - straight);
  }
  return offset;
}

bool Body::advance(double share) {
  if (!v_end_.allFinite() || !u_end_.allFinite()) return false;
  endPositions(x_, share);
  for (int r = 0; r < freeNodes(); ++r) v_.segment<3>(3 * free_[r]) = v_end_.segment<3>(3 * r);
  if (framed()) setHandleState(palpate::advance(pose0_, share * input_.step * u_end_), u_end_);
  return true;
}

}  // namespace palpate
