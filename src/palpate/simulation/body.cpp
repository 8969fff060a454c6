#include "palpate/simulation/body.h"

#include <algorithm>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/math/rotation.h"

namespace palpate {

Body::Body(std::string name, SimulationMesh mesh, const Material& material, double friction, const Vec6& velocity)
    : name_(std::move(name)), mesh_(std::move(mesh)), fem_(mesh_, material), finder_(mesh_, friction) {
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

void Body::hold(const Handle& handle) {
  handle_ = handle;
  free_.clear();
  boundary_.clear();
  for (std::size_t k = 0; k < handle.nodes.size(); ++k) attached_[handle.nodes[k]] = static_cast<int>(k);
  for (int i = 0; i < nodes(); ++i) {
    row_[i] = attached_[i] >= 0 ? -1 : static_cast<int>(free_.size());
    if (row_[i] >= 0) free_.push_back(i);
  }
  if (free_.empty()) throw InputError("handle " + handle.name, "region", "holds every node: nothing is left to deform");
  for (int e = 0; e < static_cast<int>(fem_.elements().size()); ++e) {
    const auto& node = fem_.elements()[e].node;
    const auto count = std::count_if(node.begin(), node.end(), [&](int n) { return attached_[n] >= 0; });
    if (count > 0 && count < 4) boundary_.push_back(e);
  }
  if (boundary_.empty())
    throw InputError("handle " + handle.name, "region", "is not connected to the rest of the tool");
  a_ = fem_.pattern(row_);
  analyzed_ = false;
  setHandleState(handle.pose, handle.twist);
}

double Body::totalMass() const { return fem_.mass().sum() + (held() ? handle_->mass - handle_->attached_mass : 0.0); }

Body::State Body::state() const {
  State s{x_, v_, {}, Vec6::Zero(), {}};
  if (held()) {
    s.handle_pose = handle_->pose;
    s.handle_twist = handle_->twist;
  }
  s.rotations.reserve(fem_.elements().size());
  for (const ElasticElement& e : fem_.elements()) s.rotations.push_back(e.rotation);
  return s;
}

void Body::restore(const State& state) {
  x_ = state.x;
  v_ = state.v;
  if (held()) {
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
  if (held()) handle_->twist.setZero();
}

double Body::kineticEnergy() const {
  double sum = 0;
  for (int i = 0; i < nodes(); ++i) {
    if (attached_[i] < 0) sum += 0.5 * fem_.mass()[i] * v_.segment<3>(3 * i).squaredNorm();
  }
  if (held()) sum += 0.5 * handle_->twist.dot(handle_->massMatrix() * handle_->twist);
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
  fem_.assemble(1.0 + h * fem_.material().damping_alpha, c_, a_);
  const int columns = held() ? 7 : 1;
  rhs_.resize(3 * freeNodes(), columns);
  for (int r = 0; r < freeNodes(); ++r) {
    const int i = free_[r];
    const double m = fem_.mass()[i];
    rhs_.col(columns - 1).segment<3>(3 * r) =
        m * v0_.segment<3>(3 * i) + h * (f_.segment<3>(3 * i) + m * input.gravity);
  }
  if (held()) assembleHandle();
}

void Body::assembleHandle() {
  const Handle& hd = *handle_;
  const double h = input_.step;
  pose0_ = hd.pose;
  twist0_ = hd.twist;
  a_th_.setZero(3 * freeNodes(), 6);
  gkg_.setZero();
  for (const int index : boundary_) {
    const ElasticElement& e = fem_.elements()[index];
    const auto c = e.rotatedGradients();
    for (int i = 0; i < 4; ++i) {
      Eigen::Matrix<double, 3, 6> kg = Eigen::Matrix<double, 3, 6>::Zero();
      for (int j = 0; j < 4; ++j) {
        if (attached_[e.node[j]] >= 0) kg += e.stiffness(c, i, j) * hd.jacobian(attached_[e.node[j]]);
      }
      if (row_[e.node[i]] >= 0) {
        a_th_.middleRows<3>(3 * row_[e.node[i]]) += c_ * kg;
      } else {
        gkg_ += hd.jacobian(attached_[e.node[i]]).transpose() * kg;
      }
    }
  }
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
  wrench -= linkWrenchOnDevice(input_.link, hd.pose, Vec6::Zero(), input_.device.pose, input_.device.twist);

  mass0_ = hd.massMatrix();
  a_hh_ = mass0_ + c_ * gkg_;
  const double drag = h * fem_.material().damping_alpha;
  a_hh_.topLeftCorner<3, 3>().diagonal().array() +=
      drag * hd.attached_mass + h * (input_.link.damping + h * input_.link.stiffness);
  a_hh_.bottomRightCorner<3, 3>() += drag * hd.pose.matrix() * hd.attached_inertia * hd.pose.matrix().transpose();
  // log(exp(h w) R Rd^T) = theta + h Jl^-1 w: its symmetric part keeps A symmetric, and positive up to |theta| = pi.
  const Vec3 theta = logRotation(hd.pose.rotation * input_.device.pose.rotation.conjugate());
  const Mat3 jacobian = leftJacobianInverse(theta);
  a_hh_.bottomRightCorner<3, 3>() += h * input_.link.rotational_damping * Mat3::Identity() +
                                     h * h * input_.link.rotational_stiffness * 0.5 * (jacobian + jacobian.transpose());
  b_h_ = mass0_ * hd.twist + h * wrench;
}

bool Body::contactNodesFit(const std::vector<int>& needed) {
  int missing = 0;
  int free = 0;
  for (const int n : needed) {
    if (row_[n] < 0) continue;
    ++free;
    if (trailing_[n] < 0) ++missing;
  }
  constexpr int kSlack = 12;     // nodes
  constexpr int kPatience = 20;  // steps
  const bool surplus = static_cast<int>(contact_nodes_.size()) > 3 * free + kSlack;
  surplus_steps_ = surplus ? surplus_steps_ + 1 : 0;
  return analyzed_ && missing == 0 && surplus_steps_ < kPatience;
}

void Body::orderContactNodes(const std::vector<int>& nodes) {
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
  factor_.analyze(a_, rows);
  analyzed_ = true;
  ++analyses_;
}

bool Body::factorize() { return factor_.factorize(a_); }

void Body::solveFree() {
  solution_ = rhs_;
  factor_.solve(solution_);
  if (!held()) {
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

void Body::predict(const std::vector<Contact>& contacts, int self, const VecX& impulse) {
  prediction_.setZero(3 * freeNodes(), 1);
  Vec6 on_handle = Vec6::Zero();
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    const Vec3 world = contacts[i].frame().transpose() * impulse.segment<3>(static_cast<Eigen::Index>(3 * i));
    const auto addPoint = [&](const ContactPoint& point, double sign) {
      if (point.body != self) return;
      for (int k = 0; k < 4; ++k) {
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
  factor_.solve(prediction_);
  v_end_ = v_free_ + prediction_.col(0);
  u_end_ = u_free_;
  if (held()) {
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

void Body::addDelassus(const std::vector<Contact>& contacts, int self, ContactRows& rows, MatX& delassus) const {
  const auto count = static_cast<Eigen::Index>(3 * contacts.size());
  rows.trailing.setZero(static_cast<Eigen::Index>(3 * contact_nodes_.size()), count);
  rows.handle.setZero(6, count);
  if (held()) rows.z.setZero(6, count);
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    const auto column = static_cast<Eigen::Index>(3 * i);
    const auto addPoint = [&](const ContactPoint& point, double sign) {
      if (point.body != self) return;
      const Mat3 frame = contacts[i].frame().transpose();
      for (int k = 0; k < 4; ++k) {
        const int node = point.node[k];
        const Mat3 block = sign * point.weight[k] * frame;
        if (row_[node] >= 0) {
          rows.trailing.block<3, 3>(3 * trailing_[node], column) += block;
          if (held()) rows.z.middleCols<3>(column) -= x_th_.middleRows<3>(3 * row_[node]).transpose() * block;
        } else {
          rows.handle.middleCols<3>(column) += handle_->jacobian(attached_[node]).transpose() * block;
        }
      }
    };
    addPoint(contacts[i].first, 1.0);
    addPoint(contacts[i].second, -1.0);
  }
  rows.half = rows.trailing;
  if (rows.half.rows() > 0) factor_.trailing().triangularView<Eigen::Lower>().solveInPlace(rows.half);
  delassus.selfadjointView<Eigen::Lower>().rankUpdate(rows.half.transpose());
  if (held()) {
    rows.z += rows.handle;
    delassus.triangularView<Eigen::Lower>() += rows.z.transpose() * (s_inverse_ * rows.z);
  }
}

void Body::nodeVelocity(const ContactPoint& point, const VecX& v, const Vec6& u, Vec3& out) const {
  out.setZero();
  for (int k = 0; k < 4; ++k) {
    const int node = point.node[k];
    if (row_[node] >= 0) {
      out += point.weight[k] * v.segment<3>(3 * row_[node]);
    } else {
      out += point.weight[k] * (handle_->jacobian(attached_[node]) * u);
    }
  }
}

void Body::addFreeRowVelocity(const std::vector<Contact>& contacts, int self, VecX& velocity) const {
  Vec3 v;
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    auto rows = velocity.segment<3>(static_cast<Eigen::Index>(3 * i));
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

void Body::applyImpulse(const ContactRows& rows, const VecX& lambda) {
  const VecX r = rows.trailing * lambda;
  v_end_ = v_free_;
  u_end_ = u_free_;
  if (r.size() > 0) {
    impulse_response_.resize(v_free_.size());
    factor_.solveFromTrailing(r, impulse_response_);
    v_end_ += impulse_response_;
  }
  if (held()) {
    const Vec6 du = s_inverse_ * (rows.z * lambda);
    u_end_ += du;
    v_end_ -= x_th_ * du;
  }
}

void Body::endPositions(VecX& x) const {
  const double h = input_.step;
  x.resize(x0_.size());
  for (int r = 0; r < freeNodes(); ++r) {
    x.segment<3>(3 * free_[r]) = x0_.segment<3>(3 * free_[r]) + h * v_end_.segment<3>(3 * r);
  }
  if (held()) {
    const Pose end = palpate::advance(pose0_, h * u_end_);
    for (std::size_t k = 0; k < handle_->nodes.size(); ++k) {
      x.segment<3>(3 * handle_->nodes[k]) = end.apply(handle_->offsets[k]);
    }
  }
}

bool Body::advance() {
  if (!v_end_.allFinite() || !u_end_.allFinite()) return false;
  endPositions(x_);
  for (int r = 0; r < freeNodes(); ++r) v_.segment<3>(3 * free_[r]) = v_end_.segment<3>(3 * r);
  if (held()) setHandleState(palpate::advance(pose0_, input_.step * u_end_), u_end_);
  return true;
}

}  // namespace palpate
