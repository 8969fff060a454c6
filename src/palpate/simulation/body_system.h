#pragma once

#include <array>
#include <optional>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/linear/sparse_cholesky.h"
#include "palpate/linear/symmetric_block_matrix.h"
#include "palpate/math/types.h"
#include "palpate/rigid/link.h"
#include "palpate/simulation/body_model.h"
#include "palpate/simulation/body_state.h"
#include "palpate/simulation/device_target.h"
#include "palpate/simulation/row_selection.h"

namespace palpate {

/// A handle that follows a path instead of being pulled by the link.
struct FollowedHandle {
  bool on = false;
  HandleState end;           ///< at the end of the step
  Vec6 link = Vec6::Zero();  ///< of ToolPath
  double largest_force = 0;  ///< of ToolPath
  /// Of the free nodes, handle's frame, 3 a free node, or empty: displacement that the step makes besides, and what is
  /// added to the velocities at its start. [m], [m/s]
  VecX shift, velocity;
  std::vector<BodyCorrection> others{};  ///< of the world's other bodies
};

/// The elastic part of a step in which the handle follows a path, found ahead of it: of places in the handle's frame,
/// in which it stays what it is wherever the path leads. The last step's end becomes the next one's start, so the model
/// that a step ends with and the step after it share one factor.
struct PreparedFollowing {
  bool ready = false;  ///< the system's matrix and factor are of this
  double step = 0;     ///< h of the step that it is for
  ElasticAhead elastic;
  double energy = 0;  ///< [J]
};

/// Given for one step.
struct StepInput {
  double step = 0.033;  ///< h [s]
  Vec3 gravity{0, 0, -9.81};
  LinkParameters link;
  DeviceTarget device;
  /// A has the stiffness of tension as well (fem/elastic_mesh.h): for static solutions. In motion it would be a drag on
  /// what turns, as A acts on velocities against the world.
  bool tension = false;
  /// Of a held body.
  FollowedHandle followed{};
  /// Of a held body without attachments: where it follows nothing and brings no correction, A is of where it turns to.
  /// docs/step.md, "What turns"
  bool turning = false;
  double end_time = 0;  ///< of the world at the end of the step [s]: attachments may be driven
};

/// How the order of a body's factor suits the nodes that contact may touch.
enum class OrderFit {
  good,
  lacks,     ///< some of them are not last
  outdated,  ///< there is none, or far more have been last for long
};

/// The linear system of one body's semi-implicit backward Euler step, and its scratch. It holds nothing that the next
/// step depends on.
///
///     A_tt v + A_th u   = M v0 + h (f + m g)                  + J_t^T lambda        A = (1 + h alpha) M + c K
///     A_th^T v + A_hh u = M_h u0 + h (G^T f_H + weight + ...) + J_h^T lambda        c = h beta + h^2
///
/// with v the velocities of the free nodes and u the handle's twist. The handle is eliminated by the Schur complement
/// S = A_hh - A_th^T X, X = A_tt^-1 A_th.
///
/// Where the handle follows a path, A is that of the positions to which handle and free nodes have moved as one rigid
/// body; the unknowns are velocities against that motion, v_r, and the handle is so heavy that it stays on its path
/// unless contact stops it:
///     A_tt (v - v_r) = M (v0 - v_r) + h (f + m g - alpha M v_r) + J_t^T lambda
/// A body that follows nothing and is corrected by a shift d: the same with v_r = d / h, which is no motion,
///     A_tt (v - v_r) = M v0 + h (f + m g) + J_t^T lambda
/// A soft body that turns, and follows nothing: A is that of the positions to which it would go as a rigid body with
/// its present twist, or that of a longer part which was taken back; rigid motion has the velocities v_r there, u_r at
/// the handle, and of v0 the body's motion is turned (docs/step.md, "What turns"). Straight ways would make what turns
/// larger.
///     A_tt (v - v_r) + A_th (u - u_r) = M (v0 - v_r) + h (f + m g - alpha M v_r) + J_t^T lambda
/// The end velocities of contact are those of the way, (x - x0) / h; those of the state at the end are v.
/// A_tt may have been prepared where the handle follows a path, in the handle's frame: what goes into its factor and
/// comes out of it is turned.
class BodySystem {
 public:
  /// @param model  must outlive this
  explicit BodySystem(const BodyModel& model);
  const BodyModel& model() const { return *model_; }

  /// Finds A_tt, its factor, rotations and forces of a step of length h in which the handle follows a path, from these
  /// places on; a step that finds its body there uses them. Also what the model of a live tool is made from.
  /// @param places  of all nodes, handle's frame, what the step is to shift included [m]
  /// @returns false if A_tt is not positive definite or not finite
  bool prepareFollowing(const VecX& places, const BodyState& state, double step);
  const PreparedFollowing& prepared() const { return prepared_; }
  /// Elastic forces at these positions of all nodes [N], which a step that starts there need not find again.
  const VecX& forcesAhead(const VecX& positions, const BodyState& state);

  // --- one step, in this order
  /// Rotations, forces, system; no factorization yet. Renews the state's element rotations.
  /// @param state  at the start of the step; must stay where it is until advance()
  /// @param correction  that the step brings, of a body that follows no path
  void assemble(const StepInput& input, BodyState& state, const BodyCorrection* correction = nullptr);
  /// How the factor's order suits contact on these nodes. It still does if it has them last, and not for long far too
  /// many others; or it suits contact anywhere, and there has not been far less of it for long.
  OrderFit contactNodesFit(const std::vector<int>& needed);
  /// Whether a point of body `self` needs nodes that should be ordered last and are not.
  bool lacksNodes(const ContactPoint& point, int self) const;
  /// Orders the given nodes last in the factor, so that contact on them is cheap; where they are so many that their
  /// dense block would cost more than it saves, none is (docs/sparse-factorization.md). A new symbolic analysis: rare.
  void orderContactNodes(const std::vector<int>& nodes);
  /// The same for nodes besides those that are last: they are moved to the end, which takes no search, unless that
  /// makes the factor much dearer.
  void addContactNodes(const std::vector<int>& nodes);
  /// Numeric factorization, in the order that the state says. @returns false if A_tt is not positive definite or not
  /// finite.
  bool factorize();
  /// Velocities without contact impulse, also as the end velocities so far.
  void solveFree();
  /// End velocities of the free motion under the given contact impulses [N s], rows as in contacts: a prediction before
  /// contact is solved.
  /// @param own  contacts in which the body takes part
  void predict(const std::vector<Contact>& contacts, const ContactRows& own, int self, const VecX& impulse);
  /// The same after a new factorization of the same system (other nodes ordered last).
  void solveFreeAgain();

  /// Fills the rows of rows.contacts. Those that are known, from an earlier call in the same step, are kept but for the
  /// contacts that changed; all of the others come behind them.
  /// @param contacts  of all bodies
  /// @param changed   one a contact: whether it is new or another one since that call
  void contactRows(const std::vector<Contact>& contacts, int self, const std::vector<char>& changed,
                   BodyContactRows& rows);
  /// About what factorize() costs, and what the last contactRows() did for these rows [floating-point operations].
  double factorOperations() const { return model_->free().empty() ? 0.0 : factor_.statistics().flops; }
  double contactOperations(const BodyContactRows& rows) const;
  /// The same of so many rows, of which some are new.
  double rowOperations(double changed, double rows) const;
  /// Matrix products and triangular solves run at several times the speed of other work: what one operation counts.
  static constexpr double kDense = 0.25;

  /// Adds J v of the given contacts to the row velocities of all contacts, for the free motion.
  void addFreeRowVelocity(const std::vector<Contact>& contacts, const ContactRows& own, int self, VecX& velocity) const;
  /// J v of this body's rows for velocities of its free nodes [3 free x columns]: [rows of own x columns].
  MatX rowVelocity(const std::vector<Contact>& contacts, const ContactRows& own, int self, const MatX& v) const;
  /// End velocities under contact impulses lambda [rows of all contacts].
  void applyImpulse(const std::vector<Contact>& contacts, const BodyContactRows& rows, int self, const VecX& lambda);
  /// Node positions at the end of the step, for the present end velocities.
  void endPositions(VecX& x) const;
  /// How much motion the end velocities are: root of twice their kinetic energy [kg^1/2 m/s].
  double motion() const;
  /// Where contact is not solved but stopped, a point has the masses of its nodes alone. Its end velocity [m/s], the
  /// inverse mass with which it meets an impulse [1/kg], and that impulse [N s] upon the end velocities.
  Vec3 pointVelocity(const ContactPoint& point) const;
  Mat3 pointInverseMass(const ContactPoint& point) const;
  void pushPoint(const ContactPoint& point, const Vec3& impulse);
  /// Of any node [m/s]; setting is for free ones.
  Vec3 nodeEndVelocity(int node) const {
    if (row(node) >= 0) return v_end_.segment<3>(3 * row(node));
    return model_->isFixed(node) ? fixedVelocity(node) : Vec3(jacobian(node) * u_end_);
  }
  /// Of a fixed node: zero, unless it is driven [m/s].
  Vec3 fixedVelocity(int node) const {
    if (!model_->driven()) return Vec3::Zero();
    return (anchors_.segment<3>(3 * node) - x0_.segment<3>(3 * node)) / input_.step;
  }
  /// Whether a point of this body can move at all: not all of its nodes are fixed to the world.
  bool canMove(const ContactPoint& point) const;
  void setNodeEndVelocity(int node, const Vec3& v) { v_end_.segment<3>(3 * row(node)) = v; }
  void stopHandle() { u_end_.setZero(); }
  /// Stops all motion.
  void stop();
  /// Where the end of the step leaves a point, beside where h times its velocity row would [m]: the attached nodes'
  /// arcs.
  Vec3 arcOffset(const ContactPoint& point, const VecX& x_end) const;
  bool endIsFinite() const { return v_end_.allFinite() && u_end_.allFinite(); }
  /// Writes the end of the step into the state that it started from.
  /// @returns false (state unchanged) if it is not finite
  bool advance();
  /// Undoes advance().
  void retreat();
  /// Elastic energy of a state [J]. Where the next step starts from the same state, it needs no rotations and forces of
  /// its own any more.
  /// @param time  of the world, at which springs pull to where their ends then are [s]
  double elasticEnergy(const BodyState& state, double time) {
    ahead_energy_ = model_->elasticity().energyAt(state.positions, state.elastic, ahead_);
    return ahead_energy_ +
           (model_->springStiffness().size() > 0 ? model_->springEnergy(state.positions, model_->anchors(time)) : 0.0);
  }
  /// What the corrections that come with a path bring at the start of the step: kinetic, elastic and of weight [J].
  /// @param elastic  energy that the body had before them [J]
  double correctionEnergy(double elastic);
  /// Wrench of the tool on a handle that follows a path, elastic and damping, at the end of the step, and of contact on
  /// the handle itself [N; N m], about its origin, world; from the forces that elasticEnergy() found there.
  Vec6 wrenchOnHandle(const BodyState& end) const;
  /// What who leads the handle along a path pushes it with: against the tool, and for its own weight and what it gains
  /// in speed, which a link would have to bring too [N], world.
  Vec3 leadingForce(const BodyState& end) const;
  /// Whether contact alone, by the impulses applied last, resists by far more than the tool may that is led along a
  /// path.
  bool resists() const;
  /// What each attachment did to the body in the step that was just taken: with gravity, link and contact impulses it
  /// makes up the change of the body's momentum. In the order of the model's attachments.
  std::vector<AttachmentForce> attachmentForces() const;
  /// Work that driven attachments did in it [J].
  double attachmentWork() const;
  /// Rotations and forces found at the end of the step; may be for other positions, or none.
  const ElasticAhead& ahead() const { return ahead_; }
  /// The state was set from outside: nothing found ahead of the next step holds.
  void forget() {
    ahead_.clear();
    prepared_.ready = false;
  }
  /// Forgets how a part of a step that was taken back had turned the body.
  void expectNothing() { expected_.reset(); }

  // --- the step's system, for the linearization and for checks; valid from assemble() to the next assemble()
  const StepInput& input() const { return input_; }
  double stiffnessScale() const { return c_; }  ///< c = h beta + h^2
  const VecX& startPositions() const { return x0_; }
  const VecX& startVelocities() const { return start_velocities_; }
  const Pose& startPose() const { return start_.pose; }
  const Vec6& startTwist() const { return start_.twist; }
  const VecX& elasticForces() const { return f_; }      ///< at the start, all nodes [N]
  const MatX& coupling() const { return a_th_; }        ///< A_th, 3 free x 6
  const MatX& response() const { return x_th_; }        ///< X = A_tt^-1 A_th, 3 free x 6
  const Mat6& handleStiffness() const { return gkg_; }  ///< G^T K_HH G
  const Mat6& handleSchurInverse() const { return s_inverse_; }
  const Mat6& handleMassAtStart() const { return mass0_; }  ///< M_h at the start pose, or where it turns to
  const VecX& endVelocity() const { return v_end_; }        ///< free nodes, 3 free
  const Vec6& endTwist() const { return u_end_; }
  SparseCholesky& factor() { return factor_; }
  const SymmetricBlockMatrix& matrix() const { return a_; }  ///< A_tt
  std::size_t analyses() const { return analyses_; }

 private:
  int row(int node) const { return model_->row()[node]; }
  const Handle& handle() const { return model_->handle(); }
  /// G_i at the start pose of a node on the handle.
  Eigen::Matrix<double, 3, 6> jacobian(int node) const {
    return handle().jacobian(model_->attachedIndex()[node], start_.pose);
  }
  /// Where the attached nodes are in the positions that A is of.
  const Pose& grip() const { return follows() ? input_.followed.end.pose : turns_ ? turned_grip_ : start_.pose; }
  bool follows() const { return model_->held() && input_.followed.on; }
  bool corrected() const { return correction_.shift.size() > 0 && !model_->isRigid(); }
  bool frameCorrected() const { return correction_.shift.size() > 0 && model_->isRigid(); }
  /// Whether A is of other positions than the start's.
  bool displaced() const { return follows() || corrected() || turns_; }
  void moveRigidly();
  void shiftNodes();
  void takePrepared();
  void assembleMatrix(double step, const ElasticState& elastic);
  void addSprings(double step);
  void solve(MatX& columns);
  void solveTurned(MatX& columns);
  void assembleRightSides();
  void weighDown();
  void pullHandle();
  void addPull(int element);
  void assembleHandle();
  struct RigidMotion {
    Vec3 center;   // of mass
    Mat3 inertia;  // about it
    Vec6 twist;    // likewise
  };
  bool mayTurn() const;
  bool turnRigidly();
  RigidMotion rigidMotion() const;
  Vec6 rigidWay(const BodyState& end) const;
  Vec3 velocityThere(const Vec3& x) const;
  Vec6 handleWrench() const;
  Vec6 leftToContact() const;
  template <class Velocity>
  VecX besideFixed(Velocity velocity) const;
  std::vector<std::vector<Vec3>> nodeAttachmentForces() const;
  Vec3 startMiddle(const Attachment& attachment) const;
  double springEnergyAt(const VecX& x) const;
  double shiftEnergy(double elastic) const;
  void addLink(Vec6& wrench);
  Eigen::Matrix<double, 3, 6> attachedJacobian(const ContactPoint& point) const;
  void nodeVelocity(const ContactPoint& point, const VecX& v, const Vec6& u, Vec3& out) const;
  bool addImpulses(const std::vector<Contact>& contacts, const ContactRows& own, int self, const VecX& impulse,
                   Vec6& on_handle);
  void addColumns(const Contact& contact, int self, Eigen::Index column, BodyContactRows& rows);
  void formDelassus(BodyContactRows& rows);
  void addHandleDelassus(BodyContactRows& rows) const;
  void updateDelassus(const std::vector<Contact>& contacts, int self, BodyContactRows& rows);
  bool isAnalyzed(const FactorOrder& order) const;
  void analyze(const FactorOrder& order);
  void appendContactNodes(const std::vector<int>& nodes);

  const BodyModel* model_;
  BodyState* state_ = nullptr;  // of the present step

  StepInput input_;
  BodyCorrection correction_;  // none: empty
  double c_ = 0;
  VecX x0_, start_velocities_, v0_, f_;  // v0: against v_r where the handle follows a path
  VecX moved_, carried_;  // what is displaced: positions that A is of; v_r and the shift's velocity, of the free nodes
  bool turns_ = false;    // as a rigid body would, to positions of its own
  HandleState rigid_;     // there: its center of mass, turned from the start, and the motion's twist
  Pose turned_grip_;      // the handle's there
  Vec6 carried_grip_, grip_gain_;  // its chord's twist, and what is gained against it without forces
  std::optional<Vec6> expected_;   // twist of the part that was taken back, if that is all that is known of this one
  VecX places_;                    // moved_ in the handle's frame
  PreparedFollowing prepared_;
  bool turned_ = false;        // A_tt and its factor are those prepared
  Mat3 turn_;                  // from the handle's frame at the end of its path
  std::vector<Mat3> tension_;  // P of each element, times h / sqrt(c): it does not damp; empty: left out
  HandleState start_;
  ElasticAhead ahead_;
  double ahead_energy_ = 0;  // elastic, there [J]
  double moved_energy_ = 0;  // elastic, of what A is of [J]
  SymmetricBlockMatrix a_;
  SparseCholesky factor_;
  SparseCholesky spare_;  // the one with no nodes last, once it was asked for, or that with them
  std::size_t analyses_ = 0;
  FactorOrder order_;          // that the factor was last analyzed for
  std::vector<int> trailing_;  // node -> index among order_.last_nodes, -1
  bool nodes_last_ = true;     // they are; else they were too many, and the order suits contact anywhere
  std::vector<char> seen_;
  MatX a_th_, x_th_, rhs_, solution_, prediction_;
  Eigen::Matrix<double, 4, Eigen::Dynamic> pulled_;  // K G by threes of rows, six columns each, fourth entry idle
  BlockColumns columns_;                             // J_t^T of contacts, by free rows
  std::vector<int> changed_;                         // own contacts whose columns they are
  MatX half_, response_, image_;
  Mat6 gkg_ = Mat6::Zero(), a_hh_ = Mat6::Zero(), s_inverse_ = Mat6::Zero(), mass0_ = Mat6::Zero();
  Vec6 b_h_ = Vec6::Zero();
  VecX v_free_, v_end_, impulse_response_, on_trailing_;
  Vec6 on_handle_ = Vec6::Zero();  // contact impulses on the handle, of the last applyImpulse() [N s; N m s]
  double resisting_ = 0;           // force of contact, also through the tool, by the same [N]
  VecX anchors_;                   // at the end of the step, 3 a node [m]
  VecX on_fixed_;                  // contact impulses on fixed nodes, 3 a node; empty: none are fixed [N s]
  VecX on_glued_;                  // the same of what its own nodes are glued with; empty: none are
  Vec6 u_free_ = Vec6::Zero(), u_end_ = Vec6::Zero();
  Vec6 u_path_ = Vec6::Zero();  // that leads to the end of the path
};

}  // namespace palpate
