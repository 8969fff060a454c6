#include "palpate/linearization/coupling_derivative.h"

#include <Eigen/LU>
#include <array>

#include "palpate/fem/polar.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

/// One boundary tetrahedron at the end of the step, seen by its four nodes.
struct BoundaryElement {
  const ElasticElement* element;
  std::array<Vec3, 4> c;         // rotated gradients
  std::array<int, 4> attached;   // index in the handle, -1
  std::array<Vec3, 4> velocity;  // end of step
  std::array<Vec3, 4> lever;     // R r of attached nodes
  std::array<Vec3, 4> start_force;
  std::array<Vec3, 4> stiffness_velocity;  // (K v)_i
};

BoundaryElement view(const Body& tool, int index) {
  const ElasticElement& e = tool.elasticity().elements()[index];
  BoundaryElement b;
  b.element = &e;
  const Mat3 rotation = tool.startPose().matrix();
  for (int k = 0; k < 4; ++k) {
    const int node = e.node[k];
    b.attached[k] = tool.attachedIndex()[node];
    if (b.attached[k] >= 0) {
      b.lever[k] = rotation * tool.handle().offsets[b.attached[k]];
      b.velocity[k] = tool.endTwist().head<3>() + Vec3(tool.endTwist().tail<3>()).cross(b.lever[k]);
    } else {
      b.lever[k].setZero();
      b.velocity[k] = tool.endVelocity().segment<3>(3 * tool.row()[node]);
    }
  }
  // K v by the stress that v makes, as the forces by that of x: far fewer operations than K's sixteen blocks
  Mat3 rate = b.velocity[0] * e.gradient[0].transpose();
  for (int k = 1; k < 4; ++k) rate += b.velocity[k] * e.gradient[k].transpose();
  const auto stress = [&](const Mat3& gradient, double trace_offset) -> Mat3 {
    const Mat3 g = e.rotation.transpose() * gradient;
    Mat3 s = e.mu * (g + g.transpose());
    s.diagonal().array() += e.lambda * (g.trace() - 3.0 * trace_offset) - 2.0 * e.mu * trace_offset;
    return e.rotation * s;
  };
  const Mat3 start = stress(e.deformationGradient(tool.startPositions()), 1.0);
  const Mat3 change = stress(rate, 0.0);
  for (int i = 0; i < 4; ++i) {
    b.start_force[i] = -(start * e.gradient[i]);
    b.stiffness_velocity[i] = change * e.gradient[i];
  }
  return b;
}

double stiffnessTime(const Body& tool) { return tool.input().step + tool.elasticity().material().damping_beta; }

}  // namespace

CouplingForces couplingForces(const Body& tool) {
  CouplingForces out;
  const double time = stiffnessTime(tool);
  for (const int index : tool.boundaryElements()) {
    const BoundaryElement b = view(tool, index);
    for (int i = 0; i < 4; ++i) {
      if (b.attached[i] < 0) continue;
      const Vec3 end = b.start_force[i] - time * b.stiffness_velocity[i];
      out.wrench.head<3>() += end;
      out.wrench.tail<3>() += b.lever[i].cross(end);
      out.lever_start.bottomRightCorner<3, 3>() += skew(b.start_force[i]) * skew(b.lever[i]);
      out.lever_end.bottomRightCorner<3, 3>() += skew(end) * skew(b.lever[i]);
    }
  }
  return out;
}

RotationTerms rotationTerms(const Body& tool) {
  using Mat36 = Eigen::Matrix<double, 3, 6>;
  RotationTerms out;
  out.free.setZero(3 * tool.freeNodes(), 6);
  const double time = stiffnessTime(tool);
  const Vec3 w = tool.endTwist().tail<3>();
  for (const int index : tool.boundaryElements()) {
    const BoundaryElement b = view(tool, index);
    const ElasticElement& e = *b.element;
    const Mat3 inverse = polarHessian(e.rotation, e.deformationGradient(tool.startPositions())).inverse();
    // Turn of the element by the pose: dR = [omega]x R, omega = R H^-1 axial(R^T dF - dF^T R), dF = sum_j dx_j grad
    // N_j^T
    Mat36 omega = Mat36::Zero();
    const std::array<Vec3, 4> c = e.rotatedGradients();
    std::array<Mat36, 4> dvelocity;  // d(G u): the attached nodes' velocities turn with their levers
    for (int j = 0; j < 4; ++j) {
      dvelocity[j].setZero();
      if (b.attached[j] < 0) continue;
      Mat36 dx;
      dx.leftCols<3>().setIdentity();
      dx.rightCols<3>() = -skew(b.lever[j]);
      omega += e.rotation * inverse * skew(e.gradient[j]) * e.rotation.transpose() * dx;
      dvelocity[j].rightCols<3>() = -skew(w) * skew(b.lever[j]);
    }
    for (int i = 0; i < 4; ++i) {
      // f = -R K (R^T x - X):  df = omega x f + K (omega x x);   d(K v) = omega x K v - K (omega x v) + K dv
      Mat36 de = -skew(b.start_force[i] - time * b.stiffness_velocity[i]) * omega;
      for (int j = 0; j < 4; ++j) {
        const Mat3 k = e.stiffness(c, i, j);
        const Vec3 x = tool.startPositions().segment<3>(3 * e.node[j]);
        de -= k * (skew(x + time * b.velocity[j]) * omega + time * dvelocity[j]);
      }
      if (b.attached[i] < 0) {
        out.free.middleRows<3>(3 * tool.row()[e.node[i]]) += de;
      } else {
        out.handle.topRows<3>() += de;
        out.handle.bottomRows<3>() += skew(b.lever[i]) * de;
      }
    }
  }
  return out;
}

}  // namespace palpate
