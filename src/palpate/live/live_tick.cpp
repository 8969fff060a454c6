#include "palpate/live/live_tick.h"

#include <algorithm>

#include "palpate/live/surface_touch.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

constexpr double kRigid = 1e-6;  // [m/N]: models have a tenth of that where nothing gives way

double filterShare(const LiveModel& model, double dt) { return dt / (model.beta + dt); }

Vec6 inFrame(const Mat3& rt, const Vec6& twist) {
  Vec6 out;
  out << rt * twist.head<3>(), rt * twist.tail<3>();
  return out;
}

// Mass times center, deformed, in the handle's frame.
Vec3 deformedMoment(const LiveModel& model, const LiveState& state) {
  Vec3 out = model.moment;
  addProduct(1.0, model.coupling.topRows<3>(), state.z.data(), out.data());
  return out;
}

// On the modes, where they are. What stress adds is not implicit: the tick stays short beside any motion by it.
ModalVector elasticForce(const LiveModel& model, const LiveState& state) {
  ModalVector out = model.force - model.squared_frequency.cwiseProduct(state.z);
  addProduct(-1.0, model.turning, state.z.data(), out.data());
  return out;
}

// What contacts hold of their own, under this force.
double contactEnergy(const LiveModel& model, const RowVector& force) {
  RowVector moved = RowVector::Zero(force.size());
  addProduct(1.0, model.compliance, force.data(), moved.data());
  return 0.5 * force.dot(moved);
}

}  // namespace

LiveState startState(const LiveModel& model) noexcept {
  LiveState state;
  state.index = model.index;
  state.z.setZero(model.modes());
  state.speed = model.speed;
  state.damped_force = model.damped_force;
  state.contact_force = model.contact_force;
  return state;
}

bool isFinite(const LiveState& state) noexcept {
  return state.z.allFinite() && state.speed.allFinite() && state.damped_force.allFinite() &&
         state.contact_force.allFinite();
}

bool isFinite(const LiveModel& model) noexcept {
  bool good = model.damping.allFinite() && model.torque.allFinite() && model.pose.allFinite() &&
              model.twist.allFinite() && std::isfinite(model.mass) && model.moment.allFinite() &&
              model.inertia.allFinite() && model.squared_frequency.allFinite() && model.turning.allFinite() &&
              model.force.allFinite() && model.speed.allFinite() && model.coupling.allFinite() &&
              model.centrifugal.allFinite() && model.arm.allFinite() && model.shape.allFinite() &&
              model.compliance.allFinite() && model.tool_compliance.allFinite() && model.damped_force.allFinite() &&
              model.contact_force.allFinite() && model.curvature.allFinite() && model.bearing.allFinite();
  for (int k = 0; k < 3; ++k) good = good && model.coriolis[k].allFinite() && model.coriolis_torque[k].allFinite();
  for (int i = 0; i < model.contacts; ++i) {
    const LiveSurface& s = model.surface[i];
    good = good && s.normal.allFinite() && s.bend.allFinite() && s.a.allFinite() && s.b.allFinite() &&
           std::isfinite(s.offset) && std::isfinite(s.load) && std::isfinite(model.friction[i]);
    for (const LiveSurface::Flat& f : s.flat) {
      good = good && f.direction.allFinite() && std::isfinite(f.least) && std::isfinite(f.greatest);
    }
  }
  return good;
}

// A, which depends on the link and on nothing that moves.
void LiveTick::factorHandle(const LiveModel& model, const LiveTickInput& input) noexcept {
  const int r = model.modes();
  const double rate = 1.0 / input.dt + model.alpha;
  TickCholesky::Matrix a(6 + r, 6 + r);
  a.topLeftCorner<6, 6>() = rate * model.inertia;
  a.topLeftCorner<3, 3>().diagonal().array() += input.link.stiffness * input.dt + input.link.damping;
  a.block<3, 3>(3, 3).diagonal().array() += input.link.rotational_stiffness * input.dt + input.link.rotational_damping;
  a.bottomLeftCorner(r, 6) = rate * model.coupling.transpose();
  a.bottomRightCorner(r, r).setZero();
  a.bottomRightCorner(r, r).diagonal() =
      (1.0 / input.dt + model.damping.array() + input.dt * model.squared_frequency.array()).matrix();
  factor_.factor(a, 6 + model.toolModes());
}

// -Q^T M (w x (w x y1) + 2 w x Q z')
void LiveTick::addSpin(const LiveModel& model, const LiveState& state, const Vec3& w,
                       ModalVector& modal) const noexcept {
  Vec6 squares;
  squares << w[0] * w[0], w[1] * w[1], w[2] * w[2], w[0] * w[1], w[0] * w[2], w[1] * w[2];
  addProduct(-1.0, model.centrifugal, squares.data(), modal.data());
  for (int k = 0; k < 3; ++k) addProduct(-2.0 * w[k], model.coriolis[k], state.speed.data(), modal.data());
}

// Rows and gaps of the contacts where they now are.
void LiveTick::placeContacts(const LiveModel& model, const LiveState& state, const Pose& pose, double dt) noexcept {
  const int m = model.contacts, r = model.modes(), q = model.second;
  const Mat3 rotation = pose.matrix();
  contacts_.count = m;
  contacts_.facets = model.facets;
  contacts_.supports = model.supports;
  if (model.supports > 0) {
    for (int k = 0; k < model.supports; ++k) contacts_.load[k] = model.surface[m - model.supports + k].load;
    addProduct(-1.0, model.bearing, model.contact_force.data(), contacts_.load.data());
    contacts_.bearing = model.bearing;
  }
  shape_ = model.shape;
  RowVector bent = model.arm;
  addProduct(1.0, model.shape.leftCols(model.toolModes()), state.z.data(), bent.data());
  for (int i = 0, c = 0; i < q; ++i) {
    for (int j = i; j < q; ++j, ++c) {
      const auto curve = model.curvature.col(c);
      bent += ((i == j ? 0.5 : 1.0) * state.z[i] * state.z[j]) * curve;
      shape_.col(i) += state.z[j] * curve;
      if (i != j) shape_.col(j) += state.z[i] * curve;
    }
  }
  const RowVector loaded = state.damped_force - model.damped_force;
  place_ = bent;
  addProduct(1.0, model.shape.rightCols(model.partner_modes), state.z.data() + model.toolModes(), place_.data());
  addProduct(1.0, model.compliance, loaded.data(), place_.data());
  if (model.partners_yield) {
    addProduct(1.0, model.tool_compliance, loaded.data(), bent.data());
  } else {
    bent = place_;
  }
  jacobian_.resize(3 * m, 6 + r);
  for (int i = 0; i < m; ++i) {
    contacts_.friction[i] = model.friction[i];
    const LiveSurface& surface = model.surface[i];
    contacts_.tied[i] = surface.kind == LiveSurface::Kind::tied;
    if (surface.kind == LiveSurface::Kind::support) {
      jacobian_.block<3, 6>(3 * i, 0).setZero();
      contacts_.normal[i] = surface.normal;
      contacts_.gap[i] = 0;
      continue;
    }
    if (surface.kind == LiveSurface::Kind::internal) {
      jacobian_.block<3, 6>(3 * i, 0).setZero();
      contacts_.normal[i] = surface.normal;
      contacts_.gap[i] = std::max(surface.normal.dot(place_.segment<3>(3 * i)) - surface.offset, -kRecoverySpeed * dt);
      continue;
    }
    if (surface.flat_directions > 0) {
      const Vec3 way = slideAlongFlat(surface, rotation, pose.position + rotation * place_.segment<3>(3 * i));
      place_.segment<3>(3 * i) += way;
      bent.segment<3>(3 * i) += way;
    }
    jacobian_.block<3, 3>(3 * i, 0).setIdentity();
    jacobian_.block<3, 3>(3 * i, 3) = -skew(bent.segment<3>(3 * i));
    if (contacts_.tied[i]) {
      const Vec3 away = rotation.transpose() * (pose.position - surface.a) + place_.segment<3>(3 * i);
      contacts_.away[i] = away * std::min(1.0, kRecoverySpeed * dt / std::max(away.norm(), 1e-12));
      contacts_.normal[i] = rotation.transpose() * surface.normal;
      continue;
    }
    const SurfaceTouch t = touch(surface, pose.position + rotation * place_.segment<3>(3 * i));
    contacts_.gap[i] = std::max(t.gap, -kRecoverySpeed * dt);
    contacts_.normal[i] = rotation.transpose() * t.normal;
  }
  jacobian_.rightCols(r) = shape_;
  if (model.facets == 0) return;
  for (int i = 0; i < m; ++i) {
    const Vec3& n = contacts_.normal[i];
    const Vec3 axis = rotation.transpose() * (std::abs((rotation * n).x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY());
    contacts_.tangent[i] = (axis - n.dot(axis) * n).normalized();
  }
}

Vec6 LiveTick::step(const LiveModel& model, const LiveTickInput& input, const Pose& pose, const Vec6& twist,
                    LiveState& state) noexcept {
  const int r = model.modes();
  const double dt = input.dt, share = filterShare(model, dt);
  const Mat3 rotation = pose.matrix(), rt = rotation.transpose();
  const Vec6 u = inFrame(rt, twist);
  const Vec3 g = rt * input.gravity, w = u.tail<3>();
  const LinkParameters& link = input.link;

  TickUnknowns b(6 + r);
  Vec6 momentum = model.inertia * u;
  addProduct(1.0, model.coupling, state.speed.data(), momentum.data());
  b.head<6>() = momentum / dt;
  b.segment<3>(0) +=
      rt * (link.stiffness * (input.device.position - pose.position) + link.damping * input.device_twist.head<3>());
  b.segment<3>(3) += rt * (link.rotational_damping * input.device_twist.tail<3>() -
                           link.rotational_stiffness * logRotation(pose.rotation * input.device.rotation.conjugate()));
  const Vec3 shifted = deformedMoment(model, state);
  Vec3 flow = Vec3::Zero();
  addProduct(1.0, model.coupling.topRows<3>(), state.speed.data(), flow.data());
  b.segment<3>(0) += model.mass * g - w.cross(w.cross(model.moment)) - 2.0 * w.cross(flow);
  b.segment<3>(3) += model.torque + shifted.cross(g) - w.cross(model.inertia.bottomRightCorner<3, 3>() * w);
  for (int k = 0; k < 3; ++k) addProduct(-2.0 * w[k], model.coriolis_torque[k], state.speed.data(), b.data() + 3);
  ModalVector modal = elasticForce(model, state);
  addTransposed(1.0, model.coupling.topRows<3>(), g.data(), modal.data());
  addSpin(model, state, w, modal);
  ModalVector before = state.speed;
  addTransposed(1.0, model.coupling, u.data(), before.data());
  b.tail(r) = before / dt + modal;

  factorHandle(model, input);
  TickUnknowns& y = b;
  factor_.solve(y);
  if (model.contacts > 0) {
    placeContacts(model, state, pose, dt);
    contacts_.free.setZero(3 * model.contacts);
    addProduct(dt, jacobian_, y.data(), contacts_.free.data());
    addProduct(-share, model.compliance, state.damped_force.data(), contacts_.free.data());
    if (contacts_.any()) {
      factor_.solveLower(jacobian_);  // L^-1 J^T, transposed, from here on
      contacts_.compliance = share * model.compliance;
      addGram(dt, jacobian_, contacts_.compliance);
      sweep(contacts_, kSweeps, state.contact_force);
      TickUnknowns push = TickUnknowns::Zero(6 + r);
      addTransposed(1.0, jacobian_, state.contact_force.data(), push.data());
      factor_.solveUpper(push);
      y += push;
    } else {
      state.contact_force.setZero();
    }
  }
  state.speed = y.tail(r);
  state.z += dt * state.speed;
  state.damped_force += share * (state.contact_force - state.damped_force);
  ++state.index;
  Vec6 out;
  out << rotation * y.segment<3>(0), rotation * y.segment<3>(3);
  return out;
}

// Where the handle itself touches what is fixed, nothing gives way while it moves as recorded: pressed into that by the
// model before, it would be given any force. It gets what would stop the tool.
void LiveTick::yieldWhereRigid(const LiveModel& model, double dt) noexcept {
  for (int k = 0; k < 3 * model.contacts; ++k) {
    if (model.compliance(k, k) < kRigid && shape_.row(k).isZero(0.0))
      contacts_.compliance(k, k) += dt * dt / model.mass;
  }
}

void LiveTick::replay(const LiveModel& model, double dt, const Vec3& gravity, const PathPoint& from,
                      const PathPoint& to, LiveState& state) noexcept {
  replay_known_ = false;
  replayNext(model, dt, gravity, from, to, state);
}

// How contacts give way does not change along the path but by the shape's second order.
void LiveTick::replayNext(const LiveModel& model, double dt, const Vec3& gravity, const PathPoint& from,
                          const PathPoint& to, LiveState& state) noexcept {
  const int r = model.modes();
  const double share = filterShare(model, dt);
  const Mat3 rotation = from.pose.matrix(), rt = rotation.transpose();
  const Vec6 u = inFrame(rt, from.twist), next = inFrame(rt, to.twist);
  const Vec3 g = rt * gravity;
  inverse_ = (1.0 / dt + model.damping.array() + dt * model.squared_frequency.array()).inverse().matrix();
  ModalVector modal = elasticForce(model, state);
  addTransposed(1.0, model.coupling.topRows<3>(), g.data(), modal.data());
  const Vec6 pulled = (next - u) / dt + model.alpha * next;
  addTransposed(-1.0, model.coupling, pulled.data(), modal.data());
  addSpin(model, state, u.tail<3>(), modal);
  ModalVector y = inverse_.cwiseProduct(state.speed / dt + modal);
  if (model.contacts > 0) {
    placeContacts(model, state, from.pose, dt);
    contacts_.free.setZero(3 * model.contacts);
    addProduct(dt, shape_, y.data(), contacts_.free.data());
    addProduct(-share, model.compliance, state.damped_force.data(), contacts_.free.data());
    const Mat3 turned = rt * to.pose.matrix() - Mat3::Identity();
    const Vec3 moved = rt * (to.pose.position - from.pose.position);
    for (int i = 0; i < model.contacts; ++i) {
      const LiveSurface::Kind kind = model.surface[i].kind;
      if (kind == LiveSurface::Kind::internal || kind == LiveSurface::Kind::support) continue;
      contacts_.free.segment<3>(3 * i) += moved + turned * place_.segment<3>(3 * i);
    }
    if (contacts_.any()) {
      if (!replay_known_) {
        const BoundedMatrix<LiveSize::kRows, LiveSize::kModes> scaled =
            shape_ * (dt * inverse_).cwiseSqrt().asDiagonal();
        contacts_.compliance = share * model.compliance;
        addGram(1.0, scaled, contacts_.compliance);
        yieldWhereRigid(model, dt);
        replay_known_ = model.second == 0;
      }
      sweep(contacts_, kSweeps, state.contact_force);
      ModalVector push = ModalVector::Zero(r);
      addTransposed(1.0, shape_, state.contact_force.data(), push.data());
      y += inverse_.cwiseProduct(push);
    } else {
      state.contact_force.setZero();
    }
  }
  state.speed = y;
  state.z += dt * y;
  state.damped_force += share * (state.contact_force - state.damped_force);
  state.index = to.index;
}

bool LiveTick::replayTo(std::int64_t index, int most, const LiveModel& model, double dt, const Vec3& gravity,
                        const HandlePath& path, LiveState& state) noexcept {
  replay_known_ = false;
  for (int k = 0; k < most && state.index < index; ++k) {
    if (!path.holds(state.index) || !path.holds(state.index + 1)) return false;
    replayNext(model, dt, gravity, path[state.index], path[state.index + 1], state);
  }
  return true;
}

bool LiveTick::replayAll(std::int64_t index, const LiveModel& model, double dt, const Vec3& gravity,
                         const HandlePath& path, LiveState& state) noexcept {
  state = startState(model);
  return replayTo(index, static_cast<int>(HandlePath::kCapacity), model, dt, gravity, path, state) &&
         state.index == index;
}

double liveEnergy(const LiveModel& model, const LiveState& state, const Pose& pose, const Vec6& twist,
                  const Vec3& gravity) noexcept {
  const Mat3 rt = pose.matrix().transpose();
  const Vec6 u = inFrame(rt, twist);
  const Vec3 g = rt * gravity;
  Vec6 flow = Vec6::Zero();
  addProduct(1.0, model.coupling, state.speed.data(), flow.data());
  double energy = 0.5 * u.dot(model.inertia * u) + u.dot(flow) + 0.5 * state.speed.squaredNorm() +
                  model.elastic_energy - 0.5 * state.z.dot(model.force + elasticForce(model, state));
  if (model.contacts > 0) {
    energy += contactEnergy(model, state.damped_force) - contactEnergy(model, model.damped_force);
  }
  return energy - model.mass * gravity.dot(pose.position) - deformedMoment(model, state).dot(g);
}

}  // namespace palpate
