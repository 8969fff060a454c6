#include "palpate/one_d/live.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace palpate::one_d {
namespace {

constexpr double kLeastCompliance = 1e-7;  // of the contact, which the mode alone gives way [m/N]

Vec6 along(double v) {
  Vec6 twist = Vec6::Zero();
  twist[0] = v;
  return twist;
}

Pose at(double x) {
  Pose pose;
  pose.position.x() = x;
  return pose;
}

// Backward Euler of the tool while the handle moves to where its path ends; the wall stops it.
PointState followed(const Parameters& p, const PointState& tool, const PointState& from, const PointState& to,
                    double h) {
  const double mean = (to.x - from.x) / h;
  const double a = p.tool_mass / h + p.spring_damping + h * p.spring_stiffness;
  const double b =
      p.tool_mass / h * tool.v + p.spring_stiffness * (to.x - p.rest_length - tool.x) + p.spring_damping * mean;
  const double v = std::max(b / a, -tool.x / h);
  return {tool.x + h * v, v};
}

}  // namespace

LiveRun::LiveRun(const Config& config, double visual_dt, double latency)
    : parameters_(config.parameters), dt_(config.haptic_dt), timing_(timingOf(config, visual_dt, latency)) {
  visual_ = shown_ = restAtStart(config);
  pose_ = at(visual_.handle.x);
  path_.add({0, pose_, twist_});
  newest_ = used_ = modelOf(visual_, 0);
  state_ = startState(used_);
}

PointState LiveRun::handleAt(std::int64_t index) const {
  return {path_[index].pose.position.x(), path_[index].twist[0]};
}

// The tool as one mass-normalized mode with the handle fixed, in the handle's frame; mass times stiffness is exact.
LiveModel LiveRun::modelOf(const ToolState& state, std::int64_t index) const {
  const Parameters& p = parameters_;
  const double y = state.tool.x - state.handle.x, root = std::sqrt(p.tool_mass);
  const double stretch = state.handle.x - p.rest_length - state.tool.x;
  LiveModel m;
  m.index = index;
  m.pose = at(state.handle.x);
  m.twist = along(state.handle.v);
  m.mass = p.handle_mass + p.tool_mass;
  m.moment = Vec3(p.tool_mass * y, 0, 0);
  m.inertia.setIdentity();  // nothing turns
  m.inertia.topLeftCorner<3, 3>() *= m.mass;
  // without a spring there is nothing for the damper to be proportional to
  m.beta = p.spring_stiffness > 0 ? p.spring_damping / p.spring_stiffness : 0.0;
  m.elastic_energy = 0.5 * p.spring_stiffness * stretch * stretch;
  m.squared_frequency = ModalVector::Constant(1, std::max(p.spring_stiffness / p.tool_mass, 1.0));
  m.damping = m.beta * m.squared_frequency;
  m.force = ModalVector::Constant(1, p.spring_stiffness * stretch / root);
  m.speed = ModalVector::Constant(1, root * (state.tool.v - state.handle.v));
  m.coupling.setZero(6, 1);
  m.coupling(0, 0) = root;
  m.centrifugal.setZero(1, 6);
  for (int k = 0; k < 3; ++k) {
    m.coriolis[k].setZero(1, 1);
    m.coriolis_torque[k].setZero(3, 1);
  }
  m.contacts = 1;
  m.surface[0].normal = Vec3::UnitX();
  m.arm = RowVector::Zero(3);
  m.arm[0] = y;
  m.shape.setZero(3, 1);
  m.shape(0, 0) = 1.0 / root;
  m.compliance.setIdentity(3, 3);
  m.compliance *= kLeastCompliance;
  m.tool_compliance = m.compliance;
  m.damped_force.setZero(3);
  m.contact_force.setZero(3);
  m.curvature.resize(3, 0);
  return m;
}

// Along the path since the last step; the replayed mode takes the place of the coarse step's.
void LiveRun::takeStep(std::size_t tick) {
  const std::int64_t now = path_.end() - 1, last = std::max(newest_.index, path_.first());
  const PointState from = handleAt(last), to = handleAt(now);
  LiveState replayed;
  if (now > last) {
    visual_.tool = followed(parameters_, visual_.tool, from, to, static_cast<double>(now - last) * dt_);
    visual_.handle = to;
    const double root = std::sqrt(parameters_.tool_mass), y = newest_.arm[0];
    if (live_tick_.replayAll(now, newest_, dt_, Vec3::Zero(), path_, replayed)) {
      visual_.tool = {to.x + y + replayed.z[0] / root, to.v + replayed.speed[0] / root};
    }
    LiveModel model = modelOf(visual_, now);
    model.contact_force = replayed.contact_force;
    model.damped_force = replayed.damped_force;
    newest_ = model;
  }
  underway_.push_back({tick + timing_.delay, visual_, newest_});
}

double LiveRun::tick(std::size_t tick, const PointState& device) {
  if (tick % timing_.period == 0) takeStep(tick);
  while (!underway_.empty() && underway_.front().arrival <= tick) {
    const Message& message = underway_.front();
    shown_ = message.state;
    LiveState state;
    if (live_tick_.replayAll(path_.end() - 1, message.model, dt_, Vec3::Zero(), path_, state)) {
      used_ = message.model;
      state_ = state;
    }
    underway_.pop_front();
  }
  const LinkParameters link{parameters_.link_stiffness, parameters_.link_damping, 1.0, 1.0};
  const LiveTickInput input{dt_, Vec3::Zero(), link, at(device.x), along(device.v)};
  twist_ = live_tick_.step(used_, input, pose_, twist_, state_);
  pose_.position += dt_ * twist_.head<3>();
  path_.add({path_.end(), pose_, twist_});
  return linkForce(parameters_, {pose_.position.x(), twist_[0]}, device);
}

}  // namespace palpate::one_d
