// Force Dimension's SDK with an omega behind it, as its public documentation describes it; written from that and not
// from Palpate's driver. Faults (fake_log.h): none-connected, in-use, no-power, uninitialized; and after a time:
// button, velocity, software, usb, deadman (force off by each cause), unplug, position (errors of the position for
// good), late (a call that takes 80 ms). A force goes off by a fault once it is on. The firmware's watchdog is real:
// without a force for its time the force goes off, cause 3, and that is written down, as a busy machine does it too.
#include <chrono>
#include <thread>

#include "fake_hand.h"
#include "fake_log.h"

namespace {

using Clock = std::chrono::steady_clock;

fake::Log& log() {
  static fake::Log* it = new fake::Log("dhd");
  return *it;
}

struct Device {
  fake::Hand hand;
  bool opened = false, closed = false, initialized = false, force_on = false, expert = false, first = false;
  double force[3] = {0, 0, 0};
  double watchdog = 0;  // [s]; 0: off
  int cause = 0, error = 0;
  bool late_done = false;
  std::set<std::string> done;
  double max_force = 1e9;
  Clock::time_point last = Clock::now(), commanded = Clock::now(), begun;

  double since() const { return first ? std::chrono::duration<double>(Clock::now() - begun).count() : -1.0; }
  bool gone() const { return log().on("unplug", since()); }

  void off(int why) {
    force_on = false;
    cause = why;
    force[0] = force[1] = force[2] = 0;
  }
  void once(const char* fault, int why) {
    if (force_on && !done.count(fault) && log().on(fault, since())) {
      done.insert(fault);
      off(why);
    }
  }
  void advance() {
    const auto now = Clock::now();
    const double quiet = std::chrono::duration<double>(now - commanded).count();
    if (force_on && watchdog > 0 && quiet > watchdog) {
      off(3);
      log().starved();
    }
    once("button", 1);
    once("velocity", 2);
    once("software", 4);
    once("usb", 5);
    once("deadman", 6);
    hand.advance(force, std::chrono::duration<double>(now - last).count());
    last = now;
  }
  int check(const char* what, bool needs_power = true) {
    if (!opened || closed) {
      log().violation(std::string(what) + " on a device that is not open");
      return fail(5);
    }
    if (gone() || (needs_power && log().has("no-power"))) return fail(2);
    return 0;
  }
  int fail(int code) {
    error = code;
    return -1;
  }
};

Device& device() {
  static Device* it = new Device;
  return *it;
}

const char* kErrors[] = {"no error",        "undefined error",     "communication error", "internal error",
                         "no driver found", "no device found",     "wrong device",        "timeout",
                         "geometry",        "expert mode disabled"};

void named(char id) {
  if (id != -1 && id != 0) log().violation("an id that was never given");
}

}  // namespace

extern "C" {

int dhdGetDeviceCount() { return log().has("none-connected") ? 0 : 1; }
int dhdGetAvailableCount() { return log().has("none-connected") || log().has("in-use") ? 0 : 1; }
int dhdErrorGetLast() { return device().error; }
const char* dhdErrorGetLastStr() { return device().error < 10 ? kErrors[device().error] : "error"; }

int dhdOpenID(char id) {
  named(id);
  if (device().opened && !device().closed) log().violation("opened twice");
  if (log().has("none-connected")) return device().fail(5);
  device().opened = true;
  device().closed = false;
  log().called("open");
  return 0;
}
int drdOpenID(char id) { return dhdOpenID(id); }

int dhdClose(char id) {
  named(id);
  if (device().check("close", false) < 0 && !device().gone()) return -1;
  if (!device().gone() && device().force_on &&
      (device().force[0] != 0 || device().force[1] != 0 || device().force[2] != 0)) {
    log().violation("closed with a force on it");
  }
  device().closed = true;
  log().called("close");
  log().finish();
  return 0;
}
int drdClose(char id) { return dhdClose(id); }

const char* dhdGetSystemName(char) { return device().check("name", false) < 0 ? nullptr : "omega.3"; }
int dhdGetSerialNumber(unsigned short* serial, char) {
  *serial = 4711;
  return device().check("serial", false);
}
int dhdGetSDKVersion(int* major, int* minor, int* release, int* revision) {
  *major = 3, *minor = 17, *release = 0, *revision = 1;
  return 0;
}
bool dhdHasWrist(char) { return false; }
bool dhdHasActiveWrist(char) { return false; }
bool dhdHasGripper(char) { return false; }
bool dhdIsLeftHanded(char) { return false; }

bool drdIsInitialized(char) { return device().initialized || !log().has("uninitialized"); }
int drdAutoInit(char) {
  if (device().check("drdAutoInit") < 0) return -1;
  log().called("auto-init");
  device().initialized = true;
  return 0;
}
int drdStop(bool, char) { return device().check("drdStop"); }

int dhdEnableForce(unsigned char on, char) {
  if (device().check("dhdEnableForce") < 0) return -1;
  if (on && !drdIsInitialized(-1)) log().violation("force switched on before the device was initialized");
  if (on && device().watchdog <= 0) log().violation("force switched on without the watchdog");
  device().force_on = on != 0;
  device().cause = 0;
  device().commanded = Clock::now();
  log().called(on ? "force-on" : "force-off");
  return 0;
}
int dhdSetGravityCompensation(int, char) { return device().check("gravity"); }
int dhdSetBrakes(int, char) { return device().check("brakes"); }
int dhdSetMaxForce(double limit, char) {
  device().max_force = limit;
  return device().check("dhdSetMaxForce");
}
int dhdSetMaxTorque(double, char) { return device().check("dhdSetMaxTorque"); }
double dhdGetMaxForce(char) { return -1.0; }  // no limit set
int dhdEnableExpertMode() {
  device().expert = true;
  return 0;
}
int dhdSetWatchdog(unsigned char ticks, char) {
  if (device().check("dhdSetWatchdog") < 0) return -1;
  if (!device().expert) {
    log().violation("watchdog without expert mode");
    return device().fail(9);
  }
  device().watchdog = 125e-6 * ticks;
  log().called("watchdog");
  return 0;
}
int dhdSetVelocityThreshold(unsigned value, char) {
  if (!device().expert) {
    log().violation("velocity threshold without expert mode");
    return device().fail(9);
  }
  if (value == 0) log().violation("velocity threshold switched off");
  log().called("velocity-threshold");
  return device().check("dhdSetVelocityThreshold");
}
int dhdSetTimeGuard(int, char) {
  if (!device().expert) {
    log().violation("time guard without expert mode");
    return device().fail(9);
  }
  return device().check("dhdSetTimeGuard");
}
void dhdEnableSimulator(bool) { log().called("simulator"); }
int dhdConfigLinearVelocity(int, int, char) { return device().check("dhdConfigLinearVelocity"); }

// x towards the person, y right, z up; the hand goes down along z.
int dhdGetPositionAndOrientationFrame(double* x, double* y, double* z, double frame[3][3], char) {
  Device& d = device();
  if (d.check("position") < 0) return -1;
  if (log().on("late", d.since()) && !d.late_done) {
    d.late_done = true;
    std::this_thread::sleep_for(std::chrono::milliseconds(80));
  }
  if (log().on("position", d.since())) return d.fail(2);
  const auto asked = Clock::now();
  const bool again = asked - d.last < std::chrono::microseconds(20);
  d.advance();
  *x = d.hand.x[0], *y = d.hand.x[1], *z = d.hand.x[2];
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) frame[i][k] = i == k ? 1 : 0;
  }
  return again ? 1 : 0;  // DHD_TIMEGUARD is no error
}
int dhdGetPosition(double* x, double* y, double* z, char id) {
  double frame[3][3];
  return dhdGetPositionAndOrientationFrame(x, y, z, frame, id);
}
int dhdGetLinearVelocity(double* x, double* y, double* z, char) {
  if (device().check("velocity") < 0) return -1;
  *x = device().hand.v[0], *y = device().hand.v[1], *z = device().hand.v[2];
  return 0;
}
int dhdGetAngularVelocityRad(double* x, double* y, double* z, char) {
  *x = *y = *z = 0;
  return device().check("angular velocity");
}
unsigned dhdGetButtonMask(char) { return 0; }
double dhdGetComFreq(char) { return 4.0; }

int dhdSetForceAndTorqueAndGripperForce(double fx, double fy, double fz, double tx, double ty, double tz, double,
                                        char) {
  Device& d = device();
  if (d.check("force") < 0) {
    log().force(fx, fy, fz, false);
    return -1;
  }
  if (!(std::isfinite(fx) && std::isfinite(fy) && std::isfinite(fz))) {
    log().violation("a force that is no number");
    return d.fail(1);
  }
  if (tx != 0 || ty != 0 || tz != 0) log().violation("a torque for a device without");
  const double norm = std::sqrt(fx * fx + fy * fy + fz * fz);
  if (norm > 0 && !d.force_on && d.cause == 0) log().violation("a force before it was switched on");
  if (norm > d.max_force * 1.0001) log().violation("a force above the limit that was set");
  d.advance();
  d.commanded = Clock::now();
  log().force(fx, fy, fz, d.force_on);
  if (norm > 0.2 && !d.first) {
    d.first = true;
    d.begun = Clock::now();
  }
  if (d.force_on) d.force[0] = fx, d.force[1] = fy, d.force[2] = fz;
  return norm > 11 ? 2 : 0;  // DHD_MOTOR_SATURATED is no error
}

int dhdGetStatus(int status[17], char) {
  Device& d = device();
  if (!d.opened || d.closed) log().violation("status of a device that is not open");
  if (d.gone()) return d.fail(2);
  for (int i = 0; i < 17; ++i) status[i] = 0;
  status[0] = log().has("no-power") ? 0 : 1;
  status[1] = status[2] = 1;
  status[5] = d.force_on;
  status[14] = d.cause;
  return 0;
}

}  // extern "C"

namespace {
// What is still open when the program ends must show.
struct AtExit {
  ~AtExit() { log().finish(); }
} at_exit;
}  // namespace
