#pragma once

#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "palpate/contact/obstacle.h"
#include "palpate/contact/surface_contacts.h"
#include "palpate/simulation/body.h"
#include "palpate/simulation/contact_stage.h"

namespace palpate {

/// Wall-clock parts of a visual step [s].
struct StepTimes {
  double assemble = 0;   ///< element rotations, forces, matrices
  double factorize = 0;  ///< ordering where renewed, numeric factorization
  double solve = 0;      ///< free motion, handle's Schur complement
  double contact = 0;    ///< finding, reducing, Delassus operator, contact solver, passes
  double advance = 0;
  double total() const { return assemble + factorize + solve + contact + advance; }
};

enum class StepStatus {
  ok,
  contact_not_converged,  ///< the step counts; the residual says how far off it is
  restored,               ///< the step failed (not positive definite, not finite): last good state, at rest
};

/// What one step did.
struct StepReport {
  StepStatus status = StepStatus::ok;
  StepTimes times;
  int contacts_found = 0;  ///< surface vertices within reach, before reduction
  int contacts = 0;        ///< after reduction
  int active = 0, sticking = 0, sliding = 0;
  int solver_iterations = 0;
  double solver_residual = 0;  ///< [m/s]
  int passes = 0;
  double penetration = 0;                         ///< deepest surface point in another solid at the end of the step [m]
  double motion_share = 1;                        ///< least share of its motion that a body was let go without crossing
  double kinetic_energy = 0, elastic_energy = 0;  ///< [J], at the end
};

/// All bodies and obstacles of a scene, and the visual step. Knows no files, devices, threads or clocks.
class World {
 public:
  Vec3 gravity{0, 0, -9.81};
  LinkParameters link;
  /// Where the link to the device saturates, as a device's motors do: beyond, it yields like a softer link with this
  /// force [N] and torque [N m] at the start of the step.
  double link_force_limit = std::numeric_limits<double>::infinity();
  double link_torque_limit = std::numeric_limits<double>::infinity();
  ContactSettings contact;
  /// Planes and solids; not to be changed after the first step.
  std::vector<Obstacle> obstacles;

  /// @param self_contact  whether the body's surface touches itself
  /// @returns the body's index. The first body that holds a handle is the tool.
  int add(Body body, bool self_contact = false);
  Body& body(int i) { return *bodies_[i]; }
  const Body& body(int i) const { return *bodies_[i]; }
  int bodies() const { return static_cast<int>(bodies_.size()); }
  Body& tool() { return *bodies_[tool_]; }
  const Body& tool() const { return *bodies_[tool_]; }
  bool hasTool() const { return tool_ >= 0; }

  /// One visual step of length h (paper, section 3.4, step 1).
  [[nodiscard]] StepReport step(const DeviceTarget& device, double h);
  /// As step(), but positions and velocities stay as they were: for a model at the present state. Only a step that
  /// fails brings its body to rest.
  [[nodiscard]] StepReport evaluate(const DeviceTarget& device, double h);
  /// Brings bodies (with the device held still) to static equilibrium together; all others stand still meanwhile.
  /// @returns the largest speed [m/s] of the last settling step
  /// @throws RunError if they do not settle
  double settle(const std::vector<int>& moving, const Pose& device);

  /// Contacts of the last step, of all bodies that moved.
  const ContactSet& contacts() const { return stage_.result(); }
  /// Row of the tool's part in contacts().rows; -1: the tool did not move.
  int toolRows() const;
  int toolIndex() const { return tool_; }

  /// Friction of pairs. Obstacles' and bodies' own coefficients are entered by add().
  void setFriction(int first, int second, double coefficient) { friction_.setPair(first, second, coefficient); }
  /// Multiplies all coefficients of friction, between two steps; 1 at first.
  void setFrictionScale(double scale) { friction_.setScale(scale); }

 private:
  void prepare();
  LinkParameters saturatedLink(const DeviceTarget& device) const;
  struct Begin {  // of a body's step
    bool good = false;
    StepTimes times;
    std::vector<int> nearby;
  };
  void orderContactNodes(int body, double h, std::vector<int>& nearby);
  void beginBody(int i, const StepInput& input, Begin& begin);
  void beginBodies(const std::vector<int>& moving, const StepInput& input, StepTimes& times);
  void reportContacts(StepReport& report) const;
  StepReport stepAll(const DeviceTarget& device, double h, bool advance);
  StepReport stepBodies(const std::vector<int>& moving, const StepInput& input, bool advance);

  std::vector<std::unique_ptr<Body>> bodies_;
  ContactStage stage_;
  SurfaceContacts surfaces_;
  FrictionTable friction_;
  bool prepared_ = false;
  int restorations_ = 0;  // of all bodies, at the last step
  int tool_ = -1;
  std::vector<Body*> moving_;
  std::vector<int> moving_indices_, all_;
  std::vector<Begin> begin_;
  std::vector<double> share_, elastic_;
};

}  // namespace palpate
