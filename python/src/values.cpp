// Plain values: poses, what a device says, handle models, reports.

#include <fmt/format.h>

#include "owners.h"
#include "palpate/linearization/handle_model.h"
#include "palpate/math/rotation.h"
#include "palpate/rigid/link.h"
#include "palpate/simulation/step_report.h"

namespace palpate::python {
namespace {

/// Property of a vector or matrix: a view that may be written to, and what is assigned is copied into it.
template <class T, class Member>
void bindMember(py::class_<T>& bound, const char* name, Member T::*member, const char* doc) {
  bound.def_property(
      name, [member](const py::object& self) { return eigenView(self.cast<T&>().*member, self, Access::write); },
      [member, name](T& self, py::handle value) {
        if constexpr (Member::ColsAtCompileTime == 6) {
          self.*member = mat6From(value, name);
        } else {
          self.*member = vectorFrom<Member>(value, name, Member::RowsAtCompileTime);
        }
      },
      doc);
}

template <class T>
void bindPose(py::class_<T>& bound, const char* name, Pose T::*member, const char* doc) {
  bound.def_property(
      name, [member](T& self) -> Pose& { return self.*member; },
      [member](T& self, const Pose& value) { self.*member = value; }, py::return_value_policy::reference_internal, doc);
}

std::string textOf(const Pose& pose) {
  const Vec3& p = pose.position;
  const Quat& q = pose.rotation;
  return fmt::format("Pose(({:.6g}, {:.6g}, {:.6g}), ({:.6g}, {:.6g}, {:.6g}, {:.6g}))", p.x(), p.y(), p.z(), q.w(),
                     q.x(), q.y(), q.z());
}

void bindPoses(py::module_& module) {
  py::class_<Pose> pose(module, "Pose", "Position [m] and orientation of a frame in the world.");
  pose.def(py::init([](const py::object& position, const py::object& rotation) {
             Pose out;
             if (!position.is_none()) out.position = vec3From(position, "position");
             if (!rotation.is_none()) out.rotation = rotationFrom(rotation, "rotation");
             return out;
           }),
           py::arg("position") = py::none(), py::arg("rotation") = py::none(),
           "rotation: unit quaternion w, x, y, z, or a rotation matrix.");
  bindMember(pose, "position", &Pose::position, "(3,) view [m].");
  pose.def_property(
      "rotation", [](const Pose& self) { return copied(self.rotation); },
      [](Pose& self, py::handle value) { self.rotation = rotationFrom(value, "rotation"); },
      "Unit quaternion w, x, y, z: a copy.");
  pose.def_property_readonly(
      "matrix", [](const Pose& self) { return copied(self.matrix()); }, "Rotation matrix (3, 3): a copy.");
  pose.def(
      "advanced", [](const Pose& self, py::handle tangent) { return advance(self, vec6From(tangent, "tangent")); },
      py::arg("tangent"), "Advanced by a tangent (dp, dtheta) [m, rad]: p + dp, exp(dtheta) R.");
  pose.def(
      "minus", [](const Pose& self, const Pose& from) { return copied(poseDifference(self, from)); }, py::arg("other"),
      "Tangent (dp, dtheta) [m, rad] that leads from the other pose to this one.");
  pose.def("__repr__", &textOf);
  pose.def("__copy__", [](const Pose& self) { return self; });
  pose.def(
      "__deepcopy__", [](const Pose& self, py::handle) { return self; }, py::arg("memo"));
}

void bindDeviceState(py::module_& module) {
  py::class_<DeviceState> device(module, "DeviceState", "What a device says at one instant; world frame.");
  device.def(py::init([](const Pose& pose, const py::object& twist, std::uint32_t buttons) {
               DeviceState out;
               out.pose = pose;
               if (!twist.is_none()) out.twist = vec6From(twist, "twist");
               out.buttons = buttons;
               return out;
             }),
             py::arg("pose") = Pose{}, py::arg("twist") = py::none(), py::arg("buttons") = 0);
  bindPose(device, "pose", &DeviceState::pose, "Its pose.");
  bindMember(device, "twist", &DeviceState::twist, "Velocity and angular velocity (6,) [m/s, rad/s].");
  device.def_readwrite("buttons", &DeviceState::buttons, "Bit k: button k + 1 is pressed.");
}

void bindLink(py::module_& module) {
  const LinkParameters link;
  py::class_<LinkParameters>(module, "Link", "Spring and damper between handle and device.")
      .def(py::init([](double stiffness, double damping, double rotational_stiffness, double rotational_damping,
                       double peak_force, double peak_torque) {
             return LinkParameters{stiffness,          damping,    rotational_stiffness,
                                   rotational_damping, peak_force, peak_torque};
           }),
           py::arg("stiffness") = link.stiffness, py::arg("damping") = link.damping,
           py::arg("rotational_stiffness") = link.rotational_stiffness,
           py::arg("rotational_damping") = link.rotational_damping, py::arg("peak_force") = link.peak_force,
           py::arg("peak_torque") = link.peak_torque)
      .def_readwrite("stiffness", &LinkParameters::stiffness, "[N/m]")
      .def_readwrite("damping", &LinkParameters::damping, "[N s/m]")
      .def_readwrite("rotational_stiffness", &LinkParameters::rotational_stiffness, "[N m/rad]")
      .def_readwrite("rotational_damping", &LinkParameters::rotational_damping, "[N m s/rad]")
      .def_readwrite("peak_force", &LinkParameters::peak_force, "Where spring or damper saturate [N].")
      .def_readwrite("peak_torque", &LinkParameters::peak_torque, "[N m]");
}

void bindModel(py::module_& module) {
  py::class_<HandleModel> model(
      module, "HandleModel",
      "All that the haptic loop gets from the visual loop: F*(x, u) = force + kx (x - x0) + kv (u - u0), the wrench of "
      "the tool on the handle.");
  model.def(py::init<>());
  bindMember(model, "force", &HandleModel::force, "Wrench (6,) at x0, u0 [N, N m], about the handle's origin, world.");
  bindPose(model, "pose", &HandleModel::pose, "x0: handle at the start of the visual step.");
  bindMember(model, "twist", &HandleModel::twist, "u0 (6,) [m/s, rad/s].");
  bindMember(model, "kx", &HandleModel::kx, "dF/dx (6, 6), Fortran order [N/m, N/rad; N, N m/rad].");
  bindMember(model, "kv", &HandleModel::kv, "dF/du (6, 6), Fortran order [N s/m, ...].");
  bindPose(model, "handle_pose", &HandleModel::handle_pose, "Visual handle at the end of the step.");
  bindMember(model, "handle_twist", &HandleModel::handle_twist, "(6,) [m/s, rad/s].");
  model.def_readwrite("time", &HandleModel::time, "At which the step began [s].");
  model.def_readwrite("step", &HandleModel::step, "Length of the visual step [s].");
  model.def_readwrite("unsound", &HandleModel::unsound, "The step failed, was cut, or its contact was not solved.");
  model.def(
      "wrench",
      [](const HandleModel& self, const Pose& pose, const py::object& twist) {
        const Vec6 u = twist.is_none() ? self.twist : vec6From(twist, "twist");
        return copied(Vec6(self.force + self.kx * poseDifference(pose, self.pose) + self.kv * (u - self.twist)));
      },
      py::arg("pose"), py::arg("twist") = py::none(), "F*(x, u) (6,) [N, N m].");
  model.def("__copy__", [](const HandleModel& self) { return self; });
  model.def(
      "__deepcopy__", [](const HandleModel& self, py::handle) { return self; }, py::arg("memo"));
}

void bindReport(py::module_& module) {
  py::class_<StepTimes>(module, "StepTimes", "Wall-clock parts of a step [s].")
      .def_readonly("assemble", &StepTimes::assemble)
      .def_readonly("factorize", &StepTimes::factorize)
      .def_readonly("solve", &StepTimes::solve)
      .def_readonly("contact", &StepTimes::contact)
      .def_readonly("advance", &StepTimes::advance)
      .def_property_readonly("total", &StepTimes::total);
  py::class_<StepReport>(module, "StepReport", "What one step did.")
      .def_property_readonly(
          "status",
          [](const StepReport& self) {
            constexpr std::array<const char*, 3> kNames{"ok", "contact_not_converged", "restored"};
            return kNames[static_cast<std::size_t>(self.status)];
          },
          "ok, contact_not_converged, or restored (the step failed: last good state, at rest).")
      .def_readonly("times", &StepReport::times)
      .def_readonly("contacts_found", &StepReport::contacts_found, "Before reduction.")
      .def_readonly("contacts", &StepReport::contacts, "After reduction.")
      .def_readonly("active", &StepReport::active)
      .def_readonly("sticking", &StepReport::sticking)
      .def_readonly("sliding", &StepReport::sliding)
      .def_readonly("solver_iterations", &StepReport::solver_iterations)
      .def_readonly("solver_residual", &StepReport::solver_residual, "[m/s]")
      .def_readonly("converged", &StepReport::converged)
      .def_readonly("passes", &StepReport::passes)
      .def_readonly("penetration", &StepReport::penetration, "Deepest surface point in another solid [m].")
      .def_readonly("motion_share", &StepReport::motion_share, "Least share of a body's motion that was made.")
      .def_readonly("redone", &StepReport::redone, "Shorter steps in which it was done again.")
      .def_readonly("kinetic_energy", &StepReport::kinetic_energy, "[J]")
      .def_readonly("elastic_energy", &StepReport::elastic_energy, "[J]")
      .def_readonly("energy_made", &StepReport::energy_made, "[J]")
      .def_readonly("out_of_budget", &StepReport::out_of_budget)
      .def_property_readonly("sound", &StepReport::sound, "It went to its end, with contact as it should be.")
      .def("__repr__", [](const StepReport& self) {
        return fmt::format("<StepReport: {}, {} of {} contacts active, {:.3g} ms>", self.sound() ? "sound" : "unsound",
                           self.active, self.contacts, 1e3 * self.times.total());
      });
}

}  // namespace

void bindValues(py::module_& module) {
  bindPoses(module);
  bindDeviceState(module);
  bindLink(module);
  bindModel(module);
  bindReport(module);
}

}  // namespace palpate::python
