#include "palpate/one_d/model.h"

#include <algorithm>
#include <cstddef>

namespace palpate::one_d {

namespace {

/// A knot counts as reached this much before its time [s], so that rounding in i * dt does not choose the side.
constexpr double kKnotTolerance = 1e-9;

/// The matrix of the step, [[hh, ht], [ht, tt]], on the velocities of handle and tool.
struct StepMatrix {
  double hh, ht, tt;
};

StepMatrix stepMatrix(const Parameters& p, double h) {
  const double spring = h * p.spring_damping + h * h * p.spring_stiffness;
  const double link = h * p.link_damping + h * h * p.link_stiffness;
  return {p.handle_mass + spring + link, -spring, p.tool_mass + spring};
}

struct Velocities {
  double handle, tool;
};

Velocities solveFree(const StepMatrix& a, double handle_rhs, double tool_rhs) {
  const double determinant = a.hh * a.tt - a.ht * a.ht;
  return {(a.tt * handle_rhs - a.ht * tool_rhs) / determinant, (a.hh * tool_rhs - a.ht * handle_rhs) / determinant};
}

/// The same system with the tool's velocity prescribed by the wall.
Velocities solveAtWall(const StepMatrix& a, double handle_rhs, double tool_velocity) {
  return {(handle_rhs - a.ht * tool_velocity) / a.hh, tool_velocity};
}

}  // namespace

PointState deviceAt(const std::vector<Knot>& trajectory, double t) {
  const auto after = std::upper_bound(trajectory.begin(), trajectory.end(), t + kKnotTolerance,
                                      [](double time, const Knot& knot) { return time < knot.t; });
  if (after == trajectory.end()) return {trajectory.back().x, 0.0};
  if (after == trajectory.begin()) return {trajectory.front().x, 0.0};
  const Knot& a = *(after - 1);
  const Knot& b = *after;
  const double velocity = (b.x - a.x) / (b.t - a.t);
  return {a.x + velocity * (t - a.t), velocity};
}

StepResult visualStep(const Parameters& p, const ToolState& start, const PointState& device, double h) {
  const PointState& handle = start.handle;
  const PointState& tool = start.tool;
  const double stretch = handle.x - tool.x - p.rest_length;
  const double link = -p.link_stiffness * (handle.x - device.x) + p.link_damping * device.v;

  const StepMatrix a = stepMatrix(p, h);
  const double handle_rhs = p.handle_mass * handle.v + h * (-p.spring_stiffness * stretch + link);
  const double tool_rhs = p.tool_mass * tool.v + h * p.spring_stiffness * stretch;

  StepResult result;
  Velocities v = solveFree(a, handle_rhs, tool_rhs);
  if (tool.x + h * v.tool < 0.0) {
    result.wall_active = true;
    v = solveAtWall(a, handle_rhs, -tool.x / h);
    result.wall_impulse = a.ht * v.handle + a.tt * v.tool - tool_rhs;
  }
  result.state.handle = {handle.x + h * v.handle, v.handle};
  // At the wall, x + h (-x / h) may miss zero by a rounding error.
  result.state.tool = {result.wall_active ? 0.0 : tool.x + h * v.tool, v.tool};
  result.coupling = -p.spring_stiffness * (result.state.handle.x - result.state.tool.x - p.rest_length) -
                    p.spring_damping * (v.handle - v.tool);
  return result;
}

ForceModel linearize(const Parameters& p, const ToolState& start, const StepResult& result, double h) {
  // Residual of the step r(v; x0, u0) = A v - b - J^T lambda. For each input A dv = db + J^T dlambda, where J dv = 0 if
  // the wall is active: xt, and with it the constraint J v' = -xt / h, does not depend on the handle.
  const StepMatrix a = stepMatrix(p, h);
  const auto response = [&](double handle_db, double tool_db) {
    return result.wall_active ? solveAtWall(a, handle_db, 0.0) : solveFree(a, handle_db, tool_db);
  };
  const Velocities by_position =
      response(-h * (p.spring_stiffness + p.link_stiffness), h * p.spring_stiffness);  // db/dxh
  const Velocities by_velocity = response(p.handle_mass, 0.0);                         // db/dvh

  // Fc = -k (xh + h vh' - xt - h vt' - L) - b (vh' - vt')
  const double by_relative_velocity = -(h * p.spring_stiffness + p.spring_damping);
  ForceModel model;
  model.force = result.coupling;
  model.reference = start.handle;
  model.kx = -p.spring_stiffness + by_relative_velocity * (by_position.handle - by_position.tool);
  model.kv = by_relative_velocity * (by_velocity.handle - by_velocity.tool);
  return model;
}

PointState proxyTick(const Parameters& p, const ForceModel* model, const PointState& proxy, const PointState& device,
                     double dt) {
  // m (v' - v) / dt = F*c(x + dt v', v') - kd (x + dt v' - xd) - bd (v' - vd), solved for v'.
  const double kx = model ? model->kx : 0.0;
  const double kv = model ? model->kv : 0.0;
  const double inertia = p.handle_mass / dt;
  double rhs = inertia * proxy.v - p.link_stiffness * (proxy.x - device.x) + p.link_damping * device.v;
  if (model) rhs += model->force + kx * (proxy.x - model->reference.x) - kv * model->reference.v;
  const double velocity = rhs / (inertia + dt * (p.link_stiffness - kx) + p.link_damping - kv);
  return {proxy.x + dt * velocity, velocity};
}

double linkForce(const Parameters& p, const PointState& body, const PointState& device) {
  return p.link_stiffness * (body.x - device.x) + p.link_damping * (body.v - device.v);
}

}  // namespace palpate::one_d
