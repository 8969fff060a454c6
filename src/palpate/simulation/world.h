#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/contact/obstacle.h"
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
  double penetration = 0;                         ///< deepest surface vertex at the end of the step [m]
  double kinetic_energy = 0, elastic_energy = 0;  ///< [J], at the end
};

/// All bodies and obstacles of a scene, and the visual step. Knows no files, devices, threads or clocks.
class World {
 public:
  Vec3 gravity{0, 0, -9.81};
  LinkParameters link;
  ContactSettings contact;
  std::vector<Obstacle> obstacles;

  /// @returns the body's index. The first body that holds a handle is the tool.
  int add(Body body);
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
  /// Brings one body (with the device held still) to static equilibrium.
  /// @returns the largest speed [m/s] of the last settling step
  /// @throws RunError if it does not settle
  double settle(int body, const Pose& device);

  /// Contacts of the last step of a body.
  const ContactSet& contacts(int body) const { return stages_[body]->result(); }
  const ContactSet& toolContacts() const { return contacts(tool_); }

 private:
  void orderContactNodes(Body& body, double h) const;
  bool stepBody(int i, const StepInput& input, StepReport& report);
  StepReport stepAll(const DeviceTarget& device, double h, bool advance);

  std::vector<std::unique_ptr<Body>> bodies_;
  std::vector<std::unique_ptr<ContactStage>> stages_;
  int tool_ = -1;
};

}  // namespace palpate
