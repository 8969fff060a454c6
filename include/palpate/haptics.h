#pragma once

/// @file
/// The haptic loop alone: a small linear model of a force goes in, a force for a device comes out, a thousand times a
/// second. For those who have a simulator of their own. Library palpate::haptics; it needs no solver.
///
///     palpate::HapticLoop loop({});
///     loop.start(device.sample(0).pose, handle, 0);
///     for (;;) {
///       palpate::Tick tick = loop.tick(device.sample(t), models.newest(), t);
///       device.apply(tick.sent, t, loop.settings().step);
///     }
///
/// Units: m, kg, s, N, N m, rad. World frame, right-handed. Twists (v, w), wrenches (f, tau) and changes of a pose
/// (dp, dtheta) have the linear part first. Wrenches are about the handle's origin.

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "palpate/api.h"

PALPATE_BEGIN_API

/// Version of the library that runs, e.g. "0.1.0": PALPATE_VERSION_STRING is that of the headers.
PALPATE_EXPORT const char* version() noexcept;

using Vector3 = std::array<double, 3>;
using Vector6 = std::array<double, 6>;
using Matrix3 = std::array<double, 9>;     ///< by rows
using Matrix6 = std::array<double, 36>;    ///< by rows
using Quaternion = std::array<double, 4>;  ///< w, x, y, z

/// No limit.
inline constexpr double kUnlimited = std::numeric_limits<double>::infinity();

// --- errors

/// Bad input: a scene, a mesh file, a setting. what() is one line: file, key, cause.
class PALPATE_EXPORT InputError : public std::runtime_error {
 public:
  InputError(std::string file, std::string key, std::string cause);
  ~InputError() override;
  const std::string& file() const noexcept { return file_; }  ///< or the setting that is wrong
  const std::string& key() const noexcept { return key_; }    ///< in it, e.g. "tool.material.density"; may be empty
  const std::string& cause() const noexcept { return cause_; }

 private:
  std::string file_, key_, cause_;
};

/// What failed although its input was good: a step, a device.
class PALPATE_EXPORT RunError : public std::runtime_error {
 public:
  explicit RunError(const std::string& what);
  ~RunError() override;
};

// --- the handle, its model, the device

/// Position [m] and orientation of a rigid frame in the world.
struct Pose {
  Vector3 position{};
  Quaternion rotation{1, 0, 0, 0};  ///< of unit length
};

/// (p - p0, log(R R0^T)): change of a pose [m; rad].
PALPATE_EXPORT Vector6 difference(const Pose& pose, const Pose& from) noexcept;
/// p + dp, exp(dtheta) R: the pose changed by that.
PALPATE_EXPORT Pose moved(const Pose& pose, const Vector6& change) noexcept;

/// All that the haptic loop gets from a simulation: the wrench of the tool on the handle, and how it changes with the
/// handle's pose x and twist u.
///   F*(x, u) = force + kx (x - x0) + kv (u - u0),   x - x0 = difference(x, x0)
/// A simulator fills in force, pose, twist, kx, kv, time; for virtual coupling handle_pose and handle_twist alone.
struct HandleModel {
  Vector6 force{};   ///< of the tool on the handle [N; N m], not of the handle's own weight
  Pose pose;         ///< x0
  Vector6 twist{};   ///< u0 [m/s; rad/s]
  Matrix6 kx{};      ///< dF/dx [N/m, N/rad; N, N m/rad]: negative where the tool resists
  Matrix6 kv{};      ///< dF/du [N s/m, ...]
  Pose handle_pose;  ///< the simulation's handle at the end of its step: what virtual coupling pulls towards
  Vector6 handle_twist{};
  double time = 0;       ///< of x0 and u0 [s]
  double step = 0;       ///< of the simulation [s]; 0: unknown
  bool unsound = false;  ///< the step failed or was cut: the loop says so in its flags

  /// F* [N; N m].
  PALPATE_EXPORT Vector6 at(const Pose& x, const Vector6& u) const noexcept;
};

/// What a device reports at one instant.
struct DeviceState {
  Pose pose;
  Vector6 twist{};                   ///< [m/s; rad/s]
  std::uint32_t buttons = 0;         ///< bit k: button k + 1 is pressed
  double force_limit = kUnlimited;   ///< what it gives now, below its limits [N]
  double torque_limit = kUnlimited;  ///< [N m]
};

/// What a device can render. Those of a Phantom Omni, but for the torque.
struct DeviceLimits {
  double peak_force = 3.3;            ///< [N]
  double continuous_force = 0.88;     ///< [N]
  double peak_torque = 0.1;           ///< [N m]; 0: none
  double stiffness = 700;             ///< largest stable one of a link [N/m]
  double damping = 5;                 ///< [N s/m]
  double rotational_stiffness = 1;    ///< [N m/rad]
  double rotational_damping = 0.005;  ///< [N m s/rad]
  double workspace_radius = 0.1;      ///< [m]
};

/// Spring and damper between handle (or its proxy) and device.
struct Link {
  double stiffness = 700;             ///< [N/m]
  double damping = 5;                 ///< [N s/m]
  double rotational_stiffness = 1;    ///< [N m/rad]
  double rotational_damping = 0.005;  ///< [N m s/rad]
  double peak_force = kUnlimited;     ///< at which spring and damper saturate [N]
  double peak_torque = kUnlimited;    ///< [N m]

  /// The stiffest that a device allows.
  PALPATE_EXPORT static Link of(const DeviceLimits& limits) noexcept;
  /// On the device: kd (x - xd) + bd (v - vd), kr log(R Rd^T) + br (w - wd), within the peaks [N; N m]. The handle
  /// feels the opposite.
  PALPATE_EXPORT Vector6 wrenchOnDevice(const Pose& handle, const Vector6& twist,
                                        const DeviceState& device) const noexcept;
};

/// A haptic device, or something that stands for one: derive your own. sample() and apply() are called from the tick,
/// in turn: they neither block, allocate nor throw.
class PALPATE_EXPORT Device {
 public:
  Device();
  virtual ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  virtual const char* name() const noexcept = 0;
  virtual DeviceLimits limits() const noexcept;
  /// Before the first tick of a Run.
  /// @param start   where the handle is at rest: samples begin there
  /// @param wrench  that the hand already carries [N; N m]
  virtual void begin(const Pose& start, const Vector6& wrench) noexcept;
  /// State at time t [s] since the start.
  virtual DeviceState sample(double t) noexcept = 0;
  /// The wrench on the device [N; N m], to be held for the tick [t, t + dt).
  virtual void apply(const Vector6& wrench, double t, double dt) noexcept = 0;

  /// True for one whose library calls at its own rate: run() then calls `tick` until that returns false.
  virtual bool keepsTime() const noexcept;
  virtual void run(const std::function<bool()>& tick);
  /// A person holds it: no virtual time.
  virtual bool isReal() const noexcept;
  /// Why it does not work any more; null: it does. Any thread.
  virtual const char* failure() const noexcept;
  /// What it must remember between two ticks, for a run that is saved.
  virtual std::vector<double> save() const;
  /// @throws InputError
  virtual void restore(const std::vector<double>& memory);
};

/// A place on a path, relative to its start: p = p_start + position, R = exp(rotation) R_start.
struct Keyframe {
  double time = 0;     ///< [s]; they increase
  Vector3 position{};  ///< [m]
  Vector3 rotation{};  ///< rotation vector [rad]
};

/// The motion through keyframes; rests before and after them.
struct Path {
  std::vector<Keyframe> keyframes;
  bool smooth = true;  ///< at rest in every keyframe; otherwise straight and at constant speed between them
};

/// A device's mass in a hand, both simulated.
struct SimulatedHand {
  double mass = 0.045;                    ///< of the device [kg]
  double damping = 0.2;                   ///< [N s/m]
  double inertia = 1.1e-4;                ///< [kg m^2]
  double rotational_damping = 5e-4;       ///< [N m s/rad]
  double stiffness = 500;                 ///< of the hand [N/m]; with 0 everywhere nobody holds the device
  double hand_damping = 8;                ///< [N s/m]
  double rotational_stiffness = 2;        ///< [N m/rad]
  double hand_rotational_damping = 0.03;  ///< [N m s/rad]
};

/// A device that a simulated hand moves along a path, and that gives way to the force. @throws InputError
PALPATE_EXPORT std::unique_ptr<Device> simulatedDevice(const Path& path, const Pose& start,
                                                       const SimulatedHand& hand = {}, const DeviceLimits& limits = {});
/// A device that follows a path whatever it feels. @throws InputError
PALPATE_EXPORT std::unique_ptr<Device> prescribedDevice(const Path& path, const Pose& start,
                                                        const DeviceLimits& limits = {});

/// Devices that there are drivers for: name, what it is.
PALPATE_EXPORT std::vector<std::pair<std::string, std::string>> deviceKinds();
/// A device on a desk, with workspace, clutch and heat of its motors looked after (docs/devices.md).
/// @param kind     of deviceKinds()
/// @param options  "key=value,key=value"
/// @param start    of the handle; the device is joined to it wherever it is
/// @param step     of the tick that it will be used in [s]
/// @throws RunError if there is none, InputError for a kind or option that is unknown
PALPATE_EXPORT std::unique_ptr<Device> openDevice(const std::string& kind, const std::string& options,
                                                  const Pose& start, double step = 0.001);

// --- safety

/// Takes energy out of a force that gives more than it got.
struct Passivity {
  bool enabled = false;
  double allowance = 0.01;                ///< energy that may come out before [J]
  double max_damping = 2;                 ///< [N s/m]
  double max_rotational_damping = 0.005;  ///< [N m s/rad]
  double quiet_speed = 0.005;             ///< below it damping rests [m/s]
  double quiet_spin = 0.1;                ///< [rad/s]
};

/// Finds a force that swings by itself, and lets it leave.
struct Oscillation {
  bool enabled = true;
  double band = 6;       ///< slower is the hand's own motion [Hz]
  double window = 0.08;  ///< over which power is averaged [s]
  int windows = 4;       ///< in a row that must be active
  double power = 0.006;  ///< that the hand is given in an active one, at least [W]
  double fade = 0.1;     ///< time in which the force leaves [s]
  double rest = 0.3;     ///< for which it stays away [s]
  double ramp = 0.5;     ///< time in which it would come back whole [s]
  double share = 0.5;    ///< of what it was that comes back
  double recovery = 60;  ///< time in which a share of 0 would grow to 1 again [s]
};

/// When there may be a force at all.
struct Presence {
  int dead_man = 0;                  ///< button that must be pressed, 1 to 32; 0: none
  bool start_gate = false;           ///< first a small push finds out whether somebody holds the device
  double push = 0.1;                 ///< of the gate, upwards [N]
  double push_time = 0.2;            ///< [s]
  double push_travel = 0.01;         ///< farther than this nobody holds it [m]
  double calm_speed = 0.1;           ///< of the device, before the push [m/s]
  double calm_time = 0.3;            ///< for which it is calm [s]
  double gate_ramp = 1.5;            ///< time in which the force fades in behind the gate [s]
  double workspace = kUnlimited;     ///< distance from the start [m]
  double frozen_limit = kUnlimited;  ///< same pose for so long while it is pushed [s]
  double frozen_force = 0.1;         ///< from which on it counts as pushed [N]
  double fade = 0.1;                 ///< time in which the force leaves [s]
};

/// Last stage before the device. An infinite limit switches a stage off.
struct Safety {
  double peak_force = 3.3;        ///< [N]
  double peak_torque = 0.1;       ///< [N m]; 0: no torque
  double max_slew = 3000;         ///< largest change of the force [N/s]
  double max_torque_slew = 90;    ///< [N m/s]
  double start_ramp = 0;          ///< time in which the force fades in [s]; for a person's hand 1.5 is good
  double model_age_limit = 0.25;  ///< older models let the force fade out [s]
  double model_decay = 0.1;       ///< time of that [s]
  double gap_limit = 0.05;        ///< longer from one tick to the next is a gap: force starts from zero [s]
  double gap_ramp = 0.5;          ///< [s]
  double end_fade = 0.1;          ///< time in which the force leaves after leave() [s]
  Passivity passivity;
  Oscillation oscillation;
  Presence presence;

  /// The default with the peaks of a device.
  PALPATE_EXPORT static Safety of(const DeviceLimits& limits) noexcept;
};

/// What was out of the ordinary in a tick: bit k of its flags.
enum class TickFlag : std::uint32_t {
  device_rejected,         ///< sample was no sane number: the last good one was used
  model_rejected,          ///< the last good model was used
  model_missing,           ///< no model has come yet
  model_rotation_clamped,  ///< proxy is turned farther from x0 than the model is trusted
  stiffness_projected,     ///< the model was active: its active part was taken explicitly
  proxy_limited,           ///< proxy's speed or its distance from the device was cut
  proxy_reset,             ///< result was not finite: the proxy went back to the device
  wrench_non_finite,       ///< zero was sent
  model_stale,             ///< the force is lowered, as the model is old
  force_clamped,           ///< to its peak
  torque_clamped,          ///< to its peak
  slew_limited,            ///< changes more slowly than asked for
  ramping,                 ///< fades in
  passivity_damped,        ///< energy was taken out
  model_catching_up,       ///< method live only: a newer model is being replayed
  model_damped,            ///< method live only: a model brought energy that is not paid for
  model_unsound,           ///< the model says so itself
  gap,                     ///< first tick after a gap in time
  fading,                  ///< the force leaves, as the run ends
  device_lost,             ///< sample was rejected or is frozen: the force leaves
  button_released,         ///< dead-man button: the force leaves
  outside_workspace,       ///< the force leaves
  gate_closed,             ///< it is not known yet that somebody holds the device
  oscillation,             ///< the force swung by itself: it leaves
  calmed,                  ///< smaller, as it has swung
  device_limited,          ///< to what the device gives now
  count
};

/// Name of a flag, as in reports.
PALPATE_EXPORT const char* toString(TickFlag flag) noexcept;
inline bool has(std::uint32_t flags, TickFlag flag) noexcept { return (flags >> static_cast<unsigned>(flag)) & 1u; }

/// The safety stage alone, for a force that comes from elsewhere: non-finite to zero, watchdog, passivity, peaks, slew,
/// ramps, presence, oscillation.
class PALPATE_EXPORT SafetyChain {
 public:
  /// @throws InputError for a limit that is negative or not a number
  explicit SafetyChain(const Safety& settings);
  ~SafetyChain();
  SafetyChain(SafetyChain&&) noexcept;
  SafetyChain& operator=(SafetyChain&&) noexcept;

  /// @param device  at the start; middle of its workspace
  /// @return what is sent at the start [N; N m]
  Vector6 start(const Vector6& wrench, const DeviceState& device) noexcept;
  struct Output {
    Vector6 wrench;  ///< to be sent [N; N m]
    std::uint32_t flags;
  };
  /// @param wrench     wanted on the device [N; N m]
  /// @param model_age  of what the wrench comes from [s]
  /// @param now        since the start [s]; later than after the last call
  Output process(const Vector6& wrench, const DeviceState& device, double model_age, double now) noexcept;
  /// From the next call on the force leaves; gone(): it has left.
  void leave() noexcept;
  bool gone() const noexcept;
  /// Net energy given to the hand so far [J].
  double deliveredEnergy() const noexcept;

 private:
  struct PALPATE_LOCAL Impl;
  std::unique_ptr<Impl> impl_;
};

// --- the loop

enum class Rendering {
  linearized,        ///< a proxy of the handle is pulled by the handle model and by the link
  virtual_coupling,  ///< the link pulls towards HandleModel::handle_pose; no proxy
};

/// The copy of the handle that lives in the loop.
struct Proxy {
  double mass = 0.05;                                   ///< of handle and what is attached to it [kg]
  Matrix3 inertia{1e-5, 0, 0, 0, 1e-5, 0, 0, 0, 1e-5};  ///< about the origin, body axes [kg m^2]
  Vector3 gravity{0, 0, -9.81};                         ///< [m/s^2]; the origin is the center of mass
  double max_stretch = 0.25;                            ///< distance from the device [m]
  double max_turn = 2.5;                                ///< angle to the device [rad]
  double max_speed = 20;                                ///< [m/s]
  double max_spin = 200;                                ///< [rad/s]
  double max_model_rotation = 2;                        ///< angle from x0 beyond which kx sees no more rotation [rad]
};

struct HapticSettings {
  double step = 0.001;  ///< of a tick [s]
  Rendering rendering = Rendering::linearized;
  Link link;
  Proxy proxy;
  Vector3 compensated_weight{};  ///< that the device is not to show, of handle and tool together [N]
  Vector3 compensated_center{};  ///< where it acts, handle's frame [m]
  Safety safety;
};

/// Everything about one tick; values after it.
struct Tick {
  double time = 0;              ///< [s]
  DeviceState device;           ///< sample that was used
  Pose proxy;                   ///< with virtual coupling the simulation's handle
  Vector6 proxy_twist{};        ///< [m/s; rad/s]
  Vector6 raw{};                ///< wrench of the link on the device [N; N m]
  Vector6 sent{};               ///< after compensation and safety: what goes to the device [N; N m]
  double model_age = 0;         ///< [s]; infinite before the first model
  double delivered_energy = 0;  ///< net energy given to the hand so far [J]
  std::uint32_t flags = 0;      ///< of TickFlag
};

/// All of a haptic loop between two ticks. Cheap to copy.
class PALPATE_EXPORT HapticState {
 public:
  HapticState();  ///< none
  HapticState(const HapticState&);
  HapticState& operator=(const HapticState&);
  ~HapticState();

 private:
  friend class HapticLoop;
  struct PALPATE_LOCAL Impl;
  std::shared_ptr<const Impl> impl_;
};

/// The haptic loop without its clock. After construction nothing in tick() allocates, locks, throws or calls the
/// system.
class PALPATE_EXPORT HapticLoop {
 public:
  /// @throws InputError for settings out of range
  explicit HapticLoop(const HapticSettings& settings);
  ~HapticLoop();
  HapticLoop(HapticLoop&&) noexcept;
  HapticLoop& operator=(HapticLoop&&) noexcept;

  /// Begins at rest.
  /// @param handle  in equilibrium with the device
  /// @param now     time of the first tick [s]
  /// @return wrench on the device at the start [N; N m]
  Vector6 start(const Pose& device, const Pose& handle, double now) noexcept;
  /// One tick.
  /// @param newest  model, copied; null before the first
  /// @param now     [s]
  Tick tick(const DeviceState& device, const HandleModel* newest, double now) noexcept;
  /// From the next tick on the force leaves; gone(): it has left; comeBack(): it starts from zero.
  void leave() noexcept;
  bool gone() const noexcept;
  void comeBack() noexcept;
  /// Ticks so far in which a flag was raised.
  std::uint64_t count(TickFlag flag) const noexcept;

  HapticState state() const;
  /// Of a loop with the same settings: what follows is the same to the bit. @throws InputError for a state that is none
  void restore(const HapticState& state);
  const HapticSettings& settings() const noexcept;

 private:
  struct PALPATE_LOCAL Impl;
  std::unique_ptr<Impl> impl_;
};

// --- real time

/// Hands the newest model from a simulation's thread to a haptic thread; neither ever waits.
class PALPATE_EXPORT ModelExchange {
 public:
  ModelExchange();
  ~ModelExchange();
  ModelExchange(const ModelExchange&) = delete;
  ModelExchange& operator=(const ModelExchange&) = delete;
  /// The simulation's thread only.
  void publish(const HandleModel& model) noexcept;
  /// The haptic thread only: null before the first; stays as it is until the next call.
  const HandleModel* newest() noexcept;

 private:
  struct PALPATE_LOCAL Impl;
  std::unique_ptr<Impl> impl_;
};

/// p50, p99, p99.9, max [us].
using Percentiles = std::array<double, 4>;

/// Timing of a loop in real time.
struct LoopReport {
  std::uint64_t ticks = 0;
  std::uint64_t missed = 0;       ///< deadlines that went by
  std::uint64_t most_missed = 0;  ///< in a row
  Percentiles work_us{};          ///< of a tick, with sample() and apply()
  Percentiles wake_us{};          ///< deadline to wake-up
  std::string note;               ///< what the system refused (real-time priority ...); empty: nothing
};

/// Runs started ticks on the calling thread in real time, until `duration` [s] is over, `stop` is set or the device
/// fails; then the force leaves. Asks the system for real-time priority.
/// @param each  called after each tick, on this thread; must neither block nor throw
/// @throws RunError if the device has failed
PALPATE_EXPORT LoopReport runHapticLoop(HapticLoop& loop, Device& device, ModelExchange& models, double duration,
                                        const std::atomic<bool>& stop,
                                        const std::function<void(const Tick&)>& each = {});

PALPATE_END_API
