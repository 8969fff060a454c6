#include "palpate/devices/open_haptics_driver.h"

#include <fmt/format.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <thread>

#include "palpate/common/dynamic_library.h"
#include "palpate/common/error.h"

namespace palpate {
namespace {

struct ErrorInfo {
  unsigned code;
  int internal;
  unsigned device;
};

constexpr unsigned kInvalid = 0xFFFFFFFF;
enum Name : unsigned {
  kButtons = 0x2000,
  kPosition = 0x2050,
  kVelocity = 0x2051,
  kTransform = 0x2052,
  kAngularVelocity = 0x2053,
  kVersion = 0x2500,
  kModel = 0x2501,
  kVendor = 0x2503,
  kSerial = 0x2504,
  kUsable = 0x2551,
  kOutputFreedoms = 0x2554,
  kCalibrationStyles = 0x2555,
  kUpdateRate = 0x2600,
  kMaxStiffness = 0x2602,
  kMaxForce = 0x2603,
  kMaxContinuousForce = 0x2604,
  kMotorTemperature = 0x2605,
  kMaxDamping = 0x2609,
  kForce = 0x2700,
  kForceOutput = 0x4000,
  kMaxForceClamping = 0x4001,
  kSoftwareForceLimit = 0x4003
};
constexpr unsigned kCalibrated = 0x5000, kNeedsUpdate = 0x5001;
constexpr unsigned kAutomatic = 2, kInkwell = 4;  // styles of calibration

using Callback = unsigned (*)(void*);

// Declared after the public header of version 3.30.
struct Library {
  explicit Library(const std::vector<std::string>& names) : library(names) {
    library.find(initDevice, "hdInitDevice");
    library.find(makeCurrent, "hdMakeCurrentDevice");
    library.find(disableDevice, "hdDisableDevice");
    library.find(beginFrame, "hdBeginFrame");
    library.find(endFrame, "hdEndFrame");
    library.find(enable, "hdEnable");
    library.find(isEnabled, "hdIsEnabled");
    library.find(getIntegerv, "hdGetIntegerv");
    library.find(getDoublev, "hdGetDoublev");
    library.find(setDoublev, "hdSetDoublev");
    library.find(getString, "hdGetString");
    library.find(getError, "hdGetError");
    library.find(getErrorString, "hdGetErrorString");
    library.find(checkCalibration, "hdCheckCalibration");
    library.find(updateCalibration, "hdUpdateCalibration");
    library.find(scheduleAsynchronous, "hdScheduleAsynchronous");
    library.find(unschedule, "hdUnschedule");
    library.find(startScheduler, "hdStartScheduler");
    library.find(stopScheduler, "hdStopScheduler");
  }

  DynamicLibrary library;
  unsigned (*initDevice)(const char*) = nullptr;
  void (*makeCurrent)(unsigned) = nullptr;
  void (*disableDevice)(unsigned) = nullptr;
  void (*beginFrame)(unsigned) = nullptr;
  void (*endFrame)(unsigned) = nullptr;
  void (*enable)(unsigned) = nullptr;
  unsigned char (*isEnabled)(unsigned) = nullptr;
  void (*getIntegerv)(unsigned, int*) = nullptr;
  void (*getDoublev)(unsigned, double*) = nullptr;
  void (*setDoublev)(unsigned, const double*) = nullptr;
  const char* (*getString)(unsigned) = nullptr;
  ErrorInfo (*getError)() = nullptr;
  const char* (*getErrorString)(unsigned) = nullptr;
  unsigned (*checkCalibration)() = nullptr;
  void (*updateCalibration)(unsigned) = nullptr;
  unsigned long (*scheduleAsynchronous)(Callback, void*, unsigned short) = nullptr;
  void (*unschedule)(unsigned long) = nullptr;
  void (*startScheduler)() = nullptr;
  void (*stopScheduler)() = nullptr;
};

// The library's x right, y up, z towards the person.
Vec3 fromOpenHaptics(const Vec3& v) { return {v.x(), -v.z(), v.y()}; }
Vec3 toOpenHaptics(const Vec3& v) { return {v.x(), v.z(), -v.y()}; }

constexpr unsigned short kPriority = 65535;
constexpr auto kSilence = std::chrono::milliseconds(500);  // without a call: the library calls no more
constexpr int kLastTicks = 20;                             // of zero force

class OpenHapticsDriver final : public DeviceDriver {
 public:
  OpenHapticsDriver(const DeviceOptions& options, OpenFor purpose) : lib_(names(options)) {
    const std::string name = options.text("name", "Default Device");
    device_ = lib_.initDevice(name.c_str());
    ErrorInfo error = lib_.getError();
    if (device_ == kInvalid && name == "Default Device") {  // as older configurations call it
      device_ = lib_.initDevice("Default PHANToM");
      const ErrorInfo other = lib_.getError();
      if (device_ != kInvalid) error = other;
    }
    if (device_ == kInvalid || error.code != 0) {
      if (device_ != kInvalid) lib_.disableDevice(device_);
      throw RunError(fmt::format("touch: no device \"{}\": {}", name, errorText(error)));
    }
    try {
      describe();
      if (purpose == OpenFor::running) prepare();
    } catch (...) {
      lib_.disableDevice(device_);
      throw;
    }
  }
  ~OpenHapticsDriver() override { lib_.disableDevice(device_); }

  const DriverInfo& info() const noexcept override { return info_; }
  bool keepsTime() const noexcept override { return true; }

  void run(const std::function<bool()>& tick) override {
    tick_ = &tick;
    done_.store(false);
    calls_.store(0);
    last_ticks_ = kLastTicks;
    ending_ = false;
    const unsigned long handle = lib_.scheduleAsynchronous(&OpenHapticsDriver::servo, this, kPriority);
    lib_.startScheduler();
    const ErrorInfo error = lib_.getError();
    if (error.code != 0) trouble_.store(errorReason(error.code));
    std::uint64_t seen = 0;
    auto heard = std::chrono::steady_clock::now();
    while (!done_.load(std::memory_order_acquire)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      const std::uint64_t calls = calls_.load(std::memory_order_relaxed);
      const auto now = std::chrono::steady_clock::now();
      if (calls != seen) heard = now;
      seen = calls;
      if (now - heard > kSilence) break;
    }
    lib_.stopScheduler();  // after which no call is under way
    lib_.unschedule(handle);
    if (done_.load(std::memory_order_acquire)) return;
    trouble_.store("OpenHaptics calls no more");
    failed_.store(true);
  }

  bool read(DriverSample& sample) noexcept override {
    if (!in_frame_) return false;
    const char* trouble = trouble_.load(std::memory_order_relaxed);
    std::array<double, 3> position{}, velocity{}, spin{};
    std::array<double, 16> transform{};
    int buttons = 0;
    lib_.getDoublev(kPosition, position.data());
    lib_.getDoublev(kVelocity, velocity.data());
    lib_.getDoublev(kTransform, transform.data());
    if (info_.has_spin) lib_.getDoublev(kAngularVelocity, spin.data());
    lib_.getIntegerv(kButtons, &buttons);
    Mat3 turn, axes;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) turn(row, column) = transform[4 * column + row];
    }
    axes << 1, 0, 0, 0, 0, -1, 0, 1, 0;
    sample.pose.position = 1e-3 * fromOpenHaptics(Vec3(position[0], position[1], position[2]));
    sample.pose.rotation = Quat(Mat3(axes * turn * axes.transpose()));
    sample.twist << 1e-3 * fromOpenHaptics(Vec3(velocity[0], velocity[1], velocity[2])),
        fromOpenHaptics(Vec3(spin[0], spin[1], spin[2]));
    sample.buttons = static_cast<std::uint32_t>(buttons);
    return trouble == nullptr;
  }

  void write(const Vec6& wrench) noexcept override { force_ = toOpenHaptics(wrench.head<3>()); }
  void release() noexcept override { force_.setZero(); }
  const char* trouble() const noexcept override { return trouble_.load(std::memory_order_relaxed); }
  bool failed() const noexcept override { return failed_.load(std::memory_order_relaxed); }
  std::vector<std::string> notes() const override {
    std::vector<std::string> out;
    for (std::size_t k = 0; k < kSurvivable.size(); ++k) {
      if (survived_[k] > 0) out.push_back(fmt::format("{} ({} times)", kSurvivable[k], survived_[k]));
    }
    return out;
  }

 private:
  static constexpr std::array<const char*, 5> kSurvivable{"motors too warm", "force above the device's",
                                                          "impulse above the device's", "too fast for the device",
                                                          "force refused"};

  static std::vector<std::string> names(const DeviceOptions& options) {
    if (options.has("library")) return {options.text("library", "")};
    return {"libHD.so"};
  }

  static const char* errorReason(unsigned code) {
    switch (code) {
      case 0x300:
        return "the device has a fault";
      case 0x301:
        return "the device is in use by another program";
      case 0x302:
        return "no communication with the device: is it unplugged?";
      case 0x303:
        return "the device is not configured: run the vendor's setup program";
      case 0x304:
        return "OpenHaptics has no timer";
      case 0x501:
        return "OpenHaptics' scheduler is full";
      case 0x600:
        return "OpenHaptics has no license";
      default:
        return "OpenHaptics reports an error";
    }
  }
  std::string errorText(const ErrorInfo& error) const {
    const char* text = lib_.getErrorString(error.code);
    return fmt::format("{} ({:#x}: {})", errorReason(error.code), error.code, text ? text : "");
  }

  std::string text(unsigned name) const {
    const char* found = lib_.getString(name);
    return found ? found : "";
  }
  double number(unsigned name, double otherwise) const {
    double value = 0.0;
    lib_.getDoublev(name, &value);
    return lib_.getError().code == 0 && value > 0.0 && std::isfinite(value) ? value : otherwise;
  }

  void describe() {
    lib_.makeCurrent(device_);
    lib_.beginFrame(device_);
    info_.name = text(kModel);
    if (info_.name.empty()) info_.name = "OpenHaptics device";
    info_.serial = text(kSerial);
    if (const std::string vendor = text(kVendor); !vendor.empty()) info_.facts.emplace_back("vendor", vendor);
    DeviceLimits& l = info_.limits;
    l.peak_force = number(kMaxForce, 3.3);
    l.continuous_force = std::min(l.peak_force, number(kMaxContinuousForce, 0.88));
    l.stiffness = 1e3 * number(kMaxStiffness, 0.4);  // from N/mm
    l.damping = 1e3 * number(kMaxDamping, 0.003);    // from N s/mm
    if (l.damping > 10.0) l.damping = 4.0;           // told in another unit
    l.peak_torque = 0.0;
    std::array<double, 6> usable{};
    lib_.getDoublev(kUsable, usable.data());
    double radius = 0.07;
    if (lib_.getError().code == 0 && usable[3] > usable[0]) {
      double smallest = 1e9;
      for (std::size_t k = 0; k < 3; ++k) smallest = std::min(smallest, usable[k + 3] - usable[k]);
      radius = std::clamp(0.5e-3 * smallest, 0.02, 0.5);
    }
    l.workspace_radius = std::max(radius, 0.075);
    int rate = 0;
    lib_.getIntegerv(kUpdateRate, &rate);
    lib_.getIntegerv(kCalibrationStyles, &styles_);
    lib_.getError();
    info_.rate = rate > 0 ? rate : 1000;
    info_.has_spin = true;
    lib_.endFrame(device_);
    while (lib_.getError().code != 0) {
    }
    info_.facts.emplace_back("rate", fmt::format("{:g} Hz", info_.rate));
    const unsigned calibration = lib_.checkCalibration();
    if (calibration == kCalibrated) return;
    trouble_.store(calibration == kNeedsUpdate
                       ? "it needs its calibration updated: put the stylus into the inkwell"
                       : "it needs to be calibrated by hand with the vendor's program: its positions do not change");
  }

  // What the device does by itself, or has only to be told that the stylus is in the inkwell.
  void calibrate() {
    const unsigned style = static_cast<unsigned>(styles_) & (kAutomatic | kInkwell);
    if (trouble() == nullptr || style == 0 || lib_.checkCalibration() != kNeedsUpdate) return;
    for (int k = 0; k < 10 && lib_.checkCalibration() != kCalibrated; ++k) {
      lib_.updateCalibration((style & kAutomatic) != 0 ? kAutomatic : kInkwell);
      while (lib_.getError().code != 0) {
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    if (lib_.checkCalibration() != kCalibrated) return;
    trouble_.store(nullptr);
    info_.facts.emplace_back("calibration", "updated at the start");
  }

  void prepare() {
    calibrate();
    if (trouble() != nullptr) throw RunError(fmt::format("touch: {}: {}", info_.name, trouble()));
    lib_.enable(kForceOutput);
    lib_.enable(kMaxForceClamping);
    const ErrorInfo error = lib_.getError();
    if (error.code != 0) throw RunError("touch: no force: " + errorText(error));
  }

  // On the library's servo thread. The force is set in each frame: whether the last one stays is not known.
  static unsigned servo(void* self) noexcept { return static_cast<OpenHapticsDriver*>(self)->frame() ? 1u : 0u; }

  bool frame() noexcept {
    calls_.fetch_add(1, std::memory_order_relaxed);
    lib_.beginFrame(device_);
    in_frame_ = true;
    if (!ending_) ending_ = !(*tick_)();
    if (ending_) force_.setZero();
    if (!force_.allFinite()) force_.setZero();
    const std::array<double, 3> force{force_.x(), force_.y(), force_.z()};
    lib_.setDoublev(kForce, force.data());
    in_frame_ = false;
    lib_.endFrame(device_);
    check();
    if (ending_ && --last_ticks_ <= 0) {
      done_.store(true, std::memory_order_release);
      return false;
    }
    return true;
  }

  void check() noexcept {
    const char* found = nullptr;
    for (int k = 0; k < 16; ++k) {  // a stack
      const unsigned code = lib_.getError().code;
      if (code == 0) break;
      if (code >= 0x200 && code <= 0x204) {
        ++survived_[code - 0x200];
      } else {
        found = errorReason(code);
      }
    }
    trouble_.store(found, std::memory_order_relaxed);
  }

  Library lib_;
  DriverInfo info_;
  unsigned device_ = kInvalid;
  int styles_ = 0;
  const std::function<bool()>* tick_ = nullptr;
  bool in_frame_ = false, ending_ = false;
  int last_ticks_ = 0;
  Vec3 force_ = Vec3::Zero();
  std::array<int, 5> survived_{};
  std::atomic<bool> done_{false}, failed_{false};
  std::atomic<std::uint64_t> calls_{0};
  std::atomic<const char*> trouble_{nullptr};
};

}  // namespace

const std::vector<DeviceOption>& openHapticsOptions() {
  static const std::vector<DeviceOption> options{{"name", "of the device in the vendor's setup; Default Device"},
                                                 {"library", "file of libHD; where the system finds it"}};
  return options;
}

std::shared_ptr<DeviceDriver> openOpenHaptics(const DeviceOptions& options, OpenFor purpose) {
  try {
    return std::make_shared<OpenHapticsDriver>(options, purpose);
  } catch (const RunError& e) {
    const std::string text = e.what();
    throw RunError(text.starts_with("touch: ") ? text : "touch: no library: " + text);
  }
}

}  // namespace palpate
