#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "palpate/linear/sparse_cholesky.h"
#include "palpate/live/live_model.h"
#include "palpate/reduction/contact_clusters.h"
#include "palpate/reduction/live_settings.h"
#include "palpate/reduction/partner_reduction.h"
#include "palpate/reduction/reduction_times.h"
#include "palpate/simulation/world.h"

namespace palpate {

/// The tool against its handle, in the handle's frame, as a model sees it: free nodes, flat.
struct ToolShape {
  VecX places, speeds;  ///< R^T (x - p) [m]; R^T (v - u_p) - w x place [m/s]
};
ToolShape toolShape(const World& world);
/// Mass of each coordinate of the free nodes [kg].
VecX freeMasses(const BodyModel& tool);

/// What a model was made of: the tool's modes in the handle's frame, y1.
struct LiveBasis : ModalBasis {
  VecX force;                            ///< elastic, on the modes
  std::vector<PartnerBasis> partners{};  ///< in the order of their modes in the model
};

/// Force at a contact as the tool's damping lets it through, by the contact's track; handle's frame [N].
using DampedForces = std::vector<std::pair<std::uint64_t, Vec3>>;

/// What the tool touches of another body: its rows of the model's contacts, and the forces as they are.
struct TouchedBody {
  std::vector<NodeSum> sums;
  std::vector<PartnerSupport> supports;  ///< whose rows are the last of the sums
  std::vector<std::pair<NodeSum, Vec3>> loads;
};

/// Makes live models of a world's tool (docs/live.md, a visual step, 4). Workspace only.
class ToolReduction {
 public:
  struct Input {
    const ToolShape& shape;  ///< to be linearized about, corrections included
    const DampedForces& damped;
    const MatX& start;                               ///< modes to begin with, or empty
    double step;                                     ///< of the visual loop [s]
    const std::vector<PartnerBasis>& partners;       ///< to begin with
    const std::vector<BodyCorrection>& corrections;  ///< that the next step brings into other bodies
    double still = 0;  ///< 1: all is at rest, and the model rests where the step does; 0: bent planes know better
  };
  /// @returns the model; its index and time are the caller's. Not finite where the tool has no factor.
  LiveModel reduce(World& world, const LiveSettings& settings, const Input& input, LiveBasis& basis);
  /// What reduce() leaves in the tool's system for the next step, once more: for a world that was restored.
  /// @param step  of the visual loop [s]
  static bool prepare(World& world, const LiveSettings& settings, const ToolShape& shape, double step);
  /// Of the last reduce(); the replay is not its own.
  const ReductionTimes& times() const { return times_; }

 private:
  const std::vector<TouchPoint>& search(World& world, const LiveSettings& settings, const ToolShape& shape);
  void placeContacts(World& world, const LiveSettings& settings, const Input& input, LiveModel& model);
  bool factorize(World& world, const LiveSettings& settings, const Input& input, LiveModel& model);
  void findToolModes(const Input& input, int most, LiveBasis& basis, LiveModel& model);
  void addInertia(const World& world, const Input& input, LiveBasis& basis, LiveModel& model);
  void beginPartners(World& world, const std::vector<PartnerBasis>& partners);
  void holdPartners(const LiveSettings& settings, const std::vector<PartnerBasis>& partners);
  PartnerReduction* begunPartner(int body);
  void addCompliance(World& world, const LiveSettings& settings, const Input& input, LiveBasis& basis,
                     LiveModel& model);
  void addPartners(World& world, const LiveSettings& settings, const Input& input, LiveBasis& basis, LiveModel& model,
                   MatX& others);
  void addCurvature(const World& world, const LiveBasis& basis, LiveModel& model);
  void findTurning(const BodyModel& tool, const LiveBasis& basis);
  void addTurning(const LiveBasis& basis, LiveModel& model) const;
  MatX atContacts(const MatX& field) const;
  const MatX& secondDifferences(const BodyModel& tool, const LiveBasis& basis, int count);

  SparseCholesky* factor_ = nullptr;  // of A_H = mass_scale_ M + e_ K, the tool's
  const SymmetricBlockMatrix* matrix_ = nullptr;
  double mass_scale_ = 1, e_ = 0;
  ElasticState elastic_;
  VecX positions_;  // all nodes, handle's frame: R^T (x - p)
  VecX mass_;       // of each free row
  VecX forces_;     // elastic, handle's frame, all nodes
  MatX second_;     // differences of the elastic forces
  MatX turning_;    // what stress adds to the modes' stiffness
  NearContacts near_;
  BlockColumns columns_;                 // J^T, handle's frame, by the free nodes that it acts on
  MatX gram_;                            // J A_H^-1 J^T, lower triangle
  VecX loads_;                           // of contact as it is, free rows
  RowVector merged_;                     // the same as the model has it
  std::vector<TouchedBody> touched_;     // of each body
  std::vector<PartnerReduction> begun_;  // of those that the last model touched
  bool touches_ = true;                  // the last model had contacts
  ReductionTimes times_;
};

/// lb += h / (beta + h) (R^T lambda - lb), for the contacts that carry force now or did.
void dampForces(const World& world, double h, DampedForces& damped);

}  // namespace palpate
