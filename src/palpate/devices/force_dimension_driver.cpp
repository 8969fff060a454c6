#include "palpate/devices/force_dimension_driver.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cctype>
#include <chrono>
#include <cmath>

#include "palpate/common/dynamic_library.h"
#include "palpate/common/error.h"

namespace palpate {
namespace {

// The library's functions, declared after its public documentation; the last argument is the device, -1 the default.
struct ForceDimensionLibrary {
  explicit ForceDimensionLibrary(const std::vector<std::string>& names) : library(names) {
    library.find(getDeviceCount, "dhdGetDeviceCount");
    library.findIfThere(getAvailableCount, "dhdGetAvailableCount");
    library.findIfThere(drdOpenId, "drdOpenID");
    library.findIfThere(drdClose, "drdClose");
    library.findIfThere(drdIsInitialized, "drdIsInitialized");
    library.findIfThere(drdAutoInit, "drdAutoInit");
    library.findIfThere(drdStop, "drdStop");
    library.find(openId, "dhdOpenID");
    library.find(close, "dhdClose");
    library.find(getSystemName, "dhdGetSystemName");
    library.findIfThere(getSerialNumber, "dhdGetSerialNumber");
    library.findIfThere(getSdkVersion, "dhdGetSDKVersion");
    library.findIfThere(hasActiveWrist, "dhdHasActiveWrist");
    library.findIfThere(hasWrist, "dhdHasWrist");
    library.find(enableForce, "dhdEnableForce");
    library.findIfThere(setGravityCompensation, "dhdSetGravityCompensation");
    library.findIfThere(setBrakes, "dhdSetBrakes");
    library.find(getPositionAndFrame, "dhdGetPositionAndOrientationFrame");
    library.find(getLinearVelocity, "dhdGetLinearVelocity");
    library.findIfThere(getAngularVelocity, "dhdGetAngularVelocityRad");
    library.findIfThere(configVelocity, "dhdConfigLinearVelocity");
    library.findIfThere(getButtonMask, "dhdGetButtonMask");
    library.find(setForce, "dhdSetForceAndTorqueAndGripperForce");
    library.find(getStatus, "dhdGetStatus");
    library.findIfThere(setMaxForce, "dhdSetMaxForce");
    library.findIfThere(setMaxTorque, "dhdSetMaxTorque");
    library.findIfThere(getMaxForce, "dhdGetMaxForce");
    library.findIfThere(enableExpert, "dhdEnableExpertMode");
    library.findIfThere(setWatchdog, "dhdSetWatchdog");
    library.findIfThere(setVelocityThreshold, "dhdSetVelocityThreshold");
    library.findIfThere(setTimeGuard, "dhdSetTimeGuard");
    library.findIfThere(enableSimulator, "dhdEnableSimulator");
    library.findIfThere(getLastError, "dhdErrorGetLastStr");
  }

  std::string error() const {
    const char* text = getLastError ? getLastError() : nullptr;
    return text ? text : "no reason given";
  }

  DynamicLibrary library;
  int (*getDeviceCount)() = nullptr;
  int (*getAvailableCount)() = nullptr;
  int (*drdOpenId)(char) = nullptr;
  int (*drdClose)(char) = nullptr;
  bool (*drdIsInitialized)(char) = nullptr;
  int (*drdAutoInit)(char) = nullptr;
  int (*drdStop)(bool, char) = nullptr;
  int (*openId)(char) = nullptr;
  int (*close)(char) = nullptr;
  const char* (*getSystemName)(char) = nullptr;
  int (*getSerialNumber)(unsigned short*, char) = nullptr;
  int (*getSdkVersion)(int*, int*, int*, int*) = nullptr;
  bool (*hasActiveWrist)(char) = nullptr;
  bool (*hasWrist)(char) = nullptr;
  int (*enableForce)(unsigned char, char) = nullptr;
  int (*setGravityCompensation)(int, char) = nullptr;
  int (*setBrakes)(int, char) = nullptr;
  int (*getPositionAndFrame)(double*, double*, double*, double[3][3], char) = nullptr;
  int (*getLinearVelocity)(double*, double*, double*, char) = nullptr;
  int (*getAngularVelocity)(double*, double*, double*, char) = nullptr;
  int (*configVelocity)(int, int, char) = nullptr;
  unsigned (*getButtonMask)(char) = nullptr;
  int (*setForce)(double, double, double, double, double, double, double, char) = nullptr;
  int (*getStatus)(int*, char) = nullptr;
  int (*setMaxForce)(double, char) = nullptr;
  int (*setMaxTorque)(double, char) = nullptr;
  double (*getMaxForce)(char) = nullptr;
  int (*enableExpert)() = nullptr;
  int (*setWatchdog)(unsigned char, char) = nullptr;
  int (*setVelocityThreshold)(unsigned, char) = nullptr;
  int (*setTimeGuard)(int, char) = nullptr;
  void (*enableSimulator)(bool) = nullptr;
  const char* (*getLastError)() = nullptr;
};

struct Model {
  const char* word;  // in the system's name, small letters
  double force, torque, stiffness, radius;
};
// What public client code uses for each.
constexpr std::array<Model, 5> kModels{{{"omega", 12, 0, 5000, 0.075},
                                        {"delta", 20, 0, 5000, 0.15},
                                        {"sigma", 12, 0.2, 4000, 0.075},
                                        {"lambda", 12, 0.2, 8000, 0.1125},
                                        {"falcon", 8, 0, 3000, 0.04}}};
constexpr Model kUnknown{"", 4, 0, 1000, 0.04};

enum Status { kPower = 0, kConnected = 1, kForceOn = 5, kError = 9, kForceOffCause = 14, kStatusSize = 32 };

constexpr int kCauses = 7;  // 0: unknown

const char* causeText(int cause) {
  switch (cause) {
    case 1:
      return "force switched off by the device's button";
    case 2:
      return "force switched off: it moved too fast";
    case 3:
      return "force switched off by its watchdog";
    case 4:
      return "force switched off by software";
    case 5:
      return "force switched off: USB";
    case 6:
      return "force switched off: nobody holds it";
    default:
      return "force switched off by the device";
  }
}

// The device's axes: x towards the person, y right, z up.
Vec3 fromForceDimension(const Vec3& v) { return {v.y(), -v.x(), v.z()}; }
Vec3 toForceDimension(const Vec3& v) { return {-v.y(), v.x(), v.z()}; }

class ForceDimensionDriver final : public DeviceDriver {
 public:
  ForceDimensionDriver(const DeviceOptions& options, OpenFor purpose) : lib_(names(options)) {
    if (options.flag("simulator", false) && lib_.enableSimulator) lib_.enableSimulator(true);
    openDevice();
    describe();
    if (purpose == OpenFor::looking) {
      closeDevice();
      return;
    }
    try {
      prepare(options);
    } catch (...) {
      closeDevice();
      throw;
    }
    running_ = true;
  }
  ~ForceDimensionDriver() override {
    if (!running_) return;
    release();
    lib_.enableForce(0, kId);
    closeDevice();
  }

  const DriverInfo& info() const noexcept override { return info_; }

  bool read(DriverSample& sample) noexcept override {
    if (!enabled_) {  // with the first tick, as from here on the watchdog is fed
      send(Vec6::Zero());
      if (lib_.enableForce(1, kId) < 0) {
        count(bad_, "the force cannot be switched on");
        return false;
      }
      enabled_ = true;
    }
    Vec3 p, v = Vec3::Zero(), w = Vec3::Zero();
    double frame[3][3];
    int good = lib_.getPositionAndFrame(&p.x(), &p.y(), &p.z(), frame, kId);
    if (good >= 0) good = lib_.getLinearVelocity(&v.x(), &v.y(), &v.z(), kId);
    if (good >= 0 && info_.has_spin) good = lib_.getAngularVelocity(&w.x(), &w.y(), &w.z(), kId);
    if (good < 0) {
      count(bad_, "no state from the device: is it unplugged?");
      return false;
    }
    Mat3 turn;  // from the handle's frame to the device's
    for (int i = 0; i < 3; ++i) turn.row(i) = Vec3(frame[i][0], frame[i][1], frame[i][2]);
    Mat3 axes;
    axes << 0, 1, 0, -1, 0, 0, 0, 0, 1;
    sample.pose.position = fromForceDimension(p);
    sample.pose.rotation = Quat(Mat3(axes * turn * axes.transpose())).normalized();
    sample.twist << fromForceDimension(v), fromForceDimension(w);
    sample.buttons = lib_.getButtonMask ? lib_.getButtonMask(kId) : 0;
    const char* off = forceOff();
    trouble_.store(off, std::memory_order_relaxed);
    bad_ = 0;
    return off == nullptr;
  }

  void write(const Vec6& wrench) noexcept override {
    send(forces_off_ ? Vec6(Vec6::Zero()) : wrench);  // zero keeps the watchdog quiet until the force is on again
  }
  void release() noexcept override { send(Vec6::Zero()); }
  const char* trouble() const noexcept override { return trouble_.load(std::memory_order_relaxed); }
  std::vector<std::string> notes() const override {
    std::vector<std::string> out;
    for (int cause = 0; cause < kCauses; ++cause) {
      const int times = off_times_[static_cast<std::size_t>(cause)];
      if (times > 0) out.push_back(fmt::format("{} ({} times)", causeText(cause), times));
    }
    if (refused_ > 0) out.push_back(fmt::format("forces that were refused ({} times)", refused_));
    if (saturated_ > 0) out.push_back(fmt::format("motors saturated ({} times)", saturated_));
    return out;
  }

 private:
  static constexpr char kId = -1;
  /// From a force that was switched off to the next look: long enough to count as a loss, whatever the rate.
  static constexpr std::chrono::milliseconds kAgain{100};

  static std::vector<std::string> names(const DeviceOptions& options) {
    if (options.has("library")) return {options.text("library", "")};
    return {"libdrd.so.3", "libdrd.so", "libdhd.so.3", "libdhd.so"};
  }

  void openDevice() {
    const int count = lib_.getDeviceCount();
    if (count == 0)
      throw RunError("force_dimension: no device is connected (USB vendor 1451; Linux needs a udev rule)");
    if (lib_.getAvailableCount && lib_.getAvailableCount() == 0) {
      throw RunError("force_dimension: the device is in use by another program");
    }
    with_drd_ = lib_.drdOpenId && lib_.drdClose;
    if ((with_drd_ ? lib_.drdOpenId(kId) : lib_.openId(kId)) < 0) {
      throw RunError("force_dimension: the device does not open: " + lib_.error());
    }
  }
  void closeDevice() {
    if (with_drd_) {
      lib_.drdClose(kId);
    } else {
      lib_.close(kId);
    }
  }

  void describe() {
    const char* system = lib_.getSystemName(kId);
    info_.name = system ? system : "Force Dimension";
    std::string small = info_.name;
    std::transform(small.begin(), small.end(), small.begin(), [](unsigned char c) { return std::tolower(c); });
    const auto found = std::find_if(kModels.begin(), kModels.end(),
                                    [&](const Model& m) { return small.find(m.word) != std::string::npos; });
    const Model& model = found == kModels.end() ? kUnknown : *found;
    DeviceLimits& l = info_.limits;
    l.peak_force = model.force;
    if (lib_.getMaxForce) {
      const double most = lib_.getMaxForce(kId);
      if (most > 0.0) l.peak_force = std::min(l.peak_force, most);
    }
    l.continuous_force = 0.5 * l.peak_force;  // not documented
    const bool wrist = lib_.hasActiveWrist && lib_.hasActiveWrist(kId);
    l.peak_torque = wrist ? model.torque : 0.0;
    l.stiffness = 0.5 * model.stiffness;  // half of what others render walls with at 4 kHz
    l.damping = 10.0;
    l.workspace_radius = model.radius;
    info_.rate = 4000.0;
    info_.has_spin = lib_.getAngularVelocity && lib_.hasWrist && lib_.hasWrist(kId);
    unsigned short serial = 0;
    if (lib_.getSerialNumber && lib_.getSerialNumber(&serial, kId) >= 0) info_.serial = std::to_string(serial);
    if (lib_.getSdkVersion) {
      int v[4] = {};
      lib_.getSdkVersion(&v[0], &v[1], &v[2], &v[3]);
      info_.facts.emplace_back("SDK", fmt::format("{}.{}.{}.{}", v[0], v[1], v[2], v[3]));
    }
    info_.facts.emplace_back("library", with_drd_ ? "drd" : "dhd");
    info_.facts.emplace_back("wrist", wrist ? "with torque" : info_.has_spin ? "without torque" : "none");
    int status[kStatusSize] = {};
    if (lib_.getStatus(status, kId) >= 0) {
      info_.facts.emplace_back("power", status[kPower] ? "yes" : "no");
      if (!status[kPower]) trouble_.store("it has no power");
    }
  }

  void require(int result, const char* what) const {
    if (result < 0) throw RunError(fmt::format("force_dimension: {}: {}", what, lib_.error()));
  }

  void prepare(const DeviceOptions& options) {
    if (trouble()) throw RunError(std::string("force_dimension: ") + trouble());
    if (with_drd_ && lib_.drdIsInitialized && !lib_.drdIsInitialized(kId)) {
      if (!options.flag("auto_init", false)) {
        throw RunError(
            "force_dimension: the device is not initialized. With force_dimension:auto_init=yes it moves its arm by "
            "itself to find its place: keep clear of it");
      }
      require(lib_.drdAutoInit ? lib_.drdAutoInit(kId) : -1, "initialization");
    }
    if (with_drd_ && lib_.drdStop) require(lib_.drdStop(true, kId), "end of its own regulation");
    protect(options);
    if (lib_.configVelocity) lib_.configVelocity(20, 0, kId);
    if (lib_.setGravityCompensation) require(lib_.setGravityCompensation(1, kId), "gravity compensation");
    if (lib_.setMaxForce) require(lib_.setMaxForce(info_.limits.peak_force, kId), "limit of the force");
    if (lib_.setMaxTorque && info_.limits.peak_torque > 0) lib_.setMaxTorque(info_.limits.peak_torque, kId);
    if (lib_.setBrakes) lib_.setBrakes(0, kId);
    require(send(Vec6::Zero()), "zero force");
  }

  // The firmware's own limits, which hold when this program stands.
  void protect(const DeviceOptions& options) {
    if (!lib_.enableExpert || !lib_.setWatchdog || lib_.enableExpert() < 0) {
      throw RunError("force_dimension: the watchdog cannot be switched on: " + lib_.error());
    }
    const double milliseconds = options.number("watchdog", 20, 1, 31.8);
    require(lib_.setWatchdog(static_cast<unsigned char>(std::lround(milliseconds / 0.125)), kId), "watchdog");
    info_.facts.emplace_back("watchdog", fmt::format("{:g} ms", milliseconds));
    if (lib_.setVelocityThreshold) {
      const auto threshold = static_cast<unsigned>(options.number("velocity_threshold", 40, 1, 255));
      require(lib_.setVelocityThreshold(threshold, kId), "velocity threshold");
      info_.facts.emplace_back("velocity threshold", std::to_string(threshold));
    }
    if (lib_.setTimeGuard) require(lib_.setTimeGuard(0, kId), "time guard");
  }

  // Asked now and then, as it costs a message; null: the force is on.
  const char* forceOff() noexcept {
    const auto now = std::chrono::steady_clock::now();
    if (forces_off_ ? now < again_ : ++ticks_ % 10 != 0) return trouble_.load(std::memory_order_relaxed);
    again_ = now + kAgain;
    int status[kStatusSize] = {};
    if (lib_.getStatus(status, kId) < 0) return "the device does not say how it is";
    if (!status[kConnected]) return "it is not connected";
    if (!status[kPower]) return "it has no power";
    if (status[kForceOn]) {
      forces_off_ = false;
      return nullptr;
    }
    const int cause = status[kForceOffCause] > 0 && status[kForceOffCause] < kCauses ? status[kForceOffCause] : 0;
    if (!forces_off_ || cause != cause_) ++off_times_[static_cast<std::size_t>(cause)];
    cause_ = cause;
    forces_off_ = true;
    // On again as from nothing: the loss makes the force come back in a ramp. The device's button stays the person's.
    if (cause != 1) {
      send(Vec6::Zero());
      lib_.enableForce(1, kId);
    }
    return causeText(cause);
  }

  int send(const Vec6& wrench) noexcept {
    const Vec3 f = toForceDimension(wrench.head<3>()), t = toForceDimension(wrench.tail<3>());
    const int result = lib_.setForce(f.x(), f.y(), f.z(), t.x(), t.y(), t.z(), 0.0, kId);
    if (result < 0) ++refused_;
    if (result == 2) ++saturated_;
    return result;
  }

  void count(int& times, const char* what) noexcept {
    ++times;
    trouble_.store(what, std::memory_order_relaxed);
  }

  ForceDimensionLibrary lib_;
  DriverInfo info_;
  bool with_drd_ = false, running_ = false, enabled_ = false, forces_off_ = false;
  int bad_ = 0, refused_ = 0, saturated_ = 0;
  std::int64_t ticks_ = 0;
  std::chrono::steady_clock::time_point again_;
  int cause_ = 0;                         // of the last force that was off
  std::array<int, kCauses> off_times_{};  // by each cause
  std::atomic<const char*> trouble_{nullptr};
};

}  // namespace

const std::vector<DeviceOption>& forceDimensionOptions() {
  static const std::vector<DeviceOption> options{
      {"library", "file of libdrd or libdhd; where the system finds them"},
      {"auto_init", "yes: an arm that is not initialized moves by itself to find its place; no"},
      {"watchdog", "without a new force for so long the firmware switches it off, ms, 1 to 31.8; 20"},
      {"velocity_threshold", "of the firmware, 1 to 255; 40"},
      {"simulator", "yes: also look for the vendor's simulated device; no"}};
  return options;
}

std::shared_ptr<DeviceDriver> openForceDimension(const DeviceOptions& options, OpenFor purpose) {
  try {
    return std::make_shared<ForceDimensionDriver>(options, purpose);
  } catch (const RunError& e) {
    const std::string text = e.what();
    throw RunError(text.starts_with("force_dimension: ") ? text : "force_dimension: no library: " + text);
  }
}

}  // namespace palpate
