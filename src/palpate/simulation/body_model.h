#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/contact/contact_finder.h"
#include "palpate/fem/elastic_mesh.h"
#include "palpate/math/types.h"
#include "palpate/mesh/types.h"
#include "palpate/rigid/handle.h"
#include "palpate/simulation/attachment.h"
#include "palpate/simulation/body_state.h"

namespace palpate {

/// A deformable body, with or without a handle, or a rigid one, as it was built: it does not change once a world has
/// it. A rigid body is a handle that nobody holds and to which all nodes are attached.
class BodyModel {
 public:
  /// @param mesh      in world coordinates, undeformed
  /// @param friction  Coulomb coefficient against obstacles that have none of their own
  /// @param velocity  twist at the start, about the center of mass
  /// @param parts     materials of the tetrahedra where they differ; else empty
  BodyModel(std::string name, SimulationMesh mesh, const Material& material, double friction = 0.5,
            const Vec6& velocity = Vec6::Zero(), const std::vector<ElementMaterial>& parts = {});

  /// A rigid body with the given surface: four nodes around it carry the surface's vertices.
  /// @param surface  closed, in world coordinates
  /// @param density  [kg/m^3]
  /// @param damping_alpha  drag against the world [1/s]
  /// @throws InputError if the surface encloses no volume
  static BodyModel rigid(std::string name, const Surface& surface, double density, double friction = 0.5,
                         const Vec6& velocity = Vec6::Zero(), double damping_alpha = 0.0);

  /// Lets the device hold a rigid body at its center of mass. Once, before it is added to a world.
  /// @param own_mass     of the handle, which comes on top of the body's [kg]
  /// @param own_inertia  of the handle, principal, in its frame; zero: that of a ball that fingers hold [kg m^2]
  /// @param rotation     of the handle's frame
  void holdRigid(const std::string& name, double own_mass, const Vec3& own_inertia, const Quat& rotation);
  /// Attaches nodes to a handle that the device will hold. Once, before the body is added to a world; nodes of other
  /// handles' regions stay free.
  /// @throws InputError if that leaves no node free, or none that is connected to the handle, or if the world holds one
  ///         of the nodes
  void hold(const Handle& handle);
  /// Lets the world hold nodes, or notes that they are to be glued: World::glue() says to what. Before the body is
  /// added to a world; a handle's nodes are the handle's, and springs on fixed nodes do nothing.
  /// @throws InputError if an attachment fixes or glues what another one or the handle has, or if no node is left free
  void attach(Attachment attachment);

  const std::string& name() const { return name_; }
  const SimulationMesh& mesh() const { return mesh_; }
  const ElasticMesh& elasticity() const { return fem_; }
  const ContactFinder& contactFinder() const { return finder_; }
  int nodes() const { return fem_.nodes(); }
  int freeNodes() const { return static_cast<int>(free_.size()); }
  bool held() const { return held_; }                  ///< by the device
  bool framed() const { return handle_.has_value(); }  ///< held or rigid: has a handle frame among its unknowns
  bool isRigid() const { return framed() && free_.empty(); }
  const Handle& handle() const { return *handle_; }       ///< of a framed body
  const std::vector<int>& free() const { return free_; }  ///< free row -> node
  const std::vector<int>& row() const { return row_; }    ///< node -> free row, -1 if on the handle or fixed
  /// Node -> index in handle().nodes, -1 if it is not on the handle.
  const std::vector<int>& attachedIndex() const { return attached_; }
  bool isFixed(int node) const { return row_[node] < 0 && attached_[node] < 0; }  ///< to the world
  const std::vector<Attachment>& attachments() const { return attachments_; }
  bool glues() const { return glues_; }                                      ///< an attachment glues nodes
  const std::vector<int>& fixedElements() const { return fixed_elements_; }  ///< touch fixed nodes
  const VecX& springStiffness() const { return spring_stiffness_; }          ///< of each node [N/m]; empty: no springs
  const VecX& springDamping() const { return spring_damping_; }              ///< of each node [N s/m]
  bool driven() const { return driven_; }                                    ///< an attachment moves
  /// Where the world has its ends of attachments at a time; elsewhere the nodes as built; 3 a node [m].
  VecX anchors(double time) const;
  double springEnergy(const VecX& x, const VecX& anchors) const;          ///< [J]
  const std::vector<int>& boundaryElements() const { return boundary_; }  ///< touch attached and free nodes
  double totalMass() const;                                               ///< [kg]
  double friction() const { return friction_; }
  /// Of A_tt; its values are to be overwritten.
  const SymmetricBlockMatrix& pattern() const { return pattern_; }

  /// Undeformed, moving with the velocity that the body was built with.
  BodyState startState() const;
  /// Gives the handle a pose and a twist, and its nodes with it.
  void setHandle(const HandleState& handle, BodyState& state) const;
  /// R^T (x - p) of all nodes, of a framed body; attached ones have their offsets [m].
  VecX placesInHandle(const BodyState& state) const;
  /// R^T (v - u_p) - w x place of the free nodes, 3 a free node: what they move against the handle [m/s].
  /// @param places  of all nodes, handle's frame
  VecX speedsInHandle(const BodyState& state, const VecX& places) const;
  double kineticEnergy(const BodyState& state) const;  ///< [J]

 private:
  void attachTo(const Handle& handle);
  void number();

  std::string name_;
  SimulationMesh mesh_;
  ElasticMesh fem_;
  ContactFinder finder_;
  std::optional<Handle> handle_;
  bool held_ = false;
  double friction_ = 0;
  Vec6 velocity_;
  std::vector<Attachment> attachments_;
  std::vector<char> fixed_, glued_;  // of each node
  bool driven_ = false, glues_ = false;
  VecX spring_stiffness_, spring_damping_;
  std::vector<int> row_, free_, attached_, boundary_, fixed_elements_;
  SymmetricBlockMatrix pattern_;
};

}  // namespace palpate
