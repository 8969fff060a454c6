#include "palpate/linearization/coupling_derivative.h"

#include <Eigen/LU>
#include <array>

#include "palpate/fem/polar.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

/// An element with its state.
struct TurnedElement {
  ElasticElement e;  // of the body's present stiffness
  Mat3 rotation;     // at the start of the step
  const FlatElement* flat;
  double scale;  // of the stiffness
  /// First Piola-Kirchhoff stress times the volume; with 0 in place of 1 its change with the deformation gradient's.
  Mat3 stress(const Mat3& gradient, double one) const {
    const Mat3 g = rotation.transpose() * gradient;
    Mat3 s = e.mu * (g + g.transpose());
    s.diagonal().array() += e.lambda * (g.trace() - 3.0 * one) - 2.0 * e.mu * one;
    Mat3 p = rotation * s;
    if (flat != nullptr) p += scale * flat->linearStress(gradient * rotation.transpose(), one) * rotation;
    return p;
  }
  /// K_ij of c_i = R grad N_i.
  Mat3 stiffness(const std::array<Vec3, 4>& c, int i, int j) const {
    Mat3 k = e.stiffness(c, i, j);
    if (flat != nullptr) k += scale * (flat->factor(c[i]) * flat->factor(c[j]).transpose());
    return k;
  }
};

TurnedElement elementOf(const Body& tool, int index) {
  const ElasticState& state = tool.state.elastic;
  TurnedElement out{tool.model.elasticity().elements()[index], state.rotations[index], flatElement(state.flat, index),
                    state.stiffness_scale};
  out.e.mu *= out.scale;
  out.e.lambda *= out.scale;
  return out;
}

/// One boundary tetrahedron at the end of the step, seen by its four nodes.
struct BoundaryElement {
  TurnedElement element;
  std::array<int, 4> attached;   // index in the handle, -1
  std::array<Vec3, 4> velocity;  // end of step
  std::array<Vec3, 4> lever;     // R r of attached nodes
  std::array<Vec3, 4> start_force;
  std::array<Vec3, 4> stiffness_velocity;  // (K v)_i
};

BoundaryElement view(const Body& tool, int index) {
  BoundaryElement b;
  b.element = elementOf(tool, index);
  const ElasticElement& e = b.element.e;
  const Mat3 rotation = tool.system.startPose().matrix();
  for (int k = 0; k < 4; ++k) {
    const int node = e.node[k];
    b.attached[k] = tool.model.attachedIndex()[node];
    if (b.attached[k] >= 0) {
      b.lever[k] = rotation * tool.model.handle().offsets[b.attached[k]];
      b.velocity[k] = tool.system.endTwist().head<3>() + Vec3(tool.system.endTwist().tail<3>()).cross(b.lever[k]);
    } else {
      b.lever[k].setZero();
      b.velocity[k] = tool.system.nodeEndVelocity(node);
    }
  }
  // K v by the stress that v makes, as the forces by that of x: far fewer operations than K's sixteen blocks
  Mat3 rate = b.velocity[0] * e.gradient[0].transpose();
  for (int k = 1; k < 4; ++k) rate += b.velocity[k] * e.gradient[k].transpose();
  const Mat3 start = b.element.stress(e.deformationGradient(tool.system.startPositions()), 1.0);
  const Mat3 change = b.element.stress(rate, 0.0);
  for (int i = 0; i < 4; ++i) {
    b.start_force[i] = -(start * e.gradient[i]);
    b.stiffness_velocity[i] = change * e.gradient[i];
  }
  return b;
}

double stiffnessTime(const Body& tool) {
  return tool.system.input().step + tool.model.elasticity().material().damping_beta;
}

}  // namespace

CouplingForces couplingForces(const Body& tool) {
  CouplingForces out;
  const double time = stiffnessTime(tool);
  const Mat3 rotation = tool.system.startPose().matrix();
  const Vec3 linear = tool.system.endTwist().head<3>(), angular = tool.system.endTwist().tail<3>();
  // forces are -P grad N_j, so an element's sum of l_j f_j^T over its attached nodes is -(sum of l_j grad N_j^T) P^T
  Vec3 force = Vec3::Zero();
  Mat3 moments_start = Mat3::Zero(), moments_end = Mat3::Zero();
  for (const int index : tool.model.boundaryElements()) {
    const TurnedElement element = elementOf(tool, index);
    const ElasticElement& e = element.e;
    Mat3 rate = Mat3::Zero(), levers = Mat3::Zero();
    Vec3 gradients = Vec3::Zero();
    for (int j = 0; j < 4; ++j) {
      const int attached = tool.model.attachedIndex()[e.node[j]];
      if (attached >= 0) {
        const Vec3 lever = rotation * tool.model.handle().offsets[attached];
        rate += (linear + angular.cross(lever)) * e.gradient[j].transpose();
        levers += lever * e.gradient[j].transpose();
        gradients += e.gradient[j];
      } else {
        rate += tool.system.nodeEndVelocity(e.node[j]) * e.gradient[j].transpose();
      }
    }
    const Mat3 start = e.deformationGradient(tool.system.startPositions());
    const Mat3 end_stress = element.stress(start + time * rate, 1.0);
    force -= end_stress * gradients;
    moments_start -= levers * element.stress(start, 1.0).transpose();
    moments_end -= levers * end_stress.transpose();
  }
  out.wrench << force, moments_end(1, 2) - moments_end(2, 1), moments_end(2, 0) - moments_end(0, 2),
      moments_end(0, 1) - moments_end(1, 0);
  // [f]x [l]x = l f^T - (l . f) 1
  out.lever_start.bottomRightCorner<3, 3>() = moments_start - moments_start.trace() * Mat3::Identity();
  out.lever_end.bottomRightCorner<3, 3>() = moments_end - moments_end.trace() * Mat3::Identity();
  return out;
}

RotationTerms rotationTerms(const Body& tool) {
  using Mat36 = Eigen::Matrix<double, 3, 6>;
  RotationTerms out;
  out.free.setZero(3 * tool.model.freeNodes(), 6);
  const double time = stiffnessTime(tool);
  const Vec3 w = tool.system.endTwist().tail<3>();
  for (const int index : tool.model.boundaryElements()) {
    const BoundaryElement b = view(tool, index);
    const ElasticElement& e = b.element.e;
    const Mat3& rotation = b.element.rotation;
    const Mat3 inverse = polarHessian(rotation, e.deformationGradient(tool.system.startPositions())).inverse();
    // Turn of the element by the pose: dR = [omega]x R, omega = R H^-1 axial(R^T dF - dF^T R), dF = sum_j dx_j grad
    // N_j^T
    Mat36 omega = Mat36::Zero();
    const std::array<Vec3, 4> c = e.rotatedGradients(rotation);
    std::array<Mat36, 4> dvelocity;  // d(G u): the attached nodes' velocities turn with their levers
    for (int j = 0; j < 4; ++j) {
      dvelocity[j].setZero();
      if (b.attached[j] < 0) continue;
      Mat36 dx;
      dx.leftCols<3>().setIdentity();
      dx.rightCols<3>() = -skew(b.lever[j]);
      omega += rotation * inverse * skew(e.gradient[j]) * rotation.transpose() * dx;
      dvelocity[j].rightCols<3>() = -skew(w) * skew(b.lever[j]);
    }
    for (int i = 0; i < 4; ++i) {
      // f = -R K (R^T x - X):  df = omega x f + K (omega x x);   d(K v) = omega x K v - K (omega x v) + K dv
      Mat36 de = -skew(b.start_force[i] - time * b.stiffness_velocity[i]) * omega;
      for (int j = 0; j < 4; ++j) {
        const Mat3 k = b.element.stiffness(c, i, j);
        const Vec3 x = tool.system.startPositions().segment<3>(3 * e.node[j]);
        de -= k * (skew(x + time * b.velocity[j]) * omega + time * dvelocity[j]);
      }
      if (tool.model.row()[e.node[i]] >= 0) {
        out.free.middleRows<3>(3 * tool.model.row()[e.node[i]]) += de;
      } else if (b.attached[i] >= 0) {
        out.handle.topRows<3>() += de;
        out.handle.bottomRows<3>() += skew(b.lever[i]) * de;
      }
    }
  }
  return out;
}

}  // namespace palpate
