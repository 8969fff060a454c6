#pragma once

#include <vector>

namespace palpate::one_d {

/// Corner of the prescribed motion of the device: position x [m] at time t [s]; straight lines in between.
struct Knot {
  double t = 0.0;
  double x = 0.0;
};

/// Constants of the model: a handle and a tool on a line, a spring and damper between them, a wall at x = 0 that the
/// tool cannot pass, and the link that pulls the handle (and the proxy) towards the device.
struct Parameters {
  double handle_mass = 0.05;        ///< mh [kg]
  double tool_mass = 0.05;          ///< mt [kg]
  double spring_stiffness = 200.0;  ///< k [N/m]
  double spring_damping = 0.5;      ///< b [N s/m]
  double rest_length = 0.1;         ///< L [m]; the tool rests at xh - L
  double link_stiffness = 1000.0;   ///< kd [N/m]
  double link_damping = 5.0;        ///< bd [N s/m]
};

/// Position [m] and velocity [m/s] of the device, the handle, the tool or the proxy.
struct PointState {
  double x = 0.0;
  double v = 0.0;
};

/// State of the visual simulation.
struct ToolState {
  PointState handle;
  PointState tool;
};

/// Outcome of a visual step.
struct StepResult {
  ToolState state;            ///< at the end of the step
  double coupling = 0.0;      ///< Fc: force of spring and damper on the handle, at the end of the step [N]
  double wall_impulse = 0.0;  ///< lambda >= 0 [N s]
  bool wall_active = false;   ///< the wall's constraint took part
};

/// Coupling force linearized about the state x0, u0 of the handle at the start of the step (paper, eq. 7):
/// F*c(x, v) = force + kx (x - reference.x) + kv (v - reference.v).
struct ForceModel {
  double force = 0.0;    ///< Fc [N]
  PointState reference;  ///< x0, u0
  double kx = 0.0;       ///< dFc/dx0 [N/m]
  double kv = 0.0;       ///< dFc/du0 [N s/m]
};

/// Device on the polygon of knots at time t [s]. At a knot (within 1e-9 s) the velocity is the right-hand one; after
/// the last knot the device rests there. The knots' times increase; the first is 0.
PointState deviceAt(const std::vector<Knot>& trajectory, double t);

/// One semi-implicit backward Euler step of length h [s] of handle and tool, with the device held at `device`.
StepResult visualStep(const Parameters& parameters, const ToolState& start, const PointState& device, double h);

/// The derivative of Fc through that step by the handle's position and velocity at its start, with the wall's
/// constraint held as the step left it (active or not).
ForceModel linearize(const Parameters& parameters, const ToolState& start, const StepResult& result, double h);

/// One implicit tick of length dt [s] of the proxy, which has the handle's mass, between the linearized coupling force
/// (none if `model` is null) and the link to the device.
PointState proxyTick(const Parameters& parameters, const ForceModel* model, const PointState& proxy,
                     const PointState& device, double dt);

/// Force of the link on the device [N]: kd (x - xd) + bd (v - vd).
double linkForce(const Parameters& parameters, const PointState& body, const PointState& device);

}  // namespace palpate::one_d
