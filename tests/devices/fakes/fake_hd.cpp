// OpenHaptics' libHD with a Phantom Omni behind it, as its public header and documentation describe it; written from
// those and not from Palpate's driver. It has its own servo thread of 1 kHz. Faults (fake_log.h): no-device, in-use,
// license, uncalibrated (the stylus is not in the inkwell), outdated (until it is updated, which the device does by
// itself), by-hand (calibration); and after a time: unplug (communication errors, for good), warm, force,
// velocity (errors that are survivable, one in ten frames), silent (the servo calls no more), nan (a position).
#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

#include "fake_hand.h"
#include "fake_log.h"

namespace {

using Clock = std::chrono::steady_clock;
constexpr unsigned kInvalid = 0xFFFFFFFF;

fake::Log& log() {
  static fake::Log* it = new fake::Log("hd");
  return *it;
}

struct Info {
  unsigned code;
  int internal;
  unsigned device;
};

struct State {
  fake::Hand hand;
  unsigned inits = 0;
  bool updated = false, open = false, in_frame = false, output = false, set_in_frame = false;
  std::atomic<bool> running{false};
  double force[3] = {0, 0, 0};
  std::vector<unsigned> errors;
  unsigned (*callback)(void*) = nullptr;
  void* data = nullptr;
  std::thread servo;
  std::thread::id servo_id, frame_thread;
  bool first = false;
  long ticks = 0;
  Clock::time_point begun;
  std::recursive_mutex mutex;

  State() { hand.axis = 1; }  // y is up
  double since() const { return first ? std::chrono::duration<double>(Clock::now() - begun).count() : -1.0; }
};

State& state() {
  static State* it = new State;
  return *it;
}

void fail(unsigned code) {
  if (state().errors.size() < 50) state().errors.push_back(code);
}

bool inFrame(const char* what) {
  State& s = state();
  if (!s.open) log().violation(std::string(what) + " without a device");
  if (s.in_frame && s.frame_thread == std::this_thread::get_id()) return true;
  log().violation(std::string(what) + " outside a frame");
  fail(0x402);
  return false;
}

void serve() {
  State& s = state();
  s.servo_id = std::this_thread::get_id();
  auto next = Clock::now();
  while (s.running) {
    next += std::chrono::milliseconds(1);
    std::this_thread::sleep_until(next);
    if (!s.running) break;
    {
      const std::lock_guard lock(s.mutex);
      s.hand.advance(s.force, 1e-3);
      ++s.ticks;
      if (log().on("silent", s.since())) continue;
    }
    if (s.callback == nullptr) continue;
    if (s.callback(s.data) == 0) s.callback = nullptr;
    if (s.in_frame) {
      log().violation("a callback that returns within a frame");
      s.in_frame = false;
    }
  }
}

}  // namespace

extern "C" {

unsigned hdInitDevice(const char* name) {
  State& s = state();
  log().called("init");
  if (name == nullptr) log().violation("init without a name");
  if (s.open) {
    log().violation("more than one init");
    fail(0x301);
    return kInvalid;
  }
  if (log().has("no-device")) return fail(0x302), kInvalid;
  if (log().has("in-use")) return fail(0x301), kInvalid;
  if (log().has("license")) return fail(0x600), kInvalid;
  if (std::strcmp(name, log().has("old-name") ? "Default PHANToM" : "Default Device") != 0)
    return fail(0x303), kInvalid;
  s.open = true;
  ++s.inits;
  return 0;
}
void hdMakeCurrentDevice(unsigned handle) {
  if (handle != 0) log().violation("an unknown handle");
}
unsigned hdGetCurrentDevice() { return state().open ? 0 : kInvalid; }

void hdDisableDevice(unsigned handle) {
  State& s = state();
  if (handle != 0 || !s.open) log().violation("disabling what is not open");
  if (s.running) log().violation("device disabled while the scheduler runs");
  if (s.force[0] != 0 || s.force[1] != 0 || s.force[2] != 0) log().violation("device disabled with a force on it");
  s.open = false;
  log().called("disable");
  log().finish();
}

void hdBeginFrame(unsigned handle) {
  State& s = state();
  if (handle != 0 || !s.open) log().violation("a frame of no device");
  if (s.in_frame) {
    log().violation("a frame within a frame");
    fail(0x400);
  }
  if (s.running && std::this_thread::get_id() != s.servo_id) log().violation("a frame beside the servo thread");
  s.mutex.lock();
  s.in_frame = true;
  s.set_in_frame = false;
  s.frame_thread = std::this_thread::get_id();
  if (log().on("unplug", s.since())) fail(0x302);
  if (s.ticks % 10 == 0) {
    if (log().on("warm", s.since())) fail(0x200);
    if (log().on("force", s.since())) fail(0x201);
    if (log().on("velocity", s.since())) fail(0x203);
  }
}
void hdEndFrame(unsigned) {
  State& s = state();
  if (!s.in_frame) {
    log().violation("the end of no frame");
    fail(0x401);
    return;
  }
  if (s.running && std::this_thread::get_id() == s.servo_id && !s.set_in_frame)
    log().violation("a frame without a force");
  s.in_frame = false;
  s.mutex.unlock();
}

void hdEnable(unsigned what) {
  if (what != 0x4000 && what != 0x4001 && what != 0x4002 && what != 0x4003 && what != 0x4004) return fail(0x100);
  if (!state().open) log().violation("enable without a device");
  if (what == 0x4000) {
    state().output = true;
    log().called("enable-force");
  }
}
void hdDisable(unsigned what) {
  if (what == 0x4000) state().output = false;
}
unsigned char hdIsEnabled(unsigned what) { return what == 0x4000 && state().output; }

void hdGetDoublev(unsigned name, double* out) {
  State& s = state();
  if (!inFrame("a get")) return;
  const double stuck = log().has("by-hand") ? 0 : 1;
  switch (name) {
    case 0x2050:
    case 0x2250:
      for (int k = 0; k < 3; ++k) out[k] = 1e3 * stuck * s.hand.x[k];
      if (log().on("nan", s.since())) out[0] = NAN;
      return;
    case 0x2051:
      for (int k = 0; k < 3; ++k) out[k] = 1e3 * s.hand.v[k];
      return;
    case 0x2052:  // column-major: translation in 12, 13, 14
      for (int k = 0; k < 16; ++k) out[k] = k % 5 == 0 ? 1 : 0;
      for (int k = 0; k < 3; ++k) out[12 + k] = 1e3 * s.hand.x[k];
      return;
    case 0x2053:
    case 0x2100:
    case 0x2150:
      for (int k = 0; k < 3; ++k) out[k] = 0;
      return;
    case 0x2550:
    case 0x2551: {
      const double box[6] = {-80, -60, -35, 80, 60, 35};
      for (int k = 0; k < 6; ++k) out[k] = box[k];
      return;
    }
    case 0x2602:
      *out = 0.5;
      return;
    case 0x2603:
      *out = 3.3;
      return;
    case 0x2604:
      *out = 0.88;
      return;
    case 0x2605:
      for (int k = 0; k < 6; ++k) out[k] = 0.1;
      return;
    case 0x2609:
      *out = 0.005;
      return;
    default:
      fail(0x100);
  }
}
void hdGetIntegerv(unsigned name, int* out) {
  if (!inFrame("a get")) return;
  switch (name) {
    case 0x2000:
      *out = 0;
      return;
    case 0x2553:
      *out = 6;
      return;
    case 0x2554:
      *out = 3;
      return;
    case 0x2555:
      *out = log().has("outdated") ? 3 : 4;
      return;
    case 0x2600:
      *out = 1000;
      return;
    default:
      fail(0x100);
  }
}
void hdSetDoublev(unsigned name, const double* value) {
  State& s = state();
  if (!inFrame("a set")) return;
  if (name != 0x2700) return fail(0x100);
  const double norm = std::sqrt(value[0] * value[0] + value[1] * value[1] + value[2] * value[2]);
  if (!s.output && norm > 0) log().violation("a force before it was enabled");
  if (norm > 3.3001) fail(0x201);
  log().force(value[0], value[1], value[2], !log().on("unplug", s.since()));
  s.set_in_frame = true;
  if (norm > 0.2 && !s.first) {
    s.first = true;
    s.begun = Clock::now();
  }
  for (int k = 0; k < 3; ++k) s.force[k] = std::isfinite(value[k]) ? value[k] : 0;
}
void hdGetFloatv(unsigned, float*) { log().violation("floats are not played"); }
void hdGetBooleanv(unsigned, unsigned char*) { log().violation("booleans are not played"); }

const char* hdGetString(unsigned name) {
  if (!inFrame("a get")) return "";
  switch (name) {
    case 0x2501:
      return "PHANTOM Omni";
    case 0x2502:
      return "4.3.3";
    case 0x2503:
      return "SensAble Technologies, Inc.";
    case 0x2504:
      return "SN-10808001";
    default:
      fail(0x100);
      return "";
  }
}

Info hdGetError() {
  State& s = state();
  if (s.errors.empty()) return {0, 0, 0};
  const unsigned newest = s.errors.back();
  s.errors.pop_back();
  return {newest, 0, 0};
}
const char* hdGetErrorString(unsigned code) { return code == 0x302 ? "Communication Error" : "HD error"; }

unsigned hdCheckCalibration() {
  log().called("check-calibration");
  if (log().has("outdated") && !state().updated) return 0x5001;
  return log().has("uncalibrated") ? 0x5001 : log().has("by-hand") ? 0x5002 : 0x5000;
}
void hdUpdateCalibration(unsigned style) {
  State& s = state();
  if (!s.open) log().violation("a calibration without a device");
  if (s.running) log().violation("a calibration while the scheduler runs");
  if (style != (log().has("outdated") ? 2u : 4u)) return fail(0x101);
  log().called("update-calibration");
  if (style == 2) s.updated = true;
}

unsigned long hdScheduleAsynchronous(unsigned (*callback)(void*), void* data, unsigned short) {
  State& s = state();
  if (!s.open) log().violation("a callback without a device");
  if (!s.output) log().violation("a callback before the force was enabled");
  if (s.running) log().violation("a callback after the scheduler was started");
  s.callback = callback;
  s.data = data;
  log().called("schedule");
  return 77;
}
unsigned long hdScheduleSynchronous(unsigned (*callback)(void*), void* data, unsigned short) {
  while (callback(data) != 0) {
  }
  return 78;
}
void hdUnschedule(unsigned long handle) {
  if (handle != 77) log().violation("an unknown callback");
  state().callback = nullptr;
  log().called("unschedule");
}
unsigned char hdWaitForCompletion(unsigned long, unsigned) { return state().callback != nullptr; }
void hdStartScheduler() {
  State& s = state();
  if (s.running) return fail(0x304);
  s.running = true;
  log().called("start");
  s.servo = std::thread(serve);
}
void hdStopScheduler() {
  State& s = state();
  if (!s.running) return log().violation("a scheduler stopped that does not run");
  s.running = false;
  if (s.servo.joinable()) s.servo.join();
  log().called("stop");
}
void hdSetSchedulerRate(unsigned long) {}
double hdGetSchedulerTimeStamp() { return 0; }

}  // extern "C"

namespace {
struct AtExit {
  ~AtExit() { log().finish(); }
} at_exit;
}  // namespace
