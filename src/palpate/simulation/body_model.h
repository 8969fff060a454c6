#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/contact/contact_finder.h"
#include "palpate/fem/elastic_mesh.h"
#include "palpate/math/types.h"
#include "palpate/mesh/types.h"
#include "palpate/rigid/handle.h"
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

  /// Attaches nodes to a handle that the device will hold. Once, before the body is added to a world; nodes of other
  /// handles' regions stay free.
  /// @throws InputError if that leaves no node free, or none that is connected to the handle
  void hold(const Handle& handle);

  const std::string& name() const { return name_; }
  const SimulationMesh& mesh() const { return mesh_; }
  const ElasticMesh& elasticity() const { return fem_; }
  const ContactFinder& contactFinder() const { return finder_; }
  int nodes() const { return fem_.nodes(); }
  int freeNodes() const { return static_cast<int>(free_.size()); }
  bool held() const { return held_; }                  ///< by the device
  bool framed() const { return handle_.has_value(); }  ///< held or rigid: has a handle frame among its unknowns
  bool isRigid() const { return framed() && free_.empty(); }
  const Handle& handle() const { return *handle_; }                    ///< of a framed body
  const std::vector<int>& free() const { return free_; }               ///< free row -> node
  const std::vector<int>& row() const { return row_; }                 ///< node -> free row, -1 if attached
  const std::vector<int>& attachedIndex() const { return attached_; }  ///< node -> index in handle().nodes, -1 if free
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
  double kineticEnergy(const BodyState& state) const;  ///< [J]

 private:
  void attach(const Handle& handle);

  std::string name_;
  SimulationMesh mesh_;
  ElasticMesh fem_;
  ContactFinder finder_;
  std::optional<Handle> handle_;
  bool held_ = false;
  double friction_ = 0;
  Vec6 velocity_;
  std::vector<int> row_, free_, attached_, boundary_;
  SymmetricBlockMatrix pattern_;
};

}  // namespace palpate
