#pragma once

#include "palpate/live/contact_sweeps.h"
#include "palpate/live/handle_path.h"
#include "palpate/live/live_model.h"
#include "palpate/live/tick_algebra.h"
#include "palpate/rigid/link.h"

namespace palpate {

/// Given for one tick, world frame.
struct LiveTickInput {
  double dt = 0.001;  ///< [s]
  Vec3 gravity{0, 0, -9.81};
  LinkParameters link;
  Pose device;
  Vec6 device_twist = Vec6::Zero();
};

/// The tick of a live model (docs/live.md). Holds scratch only; nothing in it allocates, locks, throws or calls the
/// system.
class LiveTick {
 public:
  static constexpr int kSweeps = 8;
  static constexpr double kRecoverySpeed = 0.1;  ///< at which depth is undone [m/s]

  /// Advances model and handle together by a tick, implicitly, with contact.
  /// @param pose, twist  of the proxy at its start
  /// @returns the proxy's twist at its end
  Vec6 step(const LiveModel& model, const LiveTickInput& input, const Pose& pose, const Vec6& twist,
            LiveState& state) noexcept;

  /// The same for a handle that moved as recorded: modes and contact only.
  /// @param from, to  neighbors on the path; from.index is the state's
  void replay(const LiveModel& model, double dt, const Vec3& gravity, const PathPoint& from, const PathPoint& to,
              LiveState& state) noexcept;
  /// Along the path up to an index, by at most so many ticks. @returns false if the path does not hold them
  bool replayTo(std::int64_t index, int most, const LiveModel& model, double dt, const Vec3& gravity,
                const HandlePath& path, LiveState& state) noexcept;
  /// From the model's start up to an index. @returns false if the path does not hold the whole way
  bool replayAll(std::int64_t index, const LiveModel& model, double dt, const Vec3& gravity, const HandlePath& path,
                 LiveState& state) noexcept;

 private:
  void replayNext(const LiveModel& model, double dt, const Vec3& gravity, const PathPoint& from, const PathPoint& to,
                  LiveState& state) noexcept;
  void factorHandle(const LiveModel& model, const LiveTickInput& input) noexcept;
  void placeContacts(const LiveModel& model, const LiveState& state, const Pose& pose, double dt) noexcept;
  void yieldWhereRigid(const LiveModel& model, double dt) noexcept;
  void addSpin(const LiveModel& model, const LiveState& state, const Vec3& w, ModalVector& modal) const noexcept;

  TickCholesky factor_;
  ModalVector inverse_;  // of the modes' diagonal
  RowVector place_;      // e, handle's frame
  TickRows jacobian_;
  BoundedMatrix<LiveSize::kRows, LiveSize::kModes> shape_;  // Qc + Pc z
  TickContacts contacts_;
  bool replay_known_ = false;  // the compliance in contacts_ is that of the replay under way
};

/// Energy of a model in a state [J]: kinetic, elastic, weight; for the account at a change of models.
double liveEnergy(const LiveModel& model, const LiveState& state, const Pose& pose, const Vec6& twist,
                  const Vec3& gravity) noexcept;

}  // namespace palpate
