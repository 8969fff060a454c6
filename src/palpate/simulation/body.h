#pragma once

#include <Eigen/LU>
#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "palpate/common/parallel.h"
#include "palpate/contact/contact.h"
#include "palpate/contact/contact_finder.h"
#include "palpate/fem/elastic_mesh.h"
#include "palpate/linear/sparse_cholesky.h"
#include "palpate/linear/symmetric_block_matrix.h"
#include "palpate/math/types.h"
#include "palpate/mesh/types.h"
#include "palpate/rigid/handle.h"
#include "palpate/rigid/link.h"

namespace palpate {

/// What the visual handle is pulled towards during a step: the device's sample, or where it is predicted to be.
struct DeviceTarget {
  Pose pose;
  Vec6 twist = Vec6::Zero();
};

/// Given for one step.
struct StepInput {
  double step = 0.033;  ///< h [s]
  Vec3 gravity{0, 0, -9.81};
  LinkParameters link;
  DeviceTarget device;
};

/// A deformable body, with or without a handle, or a rigid one: its state, and the linear system of its semi-implicit
/// backward Euler step.
///
///     A_tt v + A_th u   = M v0 + h (f + m g)                  + J_t^T lambda        A = (1 + h alpha) M + c K
///     A_th^T v + A_hh u = M_h u0 + h (G^T f_H + weight + ...) + J_h^T lambda        c = h beta + h^2
///
/// with v the velocities of the free nodes and u the handle's twist. The handle is eliminated by the Schur complement
/// S = A_hh - A_th^T X, X = A_tt^-1 A_th. A rigid body is a handle that nobody holds and to which all nodes are
/// attached.
class Body {
 public:
  /// @param mesh      in world coordinates, undeformed
  /// @param friction  Coulomb coefficient against obstacles that have none of their own
  /// @param velocity  twist at the start, about the center of mass
  /// @param parts     materials of the tetrahedra where they differ; else empty
  Body(std::string name, SimulationMesh mesh, const Material& material, double friction = 0.5,
       const Vec6& velocity = Vec6::Zero(), const std::vector<ElementMaterial>& parts = {});

  /// A rigid body with the given surface: four nodes around it carry the surface's vertices.
  /// @param surface  closed, in world coordinates
  /// @param density  [kg/m^3]
  /// @param damping_alpha  drag against the world [1/s]
  /// @throws InputError if the surface encloses no volume
  static Body rigid(std::string name, const Surface& surface, double density, double friction = 0.5,
                    const Vec6& velocity = Vec6::Zero(), double damping_alpha = 0.0);

  /// Attaches nodes to a handle. Once, before the first step; nodes of other handles' regions stay free.
  void hold(const Handle& handle);

  // --- model
  const std::string& name() const { return name_; }
  const SimulationMesh& mesh() const { return mesh_; }
  const ElasticMesh& elasticity() const { return fem_; }
  const ContactFinder& contactFinder() const { return finder_; }
  int nodes() const { return fem_.nodes(); }
  int freeNodes() const { return static_cast<int>(free_.size()); }
  bool held() const { return linked_; }                ///< by the device
  bool framed() const { return handle_.has_value(); }  ///< held or rigid: has a handle frame among its unknowns
  bool isRigid() const { return framed() && free_.empty(); }
  const std::vector<int>& row() const { return row_; }                 ///< node -> free row, -1 if attached
  const std::vector<int>& attachedIndex() const { return attached_; }  ///< node -> index in handle().nodes, -1 if free
  const std::vector<int>& boundaryElements() const { return boundary_; }  ///< touch attached and free nodes
  double totalMass() const;
  /// Makes the material stiffer by a factor > 0, between two steps.
  void scaleStiffness(double factor) { fem_.scaleStiffness(factor); }
  double friction() const { return friction_; }

  // --- state
  struct State {
    VecX x, v;  ///< all nodes, flat [m], [m/s]
    Pose handle_pose;
    Vec6 handle_twist = Vec6::Zero();
    std::vector<Mat3> rotations;
  };
  State state() const;
  void restore(const State& state);
  /// How often restore() has set the state: what is known of it from the step before holds no longer.
  int restorations() const { return restorations_; }
  const VecX& positions() const { return x_; }
  const VecX& velocities() const { return v_; }
  const Handle& handle() const { return *handle_; }
  void setHandleState(const Pose& pose, const Vec6& twist);  ///< moves the attached nodes with it
  void clearVelocities();
  double kineticEnergy() const;  ///< [J]
  double elasticEnergy() { return fem_.energyAt(x_); }

  // --- one step, in this order
  /// Rotations, forces, system; no factorization yet.
  void assemble(const StepInput& input);
  /// Whether the factor's order still suits contact on these nodes: it has them last, and not for long far too many
  /// others; or it suits contact anywhere, and there has not been far less of it for long.
  bool contactNodesFit(const std::vector<int>& needed);
  /// Whether a point of body `self` needs nodes that should be ordered last and are not.
  bool lacksNodes(const ContactPoint& point, int self) const;
  /// Orders the given nodes last in the factor, so that contact on them is cheap; where they are so many that their
  /// dense block would cost more than it saves, none is (docs/sparse-factorization.md). A new symbolic analysis: rare.
  void orderContactNodes(const std::vector<int>& nodes);
  /// Numeric factorization. @returns false if A_tt is not positive definite or not finite.
  bool factorize();
  /// Velocities without contact impulse, into freeVelocity() and endVelocity().
  void solveFree();
  /// End velocities of the free motion under the given contact impulses [N s], rows as in contacts: a prediction before
  /// contact is solved.
  /// @param own  contacts in which the body takes part
  void predict(const std::vector<Contact>& contacts, const std::vector<int>& own, int self, const VecX& impulse);
  /// The same after a new factorization of the same system (other nodes ordered last).
  void solveFreeAgain();

  /// This body's part of the contact rows; 3 rows a contact (normal, tangents), of those contacts alone in which it
  /// takes part.
  struct ContactRows {
    std::vector<int> contacts;  ///< those in which the body takes part, increasing; columns are theirs
    std::size_t known = 0;      ///< of them, whose rows are there
    MatX handle;                ///< J_h^T: 6 x rows, of a body with a handle frame
    MatX z;                     ///< (J_h - J_t X)^T: 6 x rows, of a body with a handle frame
    MatX delassus;              ///< J A^-1 J^T of this body alone [1/kg]: rows x rows, lower triangle

    /// Rows of a vector [rows of all contacts] that belong to the body's contacts.
    VecX gather(const VecX& all) const;
  };
  /// Fills the rows of rows.contacts. Those that are known, from an earlier call in the same step, are kept but for the
  /// contacts that changed; all of the others come behind them.
  /// @param contacts  of all bodies
  /// @param changed   one a contact: whether it is new or another one since that call
  void contactRows(const std::vector<Contact>& contacts, int self, const std::vector<char>& changed, ContactRows& rows);
  /// Adds J v of the given contacts to the row velocities of all contacts, for the free motion.
  void addFreeRowVelocity(const std::vector<Contact>& contacts, const std::vector<int>& own, int self,
                          VecX& velocity) const;
  /// J v of this body's rows for velocities of its free nodes [3 free x columns]: [rows of own x columns].
  MatX rowVelocity(const std::vector<Contact>& contacts, const std::vector<int>& own, int self, const MatX& v) const;
  /// End velocities under contact impulses lambda [rows of all contacts].
  void applyImpulse(const std::vector<Contact>& contacts, const ContactRows& rows, int self, const VecX& lambda);
  /// Node positions at the end of the step, for the present end velocities.
  /// @param share  of the step, in [0, 1]: how far along its motion
  void endPositions(VecX& x, double share = 1.0) const;
  /// Where the end of the step leaves a point, beside where h times its velocity row would [m]: the attached nodes'
  /// arcs.
  Vec3 arcOffset(const ContactPoint& point, const VecX& x_end) const;
  /// Takes the end of the step, or a part of its motion, as the new state. @returns false (state unchanged) if it is
  /// not finite.
  bool advance(double share = 1.0);

  // --- the step's system, for the linearization and for checks; valid from assemble() to the next assemble()
  const StepInput& input() const { return input_; }
  double stiffnessScale() const { return c_; }  ///< c = h beta + h^2
  const VecX& startPositions() const { return x0_; }
  const VecX& startVelocities() const { return v0_; }
  const Pose& startPose() const { return pose0_; }
  const Vec6& startTwist() const { return twist0_; }
  const VecX& elasticForces() const { return f_; }      ///< at the start, all nodes [N]
  const MatX& coupling() const { return a_th_; }        ///< A_th, 3 free x 6
  const MatX& response() const { return x_th_; }        ///< X = A_tt^-1 A_th, 3 free x 6
  const Mat6& handleStiffness() const { return gkg_; }  ///< G^T K_HH G
  const Mat6& handleSchurInverse() const { return s_inverse_; }
  const Mat6& handleMassAtStart() const { return mass0_; }  ///< M_h at the start pose
  const VecX& endVelocity() const { return v_end_; }        ///< free nodes, 3 free
  const Vec6& endTwist() const { return u_end_; }
  SparseCholesky& factor() { return factor_; }
  const SymmetricBlockMatrix& system() const { return a_; }
  const std::vector<int>& contactNodes() const { return contact_nodes_; }  ///< that the order was chosen for
  std::size_t analyses() const { return analyses_; }

 private:
  void assembleRightSides();
  void assembleHandle();
  void addLink(Vec6& wrench);
  void attach(const Handle& handle);
  void nodeVelocity(const ContactPoint& point, const VecX& v, const Vec6& u, Vec3& out) const;
  bool addImpulses(const std::vector<Contact>& contacts, const std::vector<int>& own, int self, const VecX& impulse,
                   Vec6& on_handle);
  void addColumns(const Contact& contact, int self, Eigen::Index column, ContactRows& rows);
  void formDelassus(ContactRows& rows);
  void updateDelassus(const std::vector<Contact>& contacts, int self, ContactRows& rows);

  std::string name_;
  SimulationMesh mesh_;
  ElasticMesh fem_;
  ContactFinder finder_;
  std::optional<Handle> handle_;
  bool linked_ = false;
  int restorations_ = 0;
  double friction_ = 0;
  std::vector<int> row_, free_, attached_, boundary_;

  VecX x_, v_;

  StepInput input_;
  double c_ = 0;
  VecX x0_, v0_, f_;
  Pose pose0_;
  Vec6 twist0_ = Vec6::Zero();
  SymmetricBlockMatrix a_;
  SparseCholesky factor_;
  bool analyzed_ = false;
  std::size_t analyses_ = 0;
  std::vector<int> contact_nodes_;  // nodes ordered last, or for which none is
  std::vector<int> trailing_;       // node -> index among the contact nodes, -1
  bool nodes_last_ = true;
  std::vector<char> seen_;
  int surplus_steps_ = 0;  // steps in a row in which far too many nodes were ordered last
  MatX a_th_, x_th_, rhs_, solution_, prediction_;
  Eigen::Matrix<double, 4, Eigen::Dynamic> pulled_;  // K G by threes of rows, six columns each, fourth entry idle
  BlockColumns columns_;                             // J_t^T of contacts, by free rows
  std::vector<int> changed_;                         // own contacts whose columns they are
  MatX half_, response_, image_;
  Mat6 gkg_ = Mat6::Zero(), a_hh_ = Mat6::Zero(), s_inverse_ = Mat6::Zero(), mass0_ = Mat6::Zero();
  Vec6 b_h_ = Vec6::Zero();
  VecX v_free_, v_end_, impulse_response_, on_trailing_;
  Vec6 u_free_ = Vec6::Zero(), u_end_ = Vec6::Zero();
};

/// Calls f(b) for each place b in `bodies`: at the same time where they are of like size, one after the other where one
/// is most of the work, so that its own loops are shared out.
template <class F>
void forEachBody(const std::vector<Body*>& bodies, F&& f) {
  constexpr double kMost = 0.7;
  double nodes = 0, most = 0;
  for (const Body* body : bodies) {
    nodes += body->nodes();
    most = std::max(most, static_cast<double>(body->nodes()));
  }
  const int count = static_cast<int>(bodies.size());
  if (most > kMost * nodes) {
    for (int b = 0; b < count; ++b) f(b);
  } else {
    parallelFor(count, f);
  }
}

}  // namespace palpate
