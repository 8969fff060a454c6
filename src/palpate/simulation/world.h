#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "palpate/contact/obstacle.h"
#include "palpate/contact/surface_contacts.h"
#include "palpate/simulation/body_model.h"
#include "palpate/simulation/body_system.h"
#include "palpate/simulation/contact_stage.h"
#include "palpate/simulation/glue.h"
#include "palpate/simulation/motion_bend.h"
#include "palpate/simulation/moving_bodies.h"
#include "palpate/simulation/step_energy.h"
#include "palpate/simulation/step_report.h"
#include "palpate/simulation/world_state.h"

namespace palpate {

/// One body of a world: what it was built as, how it stands, the system of its last step.
struct Body {
  const BodyModel& model;
  const BodyState& state;
  BodySystem& system;
};

/// All bodies and obstacles of a scene, and the visual step. Model and settings are public or fixed by add(); what
/// moves is in state(); the rest is scratch. Knows no files, devices, threads or clocks.
class World {
 public:
  Vec3 gravity{0, 0, -9.81};
  LinkParameters link;
  ContactSettings contact;
  /// Of a step(); evaluate() has half of it, settle() none.
  StepBudget budget;
  /// Planes and solids; not to be changed after the first step.
  std::vector<Obstacle> obstacles;

  /// @param self_contact  whether the body's surface touches itself
  /// @returns the body's index. The first body that holds a handle is the tool.
  int add(BodyModel model, bool self_contact = false);
  /// Glues the nodes of a body's attachment to another body, where both were built. Before the first step.
  /// @param attachment  among the model's; is `glued`
  /// @returns whether the two lie inside each other beside the glue: then they do not touch each other
  /// @throws InputError if the two are too far apart, the same, or glued in a circle
  bool glue(int body, int attachment, int partner);
  const std::vector<Joint>& joints() const { return joints_; }
  /// Equalities of what a body is glued to, as it now is.
  std::vector<Contact> glued(int body) const;
  /// Bodies that glue holds together with this one, itself included, in order: those that are to settle together, so
  /// not through rigid bodies that nobody holds.
  std::vector<int> gluedTogether(int body) const;
  /// Contact that is left out between two bodies, the first before the second; null: none.
  const PairExclusion* leftOut(int first, int second) const { return surfaces_.leftOut(first, second); }
  Body body(int i) const { return {*models_[i], state_.bodies[i], *systems_[i]}; }
  int bodies() const { return static_cast<int>(models_.size()); }
  Body tool() const { return body(tool_); }
  int toolIndex() const { return tool_; }
  bool hasTool() const { return tool_ >= 0; }

  // --- state
  const WorldState& state() const { return state_; }
  /// Takes a state saved earlier, of this world or of another one built from the same scene: what follows is the same
  /// to the bit.
  /// @throws InputError if it does not fit this world's bodies
  void restore(const WorldState& state);
  /// Puts one body elsewhere. What the last step knew of contacts stays; overlaps are looked for anew.
  /// @throws InputError if the state does not fit the body
  void setBody(int i, const BodyState& state);
  /// Gives a framed body's handle a pose and a twist, and its nodes with it.
  void setHandle(int i, const HandleState& handle);
  void clearVelocities(int i) {
    state_.bodies[i].clearVelocities();
    energy_known_ = false;
  }
  /// Makes a body's material stiffer by a factor > 0 against its model.
  void setStiffnessScale(int i, double scale);
  /// Multiplies all coefficients of friction; 1 at first.
  void setFrictionScale(double scale);

  /// One visual step of length h: the paper's step 1 (section 3.4), the constrained dynamics of eq. (2). Where a step
  /// would not converge, carry a surface through another or make energy, it is done again in halves, as far as needed;
  /// the target then moves on evenly from that of the step before. What crosses even in the shortest of them is held
  /// back where it crosses.
  /// @param parts  equal ones to begin with
  [[nodiscard]] StepReport step(const DeviceTarget& device, double h, int parts = 1);
  /// As step(), but the tool's handle follows a path instead of being pulled by the link. Where that fails, because the
  /// path leads where the scene forbids, the link pulls the handle along the rest of it, and along the next paths: one
  /// after a first failure, more after each that follows. The next path begins wherever the handle is.
  /// @param path  with at least one point; needs a tool
  [[nodiscard]] StepReport follow(const ToolPath& path, double h, int parts = 1);
  /// As step(), but positions and velocities stay as they were: for a model at the present state. Only a step that
  /// fails brings its body to rest.
  [[nodiscard]] StepReport evaluate(const DeviceTarget& device, double h);
  /// Takes the number of a settling step and the largest displacement in it [m]; may throw to end the search.
  using SettleProgress = std::function<void(int step, double displacement)>;
  /// Brings bodies (with the device held still) to static equilibrium together; all others stand still meanwhile.
  /// @returns the largest speed [m/s] of the last settling step
  /// @throws RunError if they do not settle: which motion is free, or where they move, with their extents and mass
  double settle(const std::vector<int>& moving, Pose device, const SettleProgress& progress = {});

  /// What the tool's nodes have besides the state.
  struct ToolMotion {
    VecX positions, speeds;  ///< in place of the state's [m], [m/s]
  };
  /// The tool's surface vertices within reach [m] of planes. Appends.
  void nearPlanes(const ToolMotion& tool, double reach, std::vector<VertexNearPlane>& out);
  /// One of them as a contact.
  Contact planeContact(const ToolMotion& tool, const VertexNearPlane& near) const;
  /// Surfaces that are near the tool's, within their margin, or that would meet it within a time `ahead` [s] if all
  /// went on as they now move. Gaps are those of now. A search that would cost too much (a quarter of the budget) ends
  /// early. Appends.
  void nearSurfaces(const ToolMotion& tool, double ahead, std::vector<Contact>& out);

  /// Bodies that now are inside each other or inside obstacles, planes among them. The next step looks anew.
  std::vector<SurfaceOverlap> overlaps();

  /// What a contact is with, null: a body.
  const Obstacle* obstacleOf(const Contact& contact) const;
  /// Of a body's surface, or of the obstacle's triangles (body: -1); none where there are no triangles.
  SurfaceFeature featureOn(int body, const Contact& of) const { return surfaces_.featureOn(body, of); }
  /// One of the last step's that nearSurfaces() has just not found: what it is now (SurfaceContacts::renew).
  void renew(Contact& of_last_step) const { surfaces_.renew(tool_, of_last_step); }

  /// Contacts of the last step, of all bodies that moved.
  const ContactSet& contacts() const { return stage_.result(); }
  /// Hands them over to whoever still looks at them, right before the next step, which depends on none of them.
  ContactSet takeContacts() { return stage_.take(); }
  /// A body's part of them; null: it did not move.
  const BodyContactRows* bodyRows(int body) const;

  /// Friction of pairs. Obstacles' and bodies' own coefficients are entered by add().
  void setFriction(int first, int second, double coefficient) { friction_.setPair(first, second, coefficient); }

 private:
  enum class Ending {
    stay,  // positions and velocities as they were
    held,  // at the end, but for what would cross
    free,  // at the end; refused if something would cross or it does not converge
  };
  struct Way {  // of a visual step
    DeviceTarget from, to;
    double step;  // h
    const ToolPath* path = nullptr;
    bool pulled = false;   // along it by the link
    double good_cost = 0;  // of its parts that were good, in operations
  };
  struct BodyBegin {  // of a body's step
    bool good = false;
    StepTimes times;
    std::vector<int> nearby;
  };
  void prepare();
  LinkParameters linkTo(const DeviceTarget& device) const;
  std::vector<int> all() const;
  void requireFit(int i, const BodyState& state) const;
  void wasSet(int i);
  StepReport walk(Way way, int parts);
  StepInput inputAt(const Way& way, double from, double to) const;
  void stepAlong(Way& way, double from, double to, StepReport& sum);
  bool affords(int parts) const;
  double searchOperations() const;
  int bentHalvings(const Way& way, double share) const;
  bool tryStep(const StepInput& input, double share, bool last, StepReport& report);
  StepReport stepBodies(const std::vector<int>& moving, const StepInput& input, Ending ending, double share = 0.0);
  bool beginBodies(const std::vector<int>& moving, const StepInput& input, Ending ending, StepReport& report);
  void beginBody(int i, const StepInput& input, BodyBegin& begin);
  void orderContactNodes(int i, double h, std::vector<int>& nearby);
  std::vector<const BodyModel*> models() const;
  void findGlue();
  bool solveContacts(double share, StepReport& report);
  bool advance(StepReport& report);
  void fail(int i, StepReport& report);
  void findEnergies(StepReport& report, double time);
  void reportContacts(StepReport& report) const;
  double largestSpeed(const std::vector<int>& of) const;
  double longestSettlingStep(int body, const std::vector<int>& moving) const;
  double potentialEnergy(const std::vector<int>& of, const Pose& device) const;
  std::string unrest(int i, const VecX& before) const;

  // model
  std::vector<std::unique_ptr<BodyModel>> models_;
  FrictionTable friction_;
  std::vector<Joint> joints_;
  int tool_ = -1;
  bool prepared_ = false;
  // state
  WorldState state_;
  // workspace
  std::vector<std::unique_ptr<BodySystem>> systems_;
  SurfaceContacts surfaces_;
  ContactStage stage_;
  MovingBodies moving_;
  std::vector<Contact> glued_;  // equalities of the present part of a step
  std::vector<BodyBegin> begin_;
  std::vector<double> elastic_, elastic_before_;
  ContactMemory contacts_before_;  // of the present part of a step
  StepWork work_;                  // of the present step
  double brought_ = 0;             // energy by corrections in it, of the parts in which they brought some [J]
  WorkMeter meter_;
  MotionBend bend_;
  int bent_ = 0;       // halvings with which its parts begin as it bends
  double energy_ = 0;  // of the state, where it is known [J]
  bool energy_known_ = false;
};

}  // namespace palpate
