#include "palpate/linearization/linearize.h"

#include "palpate/linearization/active_contacts.h"
#include "palpate/linearization/coupling_derivative.h"
#include "palpate/linearization/right_hand_sides.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

/// Derivatives of the step's velocities, all by the handle's pose and twist.
struct VelocityDerivatives {
  Mat612 handle;                    ///< du
  Mat612 tool;                      ///< A_ht dv_t: all that is needed of dv_t
  Mat612 contact = Mat612::Zero();  ///< J_h^T dlambda
};

/// Step 4: eq. (11), v without contact's change and then with the active contacts' impulses; the tool's part by the
/// Schur complement of the handle.
VelocityDerivatives differentiateVelocities(const BodySystem& tool, const ActiveContacts& active,
                                            const RightHandSides& b) {
  VelocityDerivatives v;
  v.handle = tool.handleSchurInverse() * (b.handle - b.tool);
  v.tool = b.tool;
  if (active.any()) {
    MatX free_change = active.z.transpose() * v.handle;
    free_change.leftCols<6>() += b.free_rows;
    const MatX dlambda = active.impulseResponse(free_change, b.given);
    v.contact = active.handle * dlambda;
    v.handle += tool.handleSchurInverse() * (active.z * dlambda);
    v.tool += (active.handle - active.z) * dlambda;
  }
  const Mat6 q = tool.coupling().transpose() * tool.response();  // A_ht A_tt^-1 A_th
  v.tool -= q * v.handle;
  return v;
}

/// Step 5: of the coupling force, eq. (6), by the velocities. (h K_HT + D_HT) v_t = A_ht v_t / h.
Mat612 differentiateForce(const Body& tool, const VelocityDerivatives& v) {
  const double h = tool.system.input().step;
  const double stiffness_time = h + tool.model.elasticity().material().damping_beta;
  return -stiffness_time * tool.system.handleStiffness() * v.handle - v.tool / h;
}

/// Step 6: all terms together, eq. (8), in the model of eq. (7).
HandleModel handleModel(const Body& tool, const Vec6& force, const RightHandSides& b, const VelocityDerivatives& v,
                        Mat612 df, double time) {
  const BodySystem& system = tool.system;
  const double h = system.input().step;
  df.leftCols<6>() += b.force;
  df += v.contact / h;
  HandleModel model;
  model.force = force;
  model.pose = system.startPose();
  model.twist = system.startTwist();
  model.kx = df.leftCols<6>();
  model.kv = df.rightCols<6>();
  model.handle_pose = advance(system.startPose(), h * system.endTwist());
  model.handle_twist = system.endTwist();
  model.time = time;
  model.step = h;
  return model;
}

// J_h^T lambda / h: contact on the handle itself.
Vec6 handleContact(const World& world) {
  const ContactSet& set = world.contacts();
  const BodyContactRows* rows = world.bodyRows(world.toolIndex());
  if (rows == nullptr || set.contacts.empty() || rows->contacts.empty()) return Vec6::Zero();
  return rows->handle * rows->gather(set.impulse) / world.tool().system.input().step;
}

}  // namespace

Vec6 couplingWrench(const World& world) { return couplingForces(world.tool()).wrench + handleContact(world); }

HandleModel linearize(const World& world, const LinearizationSettings& settings, double time) {
  const Body tool = world.tool();
  const CouplingForces forces = couplingForces(tool);
  const ActiveContacts active = activeContacts(world, settings);                          // step 2
  const RightHandSides b = differentiateRightHandSides(world, active, forces, settings);  // step 3
  const VelocityDerivatives v = differentiateVelocities(tool.system, active, b);          // step 4, eq. (11)
  const Mat612 df = differentiateForce(tool, v);                                          // step 5, eq. (6)
  return handleModel(tool, forces.wrench + handleContact(world), b, v, df, time);         // step 6, eq. (7, 8)
}

}  // namespace palpate
