// The haptic loop by itself, for other simulators and devices.

#include <fmt/format.h>

#include "owners.h"
#include "palpate/haptics/haptic_loop.h"
#include "palpate/scene/method.h"

namespace palpate::python {
namespace {

/// A haptic loop that counts its ticks, so that who calls it need not.
struct LoopOwner {
  explicit LoopOwner(const HapticSettings& settings) : loop(settings) {}

  Vec6 start(const Pose& device, const Pose& proxy, double now) {
    begin = now;
    ticks = 0;
    started = true;
    return loop.start(device, proxy, now);
  }
  double nextTime() const { return begin + static_cast<double>(ticks) * loop.settings().dt; }

  HapticLoop loop;
  double begin = 0;
  std::int64_t ticks = 0;
  bool started = false;
};

/// All that a loop depends on between two ticks.
struct LoopState {
  HapticLoopState loop;
  double begin;
  std::int64_t ticks;
  bool started;
};

Rendering renderingOf(const std::string& method) {
  if (method == "hsl" || method == "hsl-exact") return Rendering::linearized;
  if (method == "vc") return Rendering::virtual_coupling;
  if (method == "live") throw py::value_error("method: live needs a scene's visual loop: see Run");
  throw py::value_error("method: \"" + method + "\" is not one of hsl, hsl-exact, vc");
}

std::unique_ptr<LoopOwner> makeLoop(const std::string& method, double dt, const LinkParameters& link, double mass,
                                    py::handle inertia, py::handle gravity, double peak_force, double peak_torque,
                                    double model_age_limit) {
  HapticSettings settings;
  if (!(dt > 0) || !(dt <= 1)) throw py::value_error("dt: must be above 0 and at most 1 s");
  settings.dt = dt;
  settings.rendering = renderingOf(method);
  settings.link = link;
  settings.proxy.mass = mass;
  if (!inertia.is_none()) settings.proxy.inertia = mat3From(inertia, "inertia");
  if (!gravity.is_none()) settings.proxy.gravity = vec3From(gravity, "gravity");
  settings.safety.peak_force = peak_force;
  settings.safety.peak_torque = peak_torque;
  settings.safety.model_age_limit = model_age_limit;
  return std::make_unique<LoopOwner>(settings);
}

std::unique_ptr<LoopOwner> loopOf(const WorldOwner& world, py::handle method) {
  HapticSettings settings = world.built.haptic;
  if (!method.is_none()) {
    settings.rendering = renderingOf(method.cast<std::string>());
  } else if (settings.rendering == Rendering::live) {
    renderingOf("live");
  }
  return std::make_unique<LoopOwner>(settings);
}

TickRecord tick(LoopOwner& self, const HandleModel* newest, py::handle device, py::handle time) {
  const DeviceState sample = stateFrom(device, "device");
  if (!self.started) self.start(sample.pose, sample.pose, time.is_none() ? 0.0 : time.cast<double>());
  const double now = time.is_none() ? self.nextTime() : time.cast<double>();
  ++self.ticks;
  return self.loop.tick(sample, newest, now);
}

py::list namesOf(TickFlags flags) {
  py::list out;
  for (std::size_t k = 0; k < kTickFlagCount; ++k) {
    if (flags.has(static_cast<TickFlag>(k))) out.append(toString(static_cast<TickFlag>(k)));
  }
  return out;
}

py::dict countsOf(const TickCounters& counters) {
  py::dict out;
  for (std::size_t k = 0; k < kTickFlagCount; ++k) {
    out[toString(static_cast<TickFlag>(k))] = counters[static_cast<TickFlag>(k)];
  }
  return out;
}

py::cpp_function wrenchOf(Vec6 TickRecord::*member) {
  return [member](const py::object& self) {
    return eigenView(self.cast<const TickRecord&>().*member, self, Access::read);
  };
}

void bindRecord(py::module_& module) {
  py::class_<TickRecord>(module, "TickRecord", "Everything about one tick; values after it. Arrays are views.")
      .def_readonly("time", &TickRecord::time, "[s]")
      .def_readonly("device", &TickRecord::device, "Sample that was used.")
      .def_readonly("proxy", &TickRecord::proxy, "Pose of the proxy; with vc that of the visual handle.")
      .def_property_readonly("proxy_twist", wrenchOf(&TickRecord::proxy_twist), "(6,) [m/s, rad/s].")
      .def_property_readonly("raw", wrenchOf(&TickRecord::raw),
                             "Wrench of the link on the device, before safety (6,) [N, N m].")
      .def_property_readonly("sent", wrenchOf(&TickRecord::sent), "Wrench that goes to the device (6,) [N, N m].")
      .def_readonly("model_age", &TickRecord::model_age, "[s]; infinite before the first model.")
      .def_readonly("delivered_energy", &TickRecord::delivered_energy, "Net energy given to the hand so far [J].")
      .def_property_readonly(
          "flags", [](const TickRecord& self) { return self.flags.bits(); }, "Bits, as in haptic.csv.")
      .def_property_readonly(
          "flag_names", [](const TickRecord& self) { return namesOf(self.flags); }, "What was out of the ordinary.")
      .def("__repr__", [](const TickRecord& self) {
        return fmt::format("<TickRecord at {:.6g} s: {:.3g} N sent>", self.time, self.sent.head<3>().norm());
      });
}

}  // namespace

void bindHaptics(py::module_& module) {
  bindRecord(module);
  const HapticSettings defaults;
  py::class_<LoopState>(module, "HapticState", "What HapticLoop.save() took.");
  py::class_<LoopOwner>(module, "HapticLoop",
                        "The haptic loop without its clock: proxy, link, safety. For your own simulator or device.")
      .def(py::init(&makeLoop), py::kw_only(), py::arg("method") = "hsl", py::arg("dt") = defaults.dt,
           py::arg("link") = LinkParameters{}, py::arg("mass") = defaults.proxy.mass, py::arg("inertia") = py::none(),
           py::arg("gravity") = py::none(), py::arg("peak_force") = defaults.safety.peak_force,
           py::arg("peak_torque") = defaults.safety.peak_torque,
           py::arg("model_age_limit") = defaults.safety.model_age_limit,
           "method: hsl, hsl-exact (the same loop) or vc. dt: tick [s]. mass [kg], inertia (3, 3) [kg m^2]: of handle "
           "and attached nodes. gravity (3,) [m/s^2], default (0, 0, -9.81). model_age_limit: watchdog [s].")
      .def_static("of", &loopOf, py::arg("world"), py::arg("method") = py::none(),
                  "With the settings of the world's scene, and its method unless one is given.")
      .def(
          "start",
          [](LoopOwner& self, const Pose& device, const Pose* proxy, double time) {
            return copied(self.start(device, proxy == nullptr ? device : *proxy, time));
          },
          py::arg("device_pose"), py::arg("proxy_pose") = py::none(), py::arg("time") = 0.0,
          "Begins at rest, by default with the proxy where the device is; returns the wrench that is sent at first.")
      .def("tick", &tick, py::arg("model"), py::arg("device"), py::arg("time") = py::none(),
           "One tick: from the newest handle model (None: there is none yet) and what the device says (Pose or "
           "DeviceState) to the wrench on the device. time [s]: default one tick after the last. The first tick starts "
           "the loop where the device is, unless start() did.")
      .def(
          "leave", [](LoopOwner& self) { self.loop.leave(); }, "From the next tick on the force leaves.")
      .def_property_readonly(
          "dt", [](const LoopOwner& self) { return self.loop.settings().dt; }, "[s]")
      .def_property_readonly(
          "link", [](const LoopOwner& self) { return self.loop.settings().link; }, "A copy.")
      .def_property_readonly(
          "counters", [](const LoopOwner& self) { return countsOf(self.loop.counters()); },
          "Ticks in which each flag was raised, by name.")
      .def(
          "save",
          [](const LoopOwner& self) {
            return LoopState{self.loop.state(), self.begin, self.ticks, self.started};
          },
          "Restored, the loop goes on to the bit.")
      .def(
          "restore",
          [](LoopOwner& self, const LoopState& state) {
            self.loop.restore(state.loop);
            self.begin = state.begin;
            self.ticks = state.ticks;
            self.started = state.started;
          },
          py::arg("state"), "Of a loop with the same settings.");
}

}  // namespace palpate::python
