#include <fmt/format.h>
#include <pwd.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <regex>
#include <thread>

#include "command_line.h"
#include "commands.h"
#include "palpate/common/error.h"
#include "palpate/devices/driver_list.h"
#include "palpate/devices/hardware_device.h"
#include "palpate/devices/simulated_device.h"
#include "palpate/haptics/realtime.h"
#include "palpate/scene/hardware.h"
#include "palpate/scene/overrides.h"

namespace palpate {
namespace {

struct DevicesOptions {
  std::vector<std::string> devices;
  std::string test;
  std::string report;
  bool help_options = false;
};

/// A kind of device with options, and what came of looking for it.
struct Look {
  DeviceConfig config;
  const DriverKind* kind = nullptr;
  std::shared_ptr<DeviceDriver> driver;
  std::string reason;  // why there is none
};

DeviceConfig deviceOf(const std::string& text) {
  SceneConfig scene;
  Overrides overrides;
  overrides.device = text;
  scene.tool.handles.resize(1);
  applyOverrides(scene, overrides);
  if (!isHardware(scene.device.kind)) throw InputError("--device", "", text + " is no device on a desk");
  return scene.device;
}

Look look(const std::string& text, OpenFor purpose) {
  Look out;
  out.config = deviceOf(text);
  for (const DriverKind& kind : driverKinds()) {
    if (kind.name == std::string(toString(out.config.kind))) out.kind = &kind;
  }
  try {
    out.driver = out.kind->open(out.config.options, purpose);
  } catch (const RunError& e) {
    out.reason = e.what();
    const std::string prefix = out.kind->name + std::string(": ");
    if (out.reason.starts_with(prefix)) out.reason.erase(0, prefix.size());
  }
  return out;
}

std::string limitsText(const DriverInfo& info) {
  const DeviceLimits& l = info.limits;
  if (!info.has_force) return "no force";
  return fmt::format("{:.3g} N, {:.3g} N for long, {}, {:.3g} N/m, {:.3g} N s/m, {}", l.peak_force, l.continuous_force,
                     l.peak_torque > 0 ? fmt::format("{:.3g} N m", l.peak_torque) : "no torque", l.stiffness, l.damping,
                     info.bounded ? fmt::format("radius {:.3g} m", l.workspace_radius) : "no bounds");
}

void print(const Look& found) {
  if (!found.driver) {
    fmt::print("{:<16} not there: {}\n", found.kind->name, found.reason);
    return;
  }
  const DriverInfo& info = found.driver->info();
  const char* trouble = found.driver->trouble();
  fmt::print("{:<16} {}{}: {}; {}\n", found.kind->name, info.name, info.serial.empty() ? "" : " " + info.serial,
             limitsText(info), trouble ? trouble : "ready");
  for (const auto& [key, value] : info.facts) fmt::print("{:<16}   {}: {}\n", "", key, value);
  for (const std::string& note : found.driver->notes()) fmt::print("{:<16}   note: {}\n", "", note);
}

std::string hostName() {
  utsname about{};
  return uname(&about) == 0 ? about.nodename : "";
}

// Names of people, machines and folders, and serial numbers: also those that only the reason names.
std::string withoutPrivate(std::string text, const Look& found) {
  static const std::regex path(R"((^|[\s"'(=])/[^\s"':;,)]+)"), serial(R"(\b(?=[0-9A-F]*\d)[0-9A-F]{4,}\b)");
  text = std::regex_replace(text, path, "$1...");
  if (found.config.kind == DeviceName::inverse3 && !found.driver) text = std::regex_replace(text, serial, "...");
  std::vector<std::string> secret{found.config.options.text("host", ""), found.config.options.text("id", ""),
                                  found.config.options.text("library", ""), found.config.options.text("socket", "")};
  if (found.driver) secret.push_back(found.driver->info().serial);
  if (const char* home = std::getenv("HOME")) secret.emplace_back(home);
  if (const char* user = std::getenv("USER")) secret.emplace_back(user);
  if (const passwd* user = getpwuid(getuid())) secret.emplace_back(user->pw_name);
  secret.push_back(hostName());
  std::sort(secret.begin(), secret.end(), [](const auto& a, const auto& b) { return a.size() > b.size(); });
  for (const std::string& word : secret) {
    if (word.size() < 2 || word == "localhost" || word == "root") continue;
    for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 3)) {
      text.replace(at, word.size(), "...");
    }
  }
  return text;
}

nlohmann::ordered_json reportOf(const Look& found) {
  nlohmann::ordered_json j;
  const auto clean = [&](const std::string& text) { return withoutPrivate(text, found); };
  j["kind"] = found.kind->name;
  for (const auto& [key, value] : found.config.options.values()) {
    const bool hidden = key == "host" || key == "id" || key == "library" || key == "socket";
    j["options"][key] = hidden ? "..." : clean(value);
  }
  if (!found.driver) {
    j["not_there"] = clean(found.reason);
    return j;
  }
  const DriverInfo& info = found.driver->info();
  j["name"] = clean(info.name);
  j["state"] = found.driver->trouble() ? found.driver->trouble() : "ready";
  const DeviceLimits& l = info.limits;
  j["limits"] = {{"peak_force_N", l.peak_force},
                 {"continuous_force_N", l.continuous_force},
                 {"peak_torque_Nm", l.peak_torque},
                 {"stiffness_N_m", l.stiffness},
                 {"damping_Ns_m", l.damping},
                 {"workspace_radius_m", l.workspace_radius},
                 {"rate_Hz", info.rate}};
  for (const auto& [key, value] : info.facts) j["says"][key] = clean(value);
  for (const std::string& note : found.driver->notes()) j["notes"].push_back(clean(note));
  return j;
}

/// What two seconds of reading showed.
struct TestResult {
  std::int64_t ticks = 0, good = 0;
  Vec3 low = Vec3::Constant(1e9), high = Vec3::Constant(-1e9);
  double fastest = 0;
  std::uint32_t buttons = 0;
  DurationHistogram work;
};

TestResult test(DeviceDriver& driver) {
  constexpr std::int64_t kTicks = 2000;
  TestResult out;
  const auto once = [&] {
    const auto begin = PeriodicClock::Clock::now();
    DriverSample sample;
    if (driver.read(sample) && sample.pose.allFinite()) {
      ++out.good;
      out.low = out.low.cwiseMin(sample.pose.position);
      out.high = out.high.cwiseMax(sample.pose.position);
      out.fastest = std::max(out.fastest, sample.twist.head<3>().norm());
      out.buttons |= sample.buttons;
    }
    driver.write(Vec6::Zero());
    out.work.add(std::chrono::nanoseconds(PeriodicClock::Clock::now() - begin).count());
    return ++out.ticks < kTicks;
  };
  if (driver.keepsTime()) {
    driver.run(once);
  } else {
    PeriodicReport report;
    PeriodicClock clock(0.001);
    clock.start();
    do {
      clock.wait(report);
    } while (once());
  }
  driver.release();
  return out;
}

nlohmann::ordered_json testJson(const TestResult& r) {
  nlohmann::ordered_json j{
      {"ticks", r.ticks}, {"with_a_state", r.good}, {"buttons", r.buttons}, {"fastest_m_s", r.fastest}};
  if (r.good > 0) j["moved_m"] = {r.high.x() - r.low.x(), r.high.y() - r.low.y(), r.high.z() - r.low.z()};
  j["tick_us"] = {{"p50", r.work.percentile(0.5)}, {"p99", r.work.percentile(0.99)}, {"max", r.work.max()}};
  return j;
}

void print(const TestResult& r) {
  fmt::print("{} of {} ticks had a state; a tick took {:.3g} us, 99 % {:.3g} us, at most {:.3g} us\n", r.good, r.ticks,
             r.work.percentile(0.5), r.work.percentile(0.99), r.work.max());
  if (r.good == 0) return;
  const Vec3 way = r.high - r.low;
  fmt::print("moved by ({:.3g}, {:.3g}, {:.3g}) m, at most {:.3g} m/s; buttons seen: {:#x}\n", way.x(), way.y(),
             way.z(), r.fastest, r.buttons);
}

void listSimulated() {
  const SimulatedDeviceSettings s;
  fmt::print(
      "simulated        mass and damping of a Phantom Omni, moved by a hand model: {:.3g} kg, {:.2g} N peak, {:.0f} "
      "N/m\n"
      "prescribed       follows the scene's keyframes exactly, whatever it feels\n"
      "recorded         replays a motion: --device recorded:FILE (motion.csv of any run)\n"
      "mouse            the simulated one with your hand at a pointer, a touch screen or a keyboard: palpate view\n",
      s.mass, s.limits.peak_force, s.limits.stiffness);
}

void printOptions() {
  for (const DriverKind& kind : driverKinds()) {
    fmt::print("{}: {}\n", kind.name, kind.what);
    for (const DeviceOption& o : kind.options) fmt::print("  {:<16} {}\n", o.key, o.what);
  }
  fmt::print("all:\n");
  for (const DeviceOption& o : workspaceOptions()) fmt::print("  {:<16} {}\n", o.key, o.what);
}

nlohmann::ordered_json systemJson() {
  utsname about{};
  uname(&about);  // without its node name, which a report keeps to itself
  return {{"system", about.sysname}, {"release", about.release}, {"machine", about.machine}};
}

void writeReport(const std::string& file, const nlohmann::ordered_json& devices) {
  nlohmann::ordered_json j{{"palpate", PALPATE_VERSION}, {"on", systemJson()}, {"devices", devices}};
  std::ofstream out(file);
  out << j.dump(2) << '\n';
  out.close();
  if (!out) throw RunError(file + ": cannot be written");
  fmt::print("report: {}\n", file);
}

void devices(const DevicesOptions& options) {
  if (options.help_options) return printOptions();
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  std::string missing;
  const auto take = [&](const Look& found) {
    print(found);
    all.push_back(reportOf(found));
    if (!found.driver) missing = fmt::format("{}: {}", found.kind->name, found.reason);
  };
  if (!options.test.empty()) {
    const Look found = look(options.test, OpenFor::running);
    if (found.driver) {
      fmt::print("two seconds of reading, without force: move it about and press its buttons\n");
      flushOutput();
      const TestResult result = test(*found.driver);
      take(found);
      print(result);
      all.back()["test"] = testJson(result);
      if (result.good * 2 < result.ticks) missing = fmt::format("{}: it mostly gave no state", found.kind->name);
    } else {
      take(found);
    }
  } else if (!options.devices.empty()) {
    for (const std::string& name : options.devices) take(look(name, OpenFor::looking));
  } else {
    for (const DriverKind& kind : driverKinds()) take(look(kind.name, OpenFor::looking));
    listSimulated();
    missing.clear();
  }
  if (!options.report.empty()) writeReport(options.report, all);
  flushOutput();
  if (!missing.empty()) throw RunError(missing);
}

}  // namespace

void addDevicesCommand(CLI::App& app) {
  std::vector<std::string> kinds;
  for (const DriverKind& kind : driverKinds()) kinds.emplace_back(kind.name);
  const auto options = std::make_shared<DevicesOptions>();
  CLI::App* command =
      app.add_subcommand("devices", "List the devices that a scene can use: what is there, its limits, or why not");
  command->add_option("--device", options->devices, "Only this one; may be given several times")
      ->check(offers(kinds))
      ->type_name("NAME[:key=value,...]");
  command->add_option("--test", options->test, "Open one as for a run and read it for two seconds, without force")
      ->check(offers(kinds))
      ->type_name("NAME[:key=value,...]");
  command
      ->add_option("--report", options->report, "Also write what was found, without private data (JSON)")

      ->type_name("FILE");
  command->add_flag("--options", options->help_options, "What may be set of each");
  command->callback([options] { devices(*options); });
}

}  // namespace palpate
