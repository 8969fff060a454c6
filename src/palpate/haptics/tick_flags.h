#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace palpate {

/// What was out of the ordinary in a tick; bits of TickRecord::flags.
enum class TickFlag : std::uint32_t {
  device_rejected,         ///< device sample was not finite or absurd: the last good one was used
  model_rejected,          ///< handle model was not finite, or brought too much energy: the last good one was used
  model_missing,           ///< no handle model has arrived yet
  model_rotation_clamped,  ///< proxy is turned farther from the model's reference than the model is trusted
  stiffness_projected,     ///< derivative of the model was active: its active part was taken explicitly
  proxy_limited,           ///< proxy's speed or its distance from the device was cut
  proxy_reset,             ///< result of the tick was not finite: the proxy went back to the device
  wrench_non_finite,       ///< wrench was not finite: zero
  model_stale,             ///< watchdog lowers the wrench
  force_clamped,           ///< to the device's peak force
  torque_clamped,          ///< to the device's peak torque
  slew_limited,            ///< wrench changes more slowly than asked for
  ramping,                 ///< force fades in after the start or after a gap
  passivity_damped,        ///< passivity controller took energy out
  model_catching_up,       ///< a newer live model is still being replayed along the path
  model_damped,            ///< a new live model brought more energy than is paid for: its modes were slowed down
  model_unsound,           ///< the visual step of the model in use failed, was cut, or its contact was not solved
  gap,                     ///< first tick after a gap in time: the force starts from zero
  fading,                  ///< the force leaves, as the run ends
  device_lost,             ///< sample was rejected, or the device is frozen: the force leaves
  button_released,         ///< dead-man button is not pressed: the force leaves
  outside_workspace,       ///< device is too far from the start: the force leaves
  gate_closed,             ///< start gate: it is not known yet that somebody holds the device
  oscillation,             ///< force was found to swing by itself: it leaves, and comes back with half its size
  calmed,                  ///< force is smaller, as it has swung
  device_limited,  ///< to what the device gives now, which is less: clutch, warm motors, its return after a loss
  count
};

inline constexpr std::size_t kTickFlagCount = static_cast<std::size_t>(TickFlag::count);

/// Name of a flag in reports.
constexpr const char* toString(TickFlag flag) {
  constexpr std::array<const char*, kTickFlagCount> names{"device_rejected",
                                                          "model_rejected",
                                                          "model_missing",
                                                          "model_rotation_clamped",
                                                          "stiffness_projected",
                                                          "proxy_limited",
                                                          "proxy_reset",
                                                          "wrench_non_finite",
                                                          "model_stale",
                                                          "force_clamped",
                                                          "torque_clamped",
                                                          "slew_limited",
                                                          "ramping",
                                                          "passivity_damped",
                                                          "model_catching_up",
                                                          "model_damped",
                                                          "model_unsound",
                                                          "gap",
                                                          "fading",
                                                          "device_lost",
                                                          "button_released",
                                                          "outside_workspace",
                                                          "gate_closed",
                                                          "oscillation",
                                                          "calmed",
                                                          "device_limited"};
  return names[static_cast<std::size_t>(flag)];
}

/// Set of flags.
class TickFlags {
 public:
  void set(TickFlag flag) noexcept { bits_ |= 1u << static_cast<unsigned>(flag); }
  bool has(TickFlag flag) const noexcept { return (bits_ >> static_cast<unsigned>(flag)) & 1u; }
  std::uint32_t bits() const noexcept { return bits_; }
  TickFlags& operator|=(TickFlags other) noexcept {
    bits_ |= other.bits_;
    return *this;
  }

 private:
  std::uint32_t bits_ = 0;
};

/// Number of ticks in which each flag was raised.
class TickCounters {
 public:
  void add(TickFlags flags) noexcept {
    for (std::size_t k = 0; k < kTickFlagCount; ++k) counts_[k] += (flags.bits() >> k) & 1u;
  }
  std::uint64_t operator[](TickFlag flag) const noexcept { return counts_[static_cast<std::size_t>(flag)]; }

 private:
  std::array<std::uint64_t, kTickFlagCount> counts_{};
};

}  // namespace palpate
