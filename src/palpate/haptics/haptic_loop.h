#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "palpate/haptics/coupling.h"
#include "palpate/haptics/device_filter.h"
#include "palpate/haptics/proxy.h"
#include "palpate/haptics/safety.h"
#include "palpate/live/live_tick.h"
#include "palpate/live/switch_account.h"

namespace palpate {

/// Where the force comes from.
enum class Rendering {
  linearized,        ///< proxy pulled by the handle model: `hsl` and `hsl-exact`, which differ in the model only
  virtual_coupling,  ///< `vc`: device coupled to the newest visual handle, no proxy
  live,              ///< `live`: the proxy moves with a small copy of the tool
};

/// Tool whose weight the device does not show. It is taken as rigid: a constant force at a point fixed in the handle.
struct CompensatedWeight {
  Vec3 weight = Vec3::Zero();  ///< mass times gravity of handle and tool together [N]; zero: nothing is compensated
  Vec3 center = Vec3::Zero();  ///< their center of mass in the handle's frame [m]
};

struct HapticSettings {
  double dt = 0.001;  ///< tick [s]
  Rendering rendering = Rendering::linearized;
  LinkParameters link;
  ProxySettings proxy;
  CompensatedWeight compensation;
  SafetySettings safety;
  DeviceFilterSettings filter;
};

/// Everything about one tick; values after it.
struct TickRecord {
  double time = 0.0;   ///< [s], as passed to tick()
  DeviceState device;  ///< sample that was used
  Pose proxy;          ///< with virtual coupling the visual handle
  Vec6 proxy_twist = Vec6::Zero();
  Vec6 raw = Vec6::Zero();        ///< wrench of the link on the device, before compensation and safety [N; N m]
  Vec6 sent = Vec6::Zero();       ///< wrench that goes to the device [N; N m]
  double model_age = 0.0;         ///< time - model's time [s]; infinite before the first model
  double delivered_energy = 0.0;  ///< net energy given to the hand so far [J]
  TickFlags flags;
};

/// What became of the models that the loop was given; each is counted once.
struct ModelAccount {
  std::uint64_t given = 0;
  std::uint64_t used = 0;
  std::uint64_t refused = 0;    ///< not finite, too much energy, or too old to be replayed
  std::uint64_t overtaken = 0;  ///< a newer one came before it was used
};

/// All that a tick depends on besides its input and the settings: copied, and given back to a loop with the same
/// settings, it makes the run go on to the bit.
struct HapticLoopState {
  static constexpr std::int64_t kNoOffer = std::numeric_limits<std::int64_t>::min();
  DeviceFilterState filter;
  ProxyState proxy;
  SafetyState safety;
  PassivityObserver passivity;
  TickCounters counters;
  HandleModel model;  ///< last good one
  bool has_model = false;
  LiveUpdate live, pending;  ///< in use; being replayed
  bool has_live = false, has_pending = false;
  std::int64_t offered = kNoOffer;  ///< index of the newest live model that was given
  SwitchAccount account;
  HandlePath path;
  double start_time = 0.0;   ///< [s]
  Pose device_pose;          ///< of the last tick
  Vec6 sent = Vec6::Zero();  ///< by the last tick [N; N m]
  double last_time = 0.0;    ///< of the last tick [s]
  ModelAccount models;
};

/// The haptic loop without its clock: lockstep and real time run the same tick. After construction nothing in it
/// allocates, locks, throws or calls the system.
class HapticLoop {
 public:
  /// @throws InputError for settings out of range
  explicit HapticLoop(const HapticSettings& settings);

  /// Begins a run at rest.
  /// @param device_pose  first pose of the device
  /// @param proxy_pose   handle in static equilibrium with it, from the visual loop
  /// @param now          time of the first tick [s]
  /// @return wrench on the device at the start, after the safety stage
  Vec6 start(const Pose& device_pose, const Pose& proxy_pose, double now) noexcept;

  /// One tick.
  /// @param sample  of the device, now; anything that is not a sane number is replaced by the last good sample
  /// @param newest  newest complete handle model, or nullptr before the first. It is copied.
  /// @param now     [s]; much later than one tick after the last: a gap, after which the force starts from zero
  TickRecord tick(const DeviceState& sample, const HandleModel* newest, double now) noexcept;

  /// A live model for the next ticks, to be used once it is replayed to where the path ends. Between two ticks; copied.
  /// One that is no newer than the last is left aside: it may be offered again and again.
  void offer(const LiveUpdate& update) noexcept;
  /// Of the proxy, a point at each tick; the last is where the next tick begins.
  const HandlePath& path() const noexcept { return path_; }

  /// Another way to make the force, from the next tick on; between two ticks. The proxy goes on from where it is.
  /// @param model_age_limit  at which a model is stale [s]
  void change(Rendering rendering, double model_age_limit) noexcept;

  /// Between two ticks: from the next one on the force leaves, within the safety stage's `end_fade`.
  void leave() noexcept { safety_.leave(); }
  /// Zero is sent.
  bool gone() const noexcept { return safety_.gone(); }
  /// The force starts from zero where it has left.
  void comeBack() noexcept { safety_.comeBack(); }

  /// Between two ticks.
  HapticLoopState state() const noexcept;
  void restore(const HapticLoopState& state) noexcept;

  const TickCounters& counters() const noexcept { return counters_; }
  const PassivityObserver& passivity() const noexcept { return observer_; }
  const ModelAccount& models() const noexcept { return models_; }
  /// Energy at changes of live models.
  const SwitchAccount& switches() const noexcept { return account_; }
  const HapticSettings& settings() const noexcept { return settings_; }

 private:
  DeviceState readDevice(const DeviceState& sample, double since_last, Vec6& displacement, TickFlags& flags) noexcept;
  const HandleModel* takeModel(const HandleModel* newest, TickFlags& flags) noexcept;
  void takeLive(TickFlags& flags) noexcept;
  bool changeLive(TickFlags& flags) noexcept;
  TickFlags stepLive(const DeviceState& device) noexcept;
  Vec6 render(const HandleModel* model, const DeviceState& device, TickRecord& record) noexcept;
  Vec6 compensate(const Vec6& wrench, const Pose& handle) const noexcept;

  HapticSettings settings_;
  DeviceFilter filter_;
  HandleProxy proxy_;
  SafetyChain safety_;
  PassivityObserver observer_;
  TickCounters counters_;
  HandleModel model_;
  bool has_model_ = false;
  std::array<LiveUpdate, 2> live_;  // the one in use, and the one that is being replayed
  std::size_t current_ = 0;
  bool has_live_ = false, has_pending_ = false;
  std::int64_t offered_ = HapticLoopState::kNoOffer;
  LiveTick live_tick_;
  SwitchAccount account_;
  ModelAccount models_;
  HandlePath path_;
  double start_time_ = 0.0, last_time_ = 0.0;
  Pose last_device_pose_;
  Vec6 last_sent_ = Vec6::Zero();
};

/// True where every number of the model is finite.
bool isFinite(const HandleModel& model) noexcept;

}  // namespace palpate
