#include "palpate/simulation/body_system.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "palpate/common/parallel.h"
#include "palpate/fem/polar.h"
#include "palpate/math/decompositions.h"
#include "palpate/math/rotation.h"

namespace palpate {

BodySystem::BodySystem(const BodyModel& model) : model_(&model), a_(model.pattern()) {
  trailing_.assign(model.nodes(), -1);
}

void BodySystem::assemble(const StepInput& input, BodyState& state, const BodyCorrection* correction) {
  const ElasticMesh& fem = model_->elasticity();
  state_ = &state;
  input_ = input;
  correction_ = correction != nullptr ? *correction : BodyCorrection{};
  const double h = input.step;
  c_ = fem.material().stiffnessScale(h);
  x0_ = state.positions;
  v0_ = start_velocities_ = state.velocities;
  start_ = state.handle;
  if (!model_->attachments().empty()) anchors_ = model_->anchors(input.end_time);
  turns_ = false;
  if (follows()) moveRigidly();
  if (corrected()) shiftNodes();
  turns_ = mayTurn() && !displaced() && turnRigidly();
  turned_ = follows() && prepared_.ready && prepared_.step == h && prepared_.elastic.isFor(places_);
  const VecX& x = displaced() ? moved_ : x0_;
  if (turned_) {
    takePrepared();
    moved_energy_ = prepared_.energy;
  } else {
    if (!ahead_.isFor(x)) ahead_energy_ = fem.energyAt(x, state.elastic, ahead_);
    moved_energy_ = ahead_energy_;
    state.elastic.rotations.swap(ahead_.rotations);
    state.elastic.flat.swap(ahead_.flat);
    state.elastic.released.swap(ahead_.released);
    f_.swap(ahead_.forces);
  }
  ahead_.clear();
  tension_.clear();
  if (input.tension) fem.tensionFactors(x0_, state.elastic, h * h / c_, tension_);
  if (turned_) {
    assembleRightSides();
    return;
  }
  prepared_.ready = false;
  parallelFor(ElasticMesh::kParts + 1, [&](int i) {
    if (i == 0) {
      assembleRightSides();
    } else {
      fem.assemblePart(i - 1, fem.material().massScale(h), c_, state.elastic, a_, tension_);
    }
  });
  addSprings(h);
}

bool BodySystem::prepareFollowing(const VecX& places, const BodyState& state, double step) {
  const ElasticMesh& fem = model_->elasticity();
  ElasticState elastic = state.elastic;
  const Mat3 rt = state.handle.pose.matrix().transpose();
  for (Mat3& rotation : elastic.rotations) rotation = (rt * rotation).eval();
  prepared_.energy = fem.energyAt(places, elastic, prepared_.elastic);
  prepared_.step = step;
  prepared_.ready = false;
  turned_ = false;
  if (!isAnalyzed(state.order)) analyze(state.order);
  elastic.rotations.swap(prepared_.elastic.rotations);
  elastic.flat.swap(prepared_.elastic.flat);
  assembleMatrix(step, elastic);
  elastic.rotations.swap(prepared_.elastic.rotations);
  elastic.flat.swap(prepared_.elastic.flat);
  prepared_.ready = factorize();
  return prepared_.ready;
}

void BodySystem::assembleMatrix(double step, const ElasticState& elastic) {
  const ElasticMesh& fem = model_->elasticity();
  const double mass_scale = fem.material().massScale(step), c = fem.material().stiffnessScale(step);
  parallelFor(ElasticMesh::kParts, [&](int part) { fem.assemblePart(part, mass_scale, c, elastic, a_); });
  addSprings(step);
}

// Springs to the world, implicit: h d + h^2 k on the diagonal.
void BodySystem::addSprings(double step) {
  const VecX &stiffness = model_->springStiffness(), &damping = model_->springDamping();
  if (stiffness.size() == 0) return;
  for (int r = 0; r < model_->freeNodes(); ++r) {
    const int i = model_->free()[r];
    a_.block(a_.column[r]).diagonal().array() += step * (damping[i] + step * stiffness[i]);
  }
}

// Rotations and forces, turned to where the path ends.
void BodySystem::takePrepared() {
  turn_ = grip().matrix();
  const ElasticAhead& elastic = prepared_.elastic;
  for (std::size_t i = 0; i < elastic.rotations.size(); ++i) {
    state_->elastic.rotations[i] = turn_ * elastic.rotations[i];
  }
  state_->elastic.released = elastic.released;
  state_->elastic.flat = elastic.flat;
  for (FlatElement& flat : state_->elastic.flat) flat.frame = (turn_ * flat.frame).eval();
  f_.resize(elastic.forces.size());
  for (int i = 0; i < model_->nodes(); ++i) f_.segment<3>(3 * i) = turn_ * elastic.forces.segment<3>(3 * i);
}

// A_tt^-1 of columns in the world's frame.
void BodySystem::solve(MatX& columns) {
  if (turned_) turnVectors(turn_.transpose(), columns);
  solveTurned(columns);
}

// The same of columns in the frame of the factor.
void BodySystem::solveTurned(MatX& columns) {
  factor_.solve(columns);
  if (turned_) turnVectors(turn_, columns);
}

// All nodes to where the handle's path leads them as one rigid body, and the shift.
void BodySystem::moveRigidly() {
  const FollowedHandle& followed = input_.followed;
  const double h = input_.step;
  const Pose& end = followed.end.pose;
  const Mat3 turn = end.matrix();
  places_ = model_->placesInHandle(*state_);
  moved_.resize(x0_.size());
  carried_.resize(3 * model_->freeNodes());
  for (int r = 0; r < model_->freeNodes(); ++r) {
    const int i = model_->free()[r];
    auto place = places_.segment<3>(3 * i);
    auto x = moved_.segment<3>(3 * i);
    x = end.position + turn * place;
    const Vec3 rigid = (x - x0_.segment<3>(3 * i)) / h;
    auto v = v0_.segment<3>(3 * i);
    if (followed.velocity.size() > 0) v += start_.pose.rotation * followed.velocity.segment<3>(3 * r);
    v -= rigid;  // the right side needs it so
    carried_.segment<3>(3 * r) = rigid;
    if (followed.shift.size() == 0) continue;
    const Vec3 shift = turn * followed.shift.segment<3>(3 * r);
    x += shift;
    carried_.segment<3>(3 * r) += shift / h;
    place += followed.shift.segment<3>(3 * r);
  }
  for (std::size_t k = 0; k < handle().nodes.size(); ++k) {
    moved_.segment<3>(3 * handle().nodes[k]) = end.apply(handle().offsets[k]);
  }
}

// Of the free nodes and the handle at the start.
BodySystem::RigidMotion BodySystem::rigidMotion() const {
  const VecX& mass = model_->elasticity().mass();
  const Vec3& grip = start_.pose.position;
  RigidMotion out{handle().mass * grip, handle().worldInertia(start_.pose), Vec6::Zero()};
  double whole = handle().mass;
  Vec3 momentum = handle().mass * start_.twist.head<3>();
  for (const int i : model_->free()) {
    whole += mass[i];
    out.center += mass[i] * x0_.segment<3>(3 * i);
    momentum += mass[i] * start_velocities_.segment<3>(3 * i);
  }
  out.center /= whole;
  Vec3 moment = out.inertia * start_.twist.tail<3>();
  const auto add = [&](double m, const Vec3& arm, const Vec3& velocity) {
    out.inertia += m * (arm.squaredNorm() * Mat3::Identity() - arm * arm.transpose());
    moment += m * arm.cross(velocity);
  };
  add(handle().mass, grip - out.center, start_.twist.head<3>());
  for (const int i : model_->free()) {
    add(mass[i], x0_.segment<3>(3 * i) - out.center, start_velocities_.segment<3>(3 * i));
  }
  out.twist << momentum / whole, out.inertia.ldlt().solve(moment);
  return out;
}

// The twist about the center of mass that leads a rigid body nearest to that end.
Vec6 BodySystem::rigidWay(const BodyState& end) const {
  const VecX& mass = model_->elasticity().mass();
  const Vec3 &grip0 = start_.pose.position, &grip = end.handle.pose.position;
  double whole = handle().mass;
  Vec3 from = whole * grip0, to = whole * grip;
  for (const int i : model_->free()) {
    whole += mass[i];
    from += mass[i] * x0_.segment<3>(3 * i);
    to += mass[i] * end.positions.segment<3>(3 * i);
  }
  from /= whole;
  to /= whole;
  Mat3 moment = handle().mass * (grip - to) * (grip0 - from).transpose();
  for (const int i : model_->free()) {
    moment += mass[i] * (end.positions.segment<3>(3 * i) - to) * (x0_.segment<3>(3 * i) - from).transpose();
  }
  Vec6 way;
  way << to - from, logRotation(Quat(polarRotation(moment / moment.norm(), Mat3::Identity())));
  return way / input_.step;
}

bool BodySystem::mayTurn() const {
  return model_->held() && input_.turning && !model_->isRigid() && model_->attachments().empty();
}

// All nodes and the handle to where a rigid body would go, if it turns them by what matters. The body's motion turns
// with it and keeps its angular momentum, and centrifugal force acts where it ends; the force of the middle of the
// step, which keeps nodes on their way round, would slow them down if it acted there. Velocities against that motion
// stay what they are in the world: in the body's frame that is half of Coriolis' force, and the change of the arms is
// the other half.
// @returns whether it does
bool BodySystem::turnRigidly() {
  constexpr double kLeast = 0.02;  // by which lengths grow by half the square on straight ways
  const double h = input_.step;
  const RigidMotion start = rigidMotion();
  constexpr double kFlat = 1e-6;  // of a ball's: nodes that are all in a line do not say how they turn
  if (!(start.inertia.determinant() > kFlat * std::pow(start.inertia.trace() / 3.0, 3))) return false;
  const Vec6 twist = expected_.value_or(start.twist);
  const Vec3 turning = twist.tail<3>();
  if (!(h * turning.norm() > kLeast) || !twist.allFinite() || !start.twist.allFinite()) return false;
  const Pose end = palpate::advance(Pose{start.center, Quat::Identity()}, h * twist);
  const Mat3 turn = end.matrix();
  const Mat3 inertia = turn * start.inertia * turn.transpose(), inverse = inertia.inverse();
  const Vec3 before = start.twist.tail<3>();
  Vec3 kept = inverse * (start.inertia * before);
  const double energy = before.dot(start.inertia * before), energy_kept = kept.dot(inertia * kept);
  if (energy_kept > energy) kept *= std::sqrt(energy / energy_kept);
  // centrifugal forces only strain: what they would turn is in that already
  const Vec3 gained = kept - turning + h * inverse * turning.cross(inertia * turning);
  // against the motion to which the end's velocities are: the right side needs it so
  const auto carry = [&](const Vec3& arm0, const Vec3& velocity) {
    const Vec3 arm = turn * arm0;
    const Vec3 relative = velocity - start.twist.head<3>() - before.cross(arm0);
    return Vec3(start.twist.head<3>() - twist.head<3>() + gained.cross(arm) + relative -
                h * turning.cross(turning.cross(arm)));
  };
  rigid_ = {end, twist};
  moved_.resize(x0_.size());
  carried_.resize(3 * model_->freeNodes());
  for (int r = 0; r < model_->freeNodes(); ++r) {
    const int i = model_->free()[r];
    const Vec3 arm = x0_.segment<3>(3 * i) - start.center;
    moved_.segment<3>(3 * i) = end.apply(arm);
    carried_.segment<3>(3 * r) = (moved_.segment<3>(3 * i) - x0_.segment<3>(3 * i)) / h;
    v0_.segment<3>(3 * i) = carry(arm, start_velocities_.segment<3>(3 * i));
  }
  const Vec3 arm = start_.pose.position - start.center;
  turned_grip_ = {end.apply(arm), end.rotation * start_.pose.rotation};
  carried_grip_ << (turned_grip_.position - start_.pose.position) / h, turning;
  const Mat3 own = handle().worldInertia(turned_grip_);
  const Vec3 spin = handle().worldInertia(start_.pose) * (start_.twist.tail<3>() - before);
  grip_gain_ << carry(arm, start_.twist.head<3>()), gained + own.inverse() * (spin - h * turning.cross(own * turning));
  for (std::size_t k = 0; k < handle().nodes.size(); ++k) {
    moved_.segment<3>(3 * handle().nodes[k]) = turned_grip_.apply(handle().offsets[k]);
  }
  return true;
}

// Velocity against its chord's, of what the rigid motion leads there.
Vec3 BodySystem::velocityThere(const Vec3& x) const {
  return rigid_.twist.head<3>() + rigid_.twist.tail<3>().cross(x - rigid_.pose.position);
}

// The free nodes by a correction.
void BodySystem::shiftNodes() {
  moved_ = x0_;
  carried_ = correction_.shift / input_.step;
  for (int r = 0; r < model_->freeNodes(); ++r) {
    const int i = model_->free()[r];
    moved_.segment<3>(3 * i) += correction_.shift.segment<3>(3 * r);
    v0_.segment<3>(3 * i) += correction_.velocity.segment<3>(3 * r);
  }
}

const VecX& BodySystem::forcesAhead(const VecX& positions, const BodyState& state) {
  if (!ahead_.isFor(positions)) ahead_energy_ = model_->elasticity().energyAt(positions, state.elastic, ahead_);
  return ahead_.forces;
}

void BodySystem::assembleRightSides() {
  const double h = input_.step;
  const int columns = model_->framed() ? 7 : 1;
  const VecX& x = displaced() ? moved_ : x0_;
  rhs_.resize(3 * model_->freeNodes(), columns);
  for (int r = 0; r < model_->freeNodes(); ++r) {
    const int i = model_->free()[r];
    const double m = model_->elasticity().mass()[i];
    rhs_.col(columns - 1).segment<3>(3 * r) =
        m * v0_.segment<3>(3 * i) + h * (f_.segment<3>(3 * i) + m * input_.gravity);
    if (model_->springStiffness().size() > 0) {
      rhs_.col(columns - 1).segment<3>(3 * r) -=
          h * model_->springStiffness()[i] * (x.segment<3>(3 * i) - anchors_.segment<3>(3 * i));
      if (follows())
        rhs_.col(columns - 1).segment<3>(3 * r) -= h * model_->springDamping()[i] * carried_.segment<3>(3 * r);
    }
    if (follows() || turns_) {
      rhs_.col(columns - 1).segment<3>(3 * r) -=
          h * model_->elasticity().material().damping_alpha * m * carried_.segment<3>(3 * r);
    }
  }
  if (model_->framed()) {
    pullHandle();
    assembleHandle();
    if (turns_) {
      rhs_.col(6) += a_th_ * carried_grip_;
      b_h_ += c_ * (gkg_ * carried_grip_);
    }
  }
  if (!model_->driven()) return;
  const VecX loads = besideFixed([&](int n) { return model_->isFixed(n) ? fixedVelocity(n) : Vec3(Vec3::Zero()); });
  for (int r = 0; r < model_->freeNodes(); ++r) {
    rhs_.col(columns - 1).segment<3>(3 * r) -= loads.segment<3>(3 * model_->free()[r]);
  }
  if (!model_->framed()) return;
  for (const int n : handle().nodes) b_h_ -= jacobian(n).transpose() * loads.segment<3>(3 * n);
}

// c K v of the elements that touch fixed nodes, all nodes [N s].
template <class Velocity>
VecX BodySystem::besideFixed(Velocity velocity) const {
  VecX loads = VecX::Zero(3 * model_->nodes());
  for (const int index : model_->fixedElements()) {
    const ElasticElement& e = model_->elasticity().elements()[index];
    const auto c = e.rotatedGradients(state_->elastic.rotations[index]);
    for (int j = 0; j < 4; ++j) {
      const Vec3 v = c_ * state_->elastic.stiffness_scale * velocity(e.node[j]);
      for (int i = 0; i < 4; ++i) loads.segment<3>(3 * e.node[i]) += e.stiffness(c, i, j) * v;
    }
    const FlatElement* flat = flatElement(state_->elastic.flat, index);
    if (flat == nullptr) continue;
    Mat3 rate = Mat3::Zero();
    for (int j = 0; j < 4; ++j) rate += velocity(e.node[j]) * c[j].transpose();
    const Mat3 stress = c_ * state_->elastic.stiffness_scale * flat->linearStress(rate, 0.0);
    for (int i = 0; i < 4; ++i) loads.segment<3>(3 * e.node[i]) += stress * c[i];
  }
  return loads;
}

// K_TH G into pulled_ and G^T K_HH G, from the elements that join handle and free nodes; A_th = c K_TH G.
void BodySystem::pullHandle() {
  const int n = model_->freeNodes();
  pulled_.setZero(4, 6 * n);
  gkg_.setZero();
  for (const int element : model_->boundaryElements()) addPull(element);
  a_th_.resize(3 * n, 6);
  for (int r = 0; r < n; ++r) a_th_.middleRows<3>(3 * r) = c_ * pulled_.block<3, 6>(0, 6 * r);
  rhs_.leftCols(6) = a_th_;
}

// One element's sum of K_ij G_j over its attached nodes j, G_j = [I, -[r_j]x]: as K_ij is made of products of
// gradients, so is the sum, of the gradients' sum, moment and sum of mu c_j r_j^T. By columns of four doubles, which
// the processor adds at once.
void BodySystem::addPull(int element) {
  const ElasticElement& e = model_->elasticity().elements()[element];
  const ElasticState& elastic = state_->elastic;
  const double mu = elastic.stiffness_scale * e.mu, lambda = elastic.stiffness_scale * e.lambda;
  const auto pad = [](const Vec3& v) { return Vec4(v[0], v[1], v[2], 0.0); };
  const Mat3 rotation = grip().matrix();
  std::array<Vec3, 4> arm;
  std::array<Vec4, 4> c;
  Vec4 sum = Vec4::Zero(), moment = Vec4::Zero();
  std::array<Vec4, 3> spread{Vec4::Zero(), Vec4::Zero(), Vec4::Zero()};
  for (int j = 0; j < 4; ++j) {
    c[j] = pad(elastic.rotations[element] * e.gradient[j]);
    const int attached = model_->attachedIndex()[e.node[j]];
    if (attached < 0) continue;
    arm[j] = rotation * handle().offsets[attached];
    sum += c[j];
    moment += pad(arm[j].cross(c[j].head<3>()));
    for (int k = 0; k < 3; ++k) spread[k] += mu * arm[j][k] * c[j];
  }
  const bool tense = !tension_.empty() && !tension_[element].isZero(0.0);
  const Mat3 p = tense ? Mat3(std::sqrt(elastic.stiffness_scale) * tension_[element]) : Mat3::Zero();
  Eigen::Matrix<double, 3, 6> turning = Eigen::Matrix<double, 3, 6>::Zero();  // sum of B_j^T G_j
  const auto gather = [&](auto transposed, auto& out) {
    for (int j = 0; j < 4; ++j) {
      if (model_->attachedIndex()[e.node[j]] < 0) continue;
      const auto b = transposed(Vec3(c[j].head<3>()));
      out.template leftCols<3>() += b;
      out.template rightCols<3>() -= b * skew(arm[j]);
    }
  };
  if (tense) gather([&](const Vec3& cj) { return Mat3((skew(cj) * p).transpose()); }, turning);
  const FlatElement* flat = flatElement(elastic.flat, element);
  Mat6 pressed = Mat6::Zero();  // the same for a flat element's B
  if (flat != nullptr) {
    const double scale = elastic.stiffness_scale;
    gather([&](const Vec3& cj) { return Eigen::Matrix<double, 6, 3>(scale * flat->factor(cj).transpose()); }, pressed);
  }
  const Vec4 stretched = lambda * sum, turned = lambda * moment, sheared = mu * sum;
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
    if (tense) kg.topRows<3>() += skew(ci.head<3>()) * p * turning;
    if (flat != nullptr) kg.topRows<3>() += flat->factor(ci.head<3>()) * pressed;
    const int free = row(e.node[i]);
    if (free >= 0) {
      pulled_.middleCols<6>(6 * free) += kg;
    } else if (model_->attachedIndex()[e.node[i]] >= 0) {
      gkg_.topRows<3>() += kg.topRows<3>();
      gkg_.bottomRows<3>() += skew(arm[i]) * kg.topRows<3>();
    }
  }
}

// Elastic forces of the attached nodes, weight and gyroscopic torque, about the handle's origin.
Vec6 BodySystem::handleWrench() const {
  Vec6 wrench = Vec6::Zero();
  for (std::size_t k = 0; k < handle().nodes.size(); ++k) {
    const Vec3 force = f_.segment<3>(3 * handle().nodes[k]);
    wrench.head<3>() += force;
    wrench.tail<3>() += (grip().rotation * handle().offsets[k]).cross(force);
  }
  wrench.head<3>() += handle().mass * input_.gravity;  // no moment: the origin is the center of mass
  if (turns_) return wrench;                           // the torque is in what its velocity becomes
  const Mat3 inertia = handle().worldInertia(start_.pose);
  const Vec3 w = start_.twist.tail<3>();
  wrench.tail<3>() -= w.cross(inertia * w);
  return wrench;
}

// A_hh and its right-hand side.
void BodySystem::assembleHandle() {
  const double h = input_.step;
  const double drag = h * model_->elasticity().material().damping_alpha;
  const Pose& pose = turns_ ? turned_grip_ : start_.pose;
  const Mat3 rotation = pose.matrix();
  Vec6 wrench = handleWrench();
  mass0_ = handle().massMatrix(pose);
  a_hh_ = mass0_ + c_ * gkg_;
  a_hh_.topLeftCorner<3, 3>().diagonal().array() += drag * handle().attached_mass;
  a_hh_.bottomRightCorner<3, 3>() += drag * rotation * handle().attached_inertia * rotation.transpose();
  if (follows()) {
    weighDown();
    return;
  }
  if (model_->held()) addLink(wrench);
  b_h_ = mass0_ * (turns_ ? Vec6(carried_grip_ + grip_gain_) : start_.twist) + h * wrench;
  if (frameCorrected()) b_h_ += mass0_ * correction_.velocity;
}

// Of a rigid tool that is led: what link and weight have beyond what its motion takes. How hard it presses on what it
// touches follows from nothing else, as its path ends where they touch and not deeper.
Vec6 BodySystem::leftToContact() const {
  const Vec6 gained = (input_.followed.end.twist - start_.twist) / input_.step;
  return handleWrench() + input_.followed.link - mass0_ * gained;
}

// The reaction of the tool moves a handle on its path by less than a ten thousandth of what it moves a free one; of a
// rigid tool, which has reactions where its path is off by a micrometer, by ten times as much.
void BodySystem::weighDown() {
  const double heavy = model_->isRigid() ? 1e3 : 1e4;
  a_hh_.diagonal().head<3>().array() += heavy * a_hh_.topLeftCorner<3, 3>().trace();
  a_hh_.diagonal().tail<3>().array() += heavy * a_hh_.bottomRightCorner<3, 3>().trace();
}

void BodySystem::addLink(Vec6& wrench) {
  const double h = input_.step;
  const Pose& device = input_.device.pose;
  wrench -= linkWrenchOnDevice(input_.link, start_.pose, Vec6::Zero(), device, input_.device.twist);
  a_hh_.topLeftCorner<3, 3>().diagonal().array() += h * (input_.link.damping + h * input_.link.stiffness);
  // log(exp(h w) R Rd^T) = theta + h Jl^-1 w: its symmetric part keeps A symmetric, and positive up to |theta| = pi.
  const Vec3 theta = logRotation(start_.pose.rotation * device.rotation.conjugate());
  const Mat3 jacobian = leftJacobianInverse(theta);
  a_hh_.bottomRightCorner<3, 3>() += h * input_.link.rotational_damping * Mat3::Identity() +
                                     h * h * input_.link.rotational_stiffness * 0.5 * (jacobian + jacobian.transpose());
}

OrderFit BodySystem::contactNodesFit(const std::vector<int>& needed) {
  FactorOrder& order = state_->order;
  if (order.chosen && !isAnalyzed(order)) analyze(order);
  int missing = 0;
  int free = 0;
  seen_.assign(model_->row().size(), 0);
  for (const int n : needed) {
    if (row(n) < 0 || seen_[n]) continue;
    seen_[n] = 1;
    ++free;
    if (trailing_[n] < 0) ++missing;
  }
  constexpr int kSlack = 12;     // nodes
  constexpr int kPatience = 20;  // steps
  const bool surplus = static_cast<int>(order.last_nodes.size()) > 3 * free + kSlack;
  order.surplus_steps = surplus ? order.surplus_steps + 1 : 0;
  if (!order.chosen || order.surplus_steps >= kPatience) return OrderFit::outdated;
  return missing > 0 && nodes_last_ ? OrderFit::lacks : OrderFit::good;
}

bool BodySystem::lacksNodes(const ContactPoint& point, int self) const {
  if (point.body != self || !nodes_last_) return false;
  for (int k = 0; k < point.count; ++k) {
    if (row(point.node[k]) >= 0 && trailing_[point.node[k]] < 0) return true;
  }
  return false;
}

void BodySystem::orderContactNodes(const std::vector<int>& nodes) {
  state_->order = {true, {}, 0, 0};
  appendContactNodes(nodes);
  state_->order.sought = static_cast<int>(state_->order.last_nodes.size());
  analyze(state_->order);
}

void BodySystem::addContactNodes(const std::vector<int>& nodes) {
  constexpr double kDearer = 1.3;  // times the operations of the order that was sought
  FactorOrder& order = state_->order;
  appendContactNodes(nodes);
  analyze(order);
  if (!nodes_last_ || factor_.statistics().flops < kDearer * factor_.statistics().sought_flops) return;
  order.sought = static_cast<int>(order.last_nodes.size());
  analyze(order);
}

// Free ones, each once.
void BodySystem::appendContactNodes(const std::vector<int>& nodes) {
  std::vector<int>& last = state_->order.last_nodes;
  seen_.assign(model_->row().size(), 0);
  for (const int n : last) seen_[n] = 1;
  for (const int n : nodes) {
    if (row(n) < 0 || seen_[n]) continue;
    seen_[n] = 1;
    last.push_back(n);
  }
}

bool BodySystem::isAnalyzed(const FactorOrder& order) const {
  return analyses_ > 0 && order_.last_nodes == order.last_nodes && order_.sought == order.sought;
}

// Symbolic analysis of A_tt.
void BodySystem::analyze(const FactorOrder& order) {
  constexpr std::size_t kMany = 64;  // nodes; fewer are last in any case
  if (turned_) {                     // what is prepared has the order of before
    turned_ = false;
    prepared_.ready = false;
    assembleMatrix(input_.step, state_->elastic);
  }
  const std::vector<int>& nodes = order.last_nodes;
  order_ = order;
  std::fill(trailing_.begin(), trailing_.end(), -1);
  std::vector<int> rows;
  rows.reserve(nodes.size());
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    trailing_[nodes[k]] = static_cast<int>(k);
    rows.push_back(row(nodes[k]));
  }
  if (!nodes_last_) std::swap(factor_, spare_);
  nodes_last_ = true;
  if (!model_->free().empty()) factor_.extend(a_, rows, static_cast<std::size_t>(order.sought));
  if (rows.size() >= kMany) {
    // operations of the factor and of W for a contact on each node, either way
    const double dense = 3.0 * static_cast<double>(rows.size());
    const double last = factor_.statistics().flops + 2.0 * dense * dense * dense;
    if (spare_.statistics().dof == 0) spare_.analyze(a_);
    if (spare_.statistics().flops + spare_.gramOperations(rows) < last) {
      std::swap(factor_, spare_);
      nodes_last_ = false;
    }
  }
  ++analyses_;
}

bool BodySystem::factorize() { return turned_ || model_->free().empty() || factor_.factorize(a_); }

void BodySystem::solveFree() {
  solution_ = rhs_;
  if (!model_->free().empty()) solve(solution_);
  if (!model_->framed()) {
    v_free_ = solution_.col(0);
    if (corrected() || turns_) v_free_ += carried_;
  } else {
    // X^T b = A_th^T A_tt^-1 b, so one solve for all seven columns is enough
    x_th_ = solution_.leftCols(6);
    const Eigen::Matrix<double, 6, 6> q = a_th_.transpose() * x_th_;
    const Eigen::Matrix<double, 6, 6> s = a_hh_ - 0.5 * (q + q.transpose());
    s_inverse_ = inverse(s);
    if (follows()) {
      u_path_ = u_free_ = poseDifference(input_.followed.end.pose, start_.pose) / input_.step;
      if (model_->isRigid()) u_free_ += s_inverse_ * (input_.step * leftToContact());
      v_free_ = carried_ + solution_.col(6);
    } else {
      u_free_ = s_inverse_ * (b_h_ - a_th_.transpose() * solution_.col(6));
      if (frameCorrected()) u_free_ += correction_.shift / input_.step;
      v_free_ = solution_.col(6) - x_th_ * u_free_;
      if (turns_) v_free_ += carried_;
    }
  }
  v_end_ = v_free_;
  u_end_ = u_free_;
  on_handle_.setZero();
  resisting_ = 0;
}

// From the step's own equations, so that momentum adds up to rounding: for a fixed node with the velocity v
//     m (v - v0) = h (f + m g - alpha m v + r) - c sum K v + contact impulse
std::vector<std::vector<Vec3>> BodySystem::nodeAttachmentForces() const {
  const double h = input_.step;
  const ElasticMesh& fem = model_->elasticity();
  const VecX loads = besideFixed([&](int n) { return nodeEndVelocity(n); });
  std::vector<std::vector<Vec3>> out;
  for (const Attachment& attachment : model_->attachments()) {
    std::vector<Vec3>& forces = out.emplace_back();
    for (std::size_t k = 0; k < attachment.nodes.size(); ++k) {
      const int n = attachment.nodes[k];
      const Vec3 v = nodeEndVelocity(n);
      if (attachment.fixed()) {
        const Vec3 inertia = fem.mass()[n] * ((v - start_velocities_.segment<3>(3 * n)) / h +
                                              fem.material().damping_alpha * v - input_.gravity);
        forces.push_back(loads.segment<3>(3 * n) / h - f_.segment<3>(3 * n) + inertia);
        if (on_fixed_.size() > 0) forces.back() -= on_fixed_.segment<3>(3 * n) / h;
      } else if (attachment.glued) {
        forces.push_back(on_glued_.size() > 0 ? Vec3(on_glued_.segment<3>(3 * n) / h) : Vec3(Vec3::Zero()));
      } else if (row(n) >= 0) {
        const auto at = static_cast<Eigen::Index>(k);
        const Vec3 way = x0_.segment<3>(3 * n) + h * v - anchors_.segment<3>(3 * n);
        forces.push_back(-attachment.stiffness[at] * way - attachment.damping[at] * v);
      } else {
        forces.push_back(Vec3::Zero());
      }
    }
  }
  return out;
}

Vec3 BodySystem::startMiddle(const Attachment& attachment) const {
  Vec3 sum = Vec3::Zero();
  for (const int n : attachment.nodes) sum += x0_.segment<3>(3 * n);
  return sum / static_cast<double>(attachment.nodes.size());
}

std::vector<AttachmentForce> BodySystem::attachmentForces() const {
  std::vector<AttachmentForce> out;
  const auto forces = nodeAttachmentForces();
  for (std::size_t a = 0; a < forces.size(); ++a) {
    const Attachment& attachment = model_->attachments()[a];
    AttachmentForce& sum = out.emplace_back();
    const Vec3 middle = attachment.glued ? startMiddle(attachment) : attachment.middle;
    for (std::size_t k = 0; k < forces[a].size(); ++k) {
      sum.force += forces[a][k];
      sum.moment += (x0_.segment<3>(3 * attachment.nodes[k]) - middle).cross(forces[a][k]);
    }
  }
  return out;
}

// Of fixed nodes along their way, and of springs' far ends along theirs.
double BodySystem::attachmentWork() const {
  if (!model_->driven()) return 0;
  const VecX before = model_->anchors(input_.end_time - input_.step);
  const auto forces = nodeAttachmentForces();
  double work = 0;
  for (std::size_t a = 0; a < forces.size(); ++a) {
    const Attachment& attachment = model_->attachments()[a];
    if (attachment.glued) continue;  // what one body gets, the other gives
    for (std::size_t k = 0; k < forces[a].size(); ++k) {
      const int n = attachment.nodes[k];
      const Vec3 from = attachment.fixed() ? x0_.segment<3>(3 * n) : before.segment<3>(3 * n);
      work += forces[a][k].dot(anchors_.segment<3>(3 * n) - from);
    }
  }
  return work;
}

double BodySystem::correctionEnergy(double elastic) {
  if (corrected()) return shiftEnergy(elastic);
  if (frameCorrected()) {
    const VecX& more = correction_.velocity;
    return (start_.twist + 0.5 * more).dot(mass0_ * more) -
           handle().mass * input_.gravity.dot(correction_.shift.head<3>());
  }
  if (!follows()) return 0;
  const FollowedHandle& followed = input_.followed;
  double energy = 0;
  if (followed.shift.size() > 0) {
    energy = moved_energy_ - (elastic - springEnergyAt(x0_));
    // gravity's work is counted along the whole way, of which the shift is no motion
    const Vec3 down = followed.end.pose.rotation.conjugate() * input_.gravity;
    for (int r = 0; r < model_->freeNodes(); ++r) {
      energy -= model_->elasticity().mass()[model_->free()[r]] * down.dot(followed.shift.segment<3>(3 * r));
    }
  }
  if (followed.velocity.size() == 0) return energy;
  const Mat3 turn = start_.pose.matrix();
  for (int r = 0; r < model_->freeNodes(); ++r) {
    const int i = model_->free()[r];
    const Vec3 before = start_velocities_.segment<3>(3 * i), more = turn * followed.velocity.segment<3>(3 * r);
    energy += model_->elasticity().mass()[i] * (before + 0.5 * more).dot(more);
  }
  return energy;
}

// Of springs to the world at the start of the step.
double BodySystem::springEnergyAt(const VecX& x) const {
  return model_->springStiffness().size() > 0 ? model_->springEnergy(x, model_->anchors(input_.end_time - input_.step))
                                              : 0.0;
}

double BodySystem::shiftEnergy(double elastic) const {
  double energy = moved_energy_ + springEnergyAt(moved_) - elastic;
  for (int r = 0; r < model_->freeNodes(); ++r) {
    const int i = model_->free()[r];
    const Vec3 before = start_velocities_.segment<3>(3 * i), more = correction_.velocity.segment<3>(3 * r);
    energy += model_->elasticity().mass()[i] *
              ((before + 0.5 * more).dot(more) - input_.gravity.dot(correction_.shift.segment<3>(3 * r)));
  }
  return energy;
}

Vec6 BodySystem::wrenchOnHandle(const BodyState& end) const {
  Vec6 wrench = Vec6::Zero();
  if (!ahead_.isFor(end.positions)) return wrench;
  for (std::size_t k = 0; k < handle().nodes.size(); ++k) {
    const Vec3 force = ahead_.forces.segment<3>(3 * handle().nodes[k]);
    wrench.head<3>() += force;
    wrench.tail<3>() += (end.handle.pose.rotation * handle().offsets[k]).cross(force);
  }
  if (!follows()) return wrench;
  wrench += on_handle_ / input_.step;
  return wrench - model_->elasticity().material().damping_beta / c_ * (a_th_.transpose() * (v_end_ - carried_));
}

Vec3 BodySystem::leadingForce(const BodyState& end) const {
  const Vec3 gained = (end.handle.twist - start_.twist).head<3>() / input_.step;
  return handle().mass * (gained - input_.gravity) - wrenchOnHandle(end).head<3>();
}

bool BodySystem::resists() const {
  constexpr double kFar = 2.0;  // of what it may: with less, the tool's inertia and elasticity decide
  return follows() && resisting_ > kFar * input_.followed.largest_force;
}

bool BodySystem::advance() {
  if (!endIsFinite()) return false;
  expected_.reset();
  BodyState& state = *state_;
  endPositions(state.positions);
  const bool shifted = follows() && input_.followed.shift.size() > 0;
  for (int r = 0; r < model_->freeNodes(); ++r) {
    Vec3 v = v_end_.segment<3>(3 * r);
    // a correction is no motion
    if (corrected()) v -= carried_.segment<3>(3 * r);
    if (turns_) {  // no chord's, but where it ends
      v += velocityThere(moved_.segment<3>(3 * model_->free()[r])) - carried_.segment<3>(3 * r);
    }
    if (shifted) v -= input_.followed.end.pose.rotation * input_.followed.shift.segment<3>(3 * r) / input_.step;
    state.velocities.segment<3>(3 * model_->free()[r]) = v;
  }
  if (model_->driven()) {
    for (const Attachment& attachment : model_->attachments()) {
      if (!attachment.fixed()) continue;
      for (const int n : attachment.nodes) state.velocities.segment<3>(3 * n) = fixedVelocity(n);
    }
  }
  if (model_->framed()) {
    // on its path it has the velocity recorded there, not the mean one
    Vec6 twist = follows() ? Vec6(input_.followed.end.twist + u_end_ - u_path_) : u_end_;
    if (frameCorrected()) twist -= correction_.shift / input_.step;
    if (turns_) twist.head<3>() += velocityThere(turned_grip_.position) - carried_grip_.head<3>();
    model_->setHandle({palpate::advance(start_.pose, input_.step * u_end_), twist}, state);
  }
  return true;
}

void BodySystem::retreat() {
  if (mayTurn()) expected_ = rigidWay(*state_);
  state_->positions = x0_;
  state_->velocities = start_velocities_;
  state_->handle = start_;
  ahead_.clear();
}

}  // namespace palpate
