#pragma once

#include <cstdint>

#include "palpate/live/handle_path.h"
#include "palpate/live/live_tick.h"
#include "palpate/reduction/reduce.h"
#include "palpate/visual/visual_step.h"

namespace palpate {

/// What the visual loop of method `live` hands from step to step besides the world.
struct LiveVisualState {
  bool ready = false;  ///< there is a model to replay
  LiveModel model;     ///< of the last step
  LiveBasis basis;
  DampedForces damped;
  VecX shift, velocity;  ///< corrections that the next step brings into the world; handle's frame, 3 a free node
  std::vector<BodyCorrection> others{};  ///< of bodies that it touches
};

/// The visual loop of method `live` (docs/live.md): follows the proxy's path, corrects its low modes by the replayed
/// ones, reduces the tool.
class LiveVisual {
 public:
  /// @param tick  of the haptic loop [s]
  LiveVisual(const LiveSettings& settings, double tick) : settings_(settings), tick_(tick) {}

  /// A model of the present state at rest; the world must have been stepped or evaluated.
  /// @param index  of the path's point that it belongs to
  void begin(World& world, double step, std::int64_t index, double time);
  /// One visual step, along the path from the last one to its end. Without a new point nothing happens.
  /// @param device  now; the link to it says how strongly the handle may be led
  VisualRecord step(World& world, const HandlePath& path, const DeviceTarget& device,
                    const VisualStepSettings& settings, double time, const HandleModel& previous);

  const LiveModel& model() const { return state_.model; }
  const LiveVisualState& state() const { return state_; }
  void restore(const LiveVisualState& state) { state_ = state; }

 private:
  ToolPath pathSince(const HandlePath& path) const;
  bool replayed(const Vec3& gravity, const HandlePath& path, LiveState& state);
  void forgetCorrections(const World& world, const ToolPath& way, double left);
  double stillness(const World& world, const ToolPath& way, const LiveState& replayed) const;
  ToolShape corrected(World& world, const LiveState& replayed, int parts);
  void correctPartners(const World& world, const LiveState& replayed, double share);
  void reduce(World& world, const LiveSettings& settings, const ToolShape& shape, double still, double step,
              std::int64_t index, double time);

  LiveSettings settings_;
  double tick_;
  LiveVisualState state_;
  ToolReduction reduction_;
  LiveTick replay_;
};

}  // namespace palpate
