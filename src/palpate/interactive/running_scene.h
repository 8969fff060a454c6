#pragma once

#include <atomic>
#include <cstdint>

#include "palpate/devices/mouse_device.h"
#include "palpate/haptics/exchange.h"
#include "palpate/interactive/recorder.h"
#include "palpate/protocol/messages.h"
#include "palpate/scene/builder.h"
#include "palpate/session/realtime_loops.h"
#include "palpate/viewer/audience.h"

namespace palpate {

/// One scene, built, with its loops and a mouse in place of its device, unless that is on a desk: all that a reset or
/// another scene replaces. Calls come from the pump.
class RunningScene {
 public:
  /// @throws what building the scene throws, RunError if its first visual step fails
  RunningScene(const SceneConfig& config, const InteractiveSettings& settings, std::uint32_t generation);

  const SceneConfig& config() const { return config_; }
  const BuiltScene& scene() const { return scene_; }
  RealtimeLoops& loops() { return loops_; }
  const TickRecord& lastTick() const { return last_tick_; }
  MouseDevice& mouse() { return mouse_; }
  /// Whether frames carry the stress; also while the loops run.
  void setStress(bool on) { stress_.store(on); }

  // The following while the loops stand still.

  /// Takes over method and timing of `config`.
  void setMethod(const SceneConfig& config);
  void setFriction(double scale) { scene_.world.setFrictionScale(scale); }
  /// The moduli of all bodies times a factor against the scene's.
  void setStiffness(double scale);
  /// From now on rows go to both too; null and {} end it.
  void record(Recorder* recorder, RunSink sink);

  /// Takes rows and states from the loops and hands them on.
  /// @param again  sends the newest frame even if nothing has happened since the last
  void pump(Audience& audience, std::uint32_t generation, bool again);

 private:
  MouseDevice& replaceDevice();
  void takeSteps();
  bool takeTicks();
  void sendFrame(Audience& audience, std::uint32_t generation, bool again);
  void stepped(const World& world, const VisualRecord& record);
  void keepState();

  SceneConfig config_;
  BuiltScene scene_;
  std::unique_ptr<MouseDevice> idle_mouse_;  // beside a device on a desk: what viewers say of the hand goes there
  MouseDevice& mouse_;
  StateReader reader_;
  SampleEncoder encoder_;
  double built_stiffness_;  // factor that the bodies were built with
  std::atomic<bool> stress_;
  SceneState state_;  // the visual loop's, while it runs
  LatestValue<SceneState> states_;
  TickRecord last_tick_;
  Bytes full_;
  std::uint32_t full_step_ = 0;
  Recorder* recorder_ = nullptr;
  RunSink sink_;
  RealtimeLoops loops_;  // last: its threads use all of the above
};

}  // namespace palpate
