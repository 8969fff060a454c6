#include "palpate/linearization/right_hand_sides.h"

#include <cmath>
#include <vector>

#include "palpate/contact/contact_rows.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

/// -dr/dinput of the handle's rows at fixed u, v_t, lambda, without the tool's elastic forces.
struct HandleInputs {
  Mat6 pose = Mat6::Zero();
  Mat6 twist = Mat6::Zero();
};

// Derivative of leftJacobianInverseCurvature by the angle x
double jacobianCurvatureSlope(double x) {
  if (x < 0.05) return x / 360.0 + x * x * x / 7560.0;
  const double s = std::sin(x);
  const double denominator = 2.0 * x * s;
  const double slope = 2.0 * s + 2.0 * x * std::cos(x);
  return -2.0 / (x * x * x) + (s * denominator + (1.0 + std::cos(x)) * slope) / (denominator * denominator);
}

// d/dtheta of sym(Jl^-1(theta)) w = w + c(|theta|) theta x (theta x w)
Mat3 linkJacobianDerivative(const Vec3& theta, const Vec3& w) {
  const double angle = theta.norm();
  const double c = leftJacobianInverseCurvature(theta.squaredNorm());
  Mat3 d = c * (-skew(theta.cross(w)) - skew(theta) * skew(w));
  if (angle > 1e-12) {
    d += jacobianCurvatureSlope(angle) / angle * theta.cross(theta.cross(w)) * theta.transpose();
  }
  return d;
}

HandleInputs handleInputs(const Body& tool, Derivative derivative) {
  HandleInputs out;
  const StepInput& input = tool.system.input();
  const double h = input.step;
  const Mat3 r = tool.system.startPose().matrix();
  const Mat3 inertia = r * tool.model.handle().inertia * r.transpose();
  const Vec3 w0 = tool.system.startTwist().tail<3>();
  const Vec3 w = tool.system.endTwist().tail<3>();
  const Vec3 theta = logRotation(tool.system.startPose().rotation * input.device.pose.rotation.conjugate());
  const Mat3 jacobian = leftJacobianInverse(theta);

  out.pose.topLeftCorner<3, 3>() = -h * input.link.stiffness * Mat3::Identity();
  // gyroscopic term -w0 x I w0, with I = R I R^T turning
  Mat3 turn = -h * input.link.rotational_stiffness * jacobian +
              h * (skew(w0) * skew(inertia * w0) - skew(w0) * inertia * skew(w0));
  if (derivative == Derivative::full) {
    // M_h (u - u0) and the damping alpha of the attached mass, with their inertias turning
    const auto inertiaTurn = [](const Mat3& i, const Vec3& a) -> Mat3 { return -skew(i * a) + i * skew(a); };
    turn -= inertiaTurn(inertia, w - w0);
    turn -= h * tool.model.elasticity().material().damping_alpha *
            inertiaTurn(r * tool.model.handle().attached_inertia * r.transpose(), w);
    turn -= h * h * input.link.rotational_stiffness * linkJacobianDerivative(theta, w) * jacobian;
  }
  out.pose.bottomRightCorner<3, 3>() = turn;
  out.twist = tool.system.handleMassAtStart();
  out.twist.bottomRightCorner<3, 3>() += h * (skew(inertia * w0) - skew(w0) * inertia);
  return out;
}

/// Contact on the handle's part of the surface: how its rows and its wrench turn with the handle.
struct HandleContactTurn {
  MatX rows;                   ///< d(J_h) u by pose, rows x 6
  Mat6 wrench = Mat6::Zero();  ///< d(J_h^T) lambda by pose
};

HandleContactTurn handleContactTurn(const Body& tool, const ContactSet& set, const ContactRows& own, int self) {
  HandleContactTurn out;
  out.rows.setZero(own.rows(), 6);
  const Mat3 r = tool.system.startPose().matrix();
  const Vec3 w = tool.system.endTwist().tail<3>();
  for (std::size_t k = 0; k < own.contacts.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(3 * k);
    const int i = own.contacts[k];
    const Mat3 frame = set.contacts[i].frame();
    const Vec3 impulse = frame.transpose() * set.impulse.segment<3>(3 * i);
    forEachNode(set.contacts[i], self, [&](int node, double weight) {
      const int index = tool.model.attachedIndex()[node];
      if (index < 0) return;
      const Mat3 lever = skew(r * tool.model.handle().offsets[index]);
      out.rows.block<3, 3>(row, 3) -= weight * frame * skew(w) * lever;
      out.wrench.bottomRightCorner<3, 3>() += weight * skew(impulse) * lever;
    });
  }
  return out;
}

/// What the full derivative adds to the frozen one: everything that turns with the handle or the elements.
void addTurning(const World& world, const ActiveContacts& active, const CouplingForces& forces, RightHandSides& out) {
  const Body tool = world.tool();
  const double h = tool.system.input().step;
  const RotationTerms terms = rotationTerms(tool);
  MatX response = h * terms.free;  // db_t, then A_tt^-1 db_t
  out.tool.leftCols<6>() += tool.system.response().transpose() * response;
  out.handle.leftCols<6>() += h * (terms.handle + forces.lever_end - forces.lever_start);
  out.force += terms.handle;
  if (!active.any()) return;
  const HandleContactTurn turn = handleContactTurn(tool, world.contacts(), *active.own, world.toolIndex());
  out.handle.leftCols<6>() += turn.wrench;
  out.force += turn.wrench / h;
  tool.system.factor().solve(response);
  const MatX rows = tool.system.rowVelocity(world.contacts().contacts, *active.own, world.toolIndex(), response);
  out.free_rows += active.list.spread(*active.own, rows);
  out.given.leftCols<6>() -= active.list.spread(*active.own, turn.rows);
}

}  // namespace

RightHandSides differentiateRightHandSides(const World& world, const ActiveContacts& active,
                                           const CouplingForces& forces, const LinearizationSettings& settings) {
  RightHandSides out;
  const Body tool = world.tool();
  const BodySystem& system = tool.system;
  const double h = system.input().step;
  const double scale = -h / system.stiffnessScale();
  const HandleInputs inputs = handleInputs(tool, settings.derivative);
  out.handle.leftCols<6>() = inputs.pose - h * system.handleStiffness() + h * forces.lever_start;
  out.handle.rightCols<6>() = inputs.twist;
  out.tool.leftCols<6>() = scale * (system.coupling().transpose() * system.response());
  out.force = -system.handleStiffness() + forces.lever_end;
  if (active.any()) {
    out.free_rows = scale * (active.handle - active.z).transpose();
    out.given.setZero(active.list.rows(), 12);
    for (Eigen::Index r = 0; r < out.given.rows(); r += 3) {
      const Contact& c = world.contacts().contacts[active.list.contacts[r / 3]];
      const Eigen::Index rows = c.glued() ? 3 : 1;
      out.given.block(r, 0, rows, 6) = -c.follows / h * active.handle.middleCols(r, rows).transpose();
    }
  }
  if (settings.derivative == Derivative::full) addTurning(world, active, forces, out);
  return out;
}

}  // namespace palpate
