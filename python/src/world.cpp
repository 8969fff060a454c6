// Scenes, worlds, bodies, contacts.

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <limits>

#include "owners.h"
#include "palpate/common/error.h"
#include "palpate/linearization/linearize.h"
#include "palpate/scene/overrides.h"
#include "palpate/scene/reader.h"
#include "palpate/scene/save.h"

namespace palpate::python {
namespace {

// --- scenes

template <class T>
void take(const py::dict& options, const char* key, std::optional<T>& target) {
  if (!options.contains(key) || options[key].is_none()) return;
  try {
    target = options[key].cast<T>();
  } catch (const py::cast_error&) {
    throw py::type_error(std::string(key) + ": is a " + (std::is_same_v<T, std::string> ? "text" : "number"));
  }
}

// By itself: a whole number that does not fit is out of range, not no number.
std::optional<std::uint64_t> seedFrom(const py::dict& options) {
  if (!options.contains("seed") || options["seed"].is_none()) return std::nullopt;
  const py::object given = options["seed"];
  try {
    return given.cast<std::uint64_t>();
  } catch (const py::cast_error&) {
    if (!PyIndex_Check(given.ptr())) throw py::type_error("seed: is a number");
    throw py::value_error(fmt::format("seed: {} is out of range; it must be 0 to {}",
                                      py::str(given).cast<std::string>(), std::numeric_limits<std::uint64_t>::max()));
  }
}

// What the program's options are, by the names of keyword arguments.
Overrides overridesFrom(const py::dict& options) {
  constexpr std::array<std::string_view, 12> kNames{"method",  "aim",    "derivative", "cone",
                                                    "handle",  "device", "duration",   "visual_dt",
                                                    "latency", "jitter", "seed",       "tetrahedra"};
  for (const auto& [key, value] : options) {
    const auto name = key.cast<std::string>();
    if (std::find(kNames.begin(), kNames.end(), name) != kNames.end()) continue;
    throw py::type_error(fmt::format("\"{}\" is no option of a scene; there are {}", name, fmt::join(kNames, ", ")));
  }
  Overrides out;
  take(options, "method", out.method);
  take(options, "aim", out.aim);
  take(options, "derivative", out.derivative);
  take(options, "cone", out.cone);
  take(options, "handle", out.handle);
  take(options, "device", out.device);
  take(options, "duration", out.duration);
  take(options, "visual_dt", out.visual_dt);
  take(options, "latency", out.latency);
  take(options, "jitter", out.jitter);
  out.seed = seedFrom(options);
  take(options, "tetrahedra", out.tetrahedra);
  return out;
}

// The options' errors name them as on the command line.
void applyOptions(SceneConfig& config, const py::dict& options) {
  try {
    applyOverrides(config, overridesFrom(options));
  } catch (const InputError& e) {
    std::string text = e.what();
    if (!text.starts_with("--")) throw;
    text.erase(0, 2);
    for (std::size_t i = 0; i < text.size() && text[i] != ':'; ++i) text[i] = text[i] == '-' ? '_' : text[i];
    throw py::value_error(text);
  }
}

SceneConfig sceneFromText(const std::string& text, const std::string& name, const std::string& folder) {
  SceneConfig config = readSceneFromString(text, name);
  config.file = std::filesystem::absolute(std::filesystem::path(folder)) / name;
  resolveFiles(config);
  return config;
}

void bindScene(py::module_& module) {
  py::class_<SceneConfig, std::shared_ptr<SceneConfig>>(
      module, "Scene", "A scene as its file states it, checked. Does not change: replaced() makes another one.")
      .def(py::init([](const py::object& file, const py::kwargs& options) {
             SceneConfig config = readScene(py::str(file).cast<std::string>());
             applyOptions(config, options);
             return std::make_shared<SceneConfig>(std::move(config));
           }),
           py::arg("file"))
      .def_static(
          "from_text",
          [](const std::string& text, const std::string& name, const py::object& folder, const py::kwargs& options) {
            SceneConfig config = sceneFromText(text, name, py::str(folder).cast<std::string>());
            applyOptions(config, options);
            return std::make_shared<SceneConfig>(std::move(config));
          },
          py::arg("text"), py::arg("name") = "scene", py::arg("folder") = ".",
          "From YAML text. Files that it names are looked for in the folder.")
      .def(
          "replaced",
          [](const SceneConfig& self, const py::kwargs& options) {
            SceneConfig config = self;
            applyOptions(config, options);
            return std::make_shared<SceneConfig>(std::move(config));
          },
          "The scene with other options.")
      .def(
          "text", [](const SceneConfig& self) { return sceneText(self); }, "As YAML that reads as this scene.")
      .def_readonly("name", &SceneConfig::name)
      .def_readonly("description", &SceneConfig::description)
      .def_property_readonly("method", [](const SceneConfig& self) { return toString(self.method); })
      .def_property_readonly("handle", [](const SceneConfig& self) { return self.tool.handle; })
      .def_property_readonly("device", [](const SceneConfig& self) { return toString(self.device.kind); })
      .def_readonly("duration", &SceneConfig::duration, "[s]")
      .def_readonly("visual_step", &SceneConfig::visual_step, "[s]")
      .def_readonly("haptic_step", &SceneConfig::haptic_step, "[s]")
      .def_readonly("latency", &SceneConfig::latency, "Visual steps.")
      .def_readonly("seed", &SceneConfig::seed);
}

// --- worlds

DeviceTarget targetFrom(py::handle source) {
  const DeviceState state = stateFrom(source, "target");
  if (!state.pose.allFinite() || !state.twist.allFinite()) throw py::value_error("target: is not finite");
  return {state.pose, state.twist};
}

double stepLength(py::handle step, const WorldOwner& owner) {
  const double h = step.is_none() ? owner.timing.visual_step : step.cast<double>();
  if (!(h > 0) || !(h <= 10)) throw py::value_error("step: must be above 0 and at most 10 s");
  return h;
}

StepReport step(WorldOwner& owner, py::handle target, py::handle length, int parts) {
  const WorldOwner::Use use(owner);
  if (!target.is_none()) owner.target = targetFrom(target);
  const double h = stepLength(length, owner);
  if (parts < 1 || parts > 1000) throw py::value_error("parts: must be from 1 to 1000");
  owner.beginStep();
  const py::gil_scoped_release release;
  const StepReport report = owner.world().step(owner.target, h, parts);
  owner.endStep(report);
  return report;
}

StepReport evaluate(WorldOwner& owner, py::handle target, py::handle length) {
  const WorldOwner::Use use(owner);
  if (!target.is_none()) owner.target = targetFrom(target);
  const double h = stepLength(length, owner);
  owner.beginStep();
  const py::gil_scoped_release release;
  const StepReport report = owner.world().evaluate(owner.target, h);
  owner.endStep(report);
  return report;
}

HandleModel linearizeWorld(WorldOwner& owner, double time) {
  const WorldOwner::Use use(owner);
  owner.requireStep();
  const py::gil_scoped_release release;
  return linearize(owner.world(), owner.built.linearization, time);
}

py::tuple visualStepOf(WorldOwner& owner, py::handle target, py::handle length, double time,
                       const HandleModel* previous) {
  const WorldOwner::Use use(owner);
  if (!target.is_none()) owner.target = targetFrom(target);
  VisualStepSettings settings = visualSettings(owner.built, owner.timing);
  settings.step = stepLength(length, owner);
  const HandleModel before = previous == nullptr ? HandleModel{} : *previous;
  VisualRecord record;
  owner.beginStep();
  {
    const py::gil_scoped_release release;
    record = visualStep(owner.world(), owner.target, settings, time, before);
  }
  owner.endStep(record.step);
  return py::make_tuple(record.model, record.step);
}

void restore(WorldOwner& owner, const std::string& bytes) {
  const WorldOwner::Use use(owner);
  const WorldState state = worldStateFrom(bytes);
  owner.world().restore(state);
  owner.wasSet();
  owner.target = state.aimed ? state.device : DeviceTarget{owner.built.start, Vec6::Zero()};
}

// What C++ takes for each of the same steps [ns], for measuring what Python adds.
std::vector<double> timeSteps(WorldOwner& owner, int count) {
  std::vector<double> times;
  times.reserve(static_cast<std::size_t>(count));
  const WorldOwner::Use use(owner);
  owner.beginStep();
  const py::gil_scoped_release release;
  StepReport report;
  for (int i = 0; i < count; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    report = owner.world().step(owner.target, owner.timing.visual_step, 1);
    const auto end = std::chrono::steady_clock::now();
    times.push_back(std::chrono::duration<double, std::nano>(end - begin).count());
  }
  owner.endStep(report);
  return times;
}

std::vector<BodyView> bodiesOf(const std::shared_ptr<WorldOwner>& owner) {
  std::vector<BodyView> out;
  out.reserve(static_cast<std::size_t>(owner->world().bodies()));
  for (int i = 0; i < owner->world().bodies(); ++i) out.push_back({owner, i});
  return out;
}

py::list listOf(const std::vector<BodyView>& bodies) {
  py::list out;
  for (const BodyView& body : bodies) out.append(body);
  return out;
}

void bindWorldClass(py::module_& module) {
  const py::object none = py::none();
  py::class_<WorldOwner, std::shared_ptr<WorldOwner>>(
      module, "World", "All bodies and obstacles of a scene, and the visual step. One thread at a time may use it.")
      .def(py::init([](const SceneConfig& scene) {
             const py::gil_scoped_release release;
             return std::make_shared<WorldOwner>(scene);
           }),
           py::arg("scene"), "Builds the scene: meshes, matrices, static equilibrium. Releases the GIL.")
      .def("step", &step, py::arg("target") = none, py::arg("step") = none, py::arg("parts") = 1,
           "One visual step: the handle is pulled towards the target (Pose or DeviceState; default: the last one) for "
           "`step` seconds (default: the scene's), in equal parts. Releases the GIL.")
      .def("evaluate", &evaluate, py::arg("target") = none, py::arg("step") = none,
           "As step(), but the world stays where it is.")
      .def("linearize", &linearizeWorld, py::arg("time") = 0.0,
           "Handle model of the step just taken or evaluated, with the scene's derivative and method.")
      .def("visual_step", &visualStepOf, py::arg("target") = none, py::arg("step") = none, py::arg("time") = 0.0,
           py::arg("previous") = none,
           "A step and its handle model (methods hsl, hsl-exact, vc), as a run takes it: (HandleModel, StepReport). If "
           "the step fails, `previous` stays in force.")
      .def(
          "coupling_wrench",
          [](WorldOwner& owner) {
            const WorldOwner::Use use(owner);
            owner.requireStep();
            return copied(couplingWrench(owner.world()));
          },
          "Wrench of the tool on the handle at the end of the last step (6,) [N, N m].")
      .def(
          "contacts",
          [](WorldOwner& owner) {
            const WorldOwner::Use use(owner);
            return owner.contacts();
          },
          "Contacts of the last step. They stay what they are when the world goes on.")
      .def(
          "save",
          [](WorldOwner& owner) {
            const WorldOwner::Use use(owner);
            return py::bytes(toBytes(owner.world().state()));
          },
          "The state as bytes: restored, the world goes on to the bit.")
      .def("restore", &restore, py::arg("state"), "Takes a saved state of this scene. Raises ValueError for others.")
      .def_property_readonly("bodies", [](const std::shared_ptr<WorldOwner>& owner) { return listOf(bodiesOf(owner)); })
      .def_property_readonly("tool",
                             [](const std::shared_ptr<WorldOwner>& owner) {
                               return BodyView{owner, owner->world().toolIndex()};
                             })
      .def_property_readonly(
          "start", [](const WorldOwner& owner) { return owner.built.start; }, "First pose of the device.")
      .def_property_readonly(
          "target",
          [](const WorldOwner& owner) {
            DeviceState state;
            state.pose = owner.target.pose;
            state.twist = owner.target.twist;
            return state;
          },
          "What the handle was last pulled towards.")
      .def_property_readonly(
          "time", [](WorldOwner& owner) { return owner.world().state().time; }, "That all steps took together [s].")
      .def_property_readonly(
          "link", [](WorldOwner& owner) { return owner.world().link; }, "Between handle and device: a copy.")
      .def_property_readonly(
          "gravity", [](WorldOwner& owner) { return copied(owner.world().gravity); }, "(3,) [m/s^2]")
      .def_property_readonly(
          "notes",
          [](const WorldOwner& owner) {
            py::list out;
            for (const std::string& note : owner.built.notes) out.append(note);
            return out;
          },
          "On meshes that are not what one may expect.")
      .def(
          "_time_steps",
          [](WorldOwner& owner, int count) {
            const std::vector<double> times = timeSteps(owner, count);
            return copied(Eigen::Map<const VecX>(times.data(), static_cast<Eigen::Index>(times.size())));
          },
          py::arg("count"));
}

// --- bodies

template <class Row>
py::array tableView(const std::vector<Row>& rows, py::handle owner) {
  using Number = std::remove_cvref_t<decltype(rows[0][0])>;
  const py::ssize_t columns = sizeof(Row) / sizeof(Number);
  return view(rows.empty() ? nullptr : &rows[0][0], {static_cast<py::ssize_t>(rows.size()), columns},
              {sizeof(Row), sizeof(Number)}, owner, Access::read);
}

// The lower triangle by columns is, block by block, the upper one by rows: what SciPy calls BSR, as it lies in memory.
py::object upperTriangle(const SymmetricBlockMatrix& matrix, py::handle owner) {
  if (matrix.size == 0) throw std::runtime_error("the body has no free nodes");
  constexpr py::ssize_t kSize = sizeof(double);
  const py::array values =
      view(matrix.values.data(), {matrix.slots(), 3, 3}, {9 * kSize, 3 * kSize, kSize}, owner, Access::read);
  const py::ssize_t rows = 3 * static_cast<py::ssize_t>(matrix.size);
  return py::module_::import("scipy.sparse")
      .attr("bsr_matrix")(py::make_tuple(values, vectorView(matrix.row, owner), vectorView(matrix.column, owner)),
                          py::arg("shape") = py::make_tuple(rows, rows), py::arg("copy") = false);
}

py::object stiffness(const BodyView& self) {
  const WorldOwner::Use use(*self.owner);
  const Body body = self.body();
  auto matrix = std::make_unique<SymmetricBlockMatrix>(body.model.pattern());
  if (matrix->size > 0) {
    const ElasticMesh& fem = body.model.elasticity();
    ElasticState elastic = body.state.elastic;
    fem.updateRotations(body.state.positions, elastic);
    fem.assemble(0.0, 1.0, elastic, *matrix);
  }
  const py::capsule owner(matrix.get(), [](void* p) { delete static_cast<SymmetricBlockMatrix*>(p); });
  return upperTriangle(*matrix.release(), owner);
}

void setState(const BodyView& self, py::handle positions, py::handle velocities) {
  const WorldOwner::Use use(*self.owner);
  BodyState state = self.body().state;
  const py::ssize_t nodes = state.positions.size() / 3;
  if (!positions.is_none()) state.positions = rowsOfThreeFrom(positions, "positions", nodes);
  if (!velocities.is_none()) state.velocities = rowsOfThreeFrom(velocities, "velocities", nodes);
  if (!state.isFinite()) throw py::value_error("state: is not finite");
  const BodyModel& model = self.body().model;
  if (model.framed()) model.setHandle(state.handle, state);
  self.owner->world().setBody(self.index, state);
  self.owner->wasSet();
}

const BodyModel& framedModel(const BodyView& self) {
  const BodyModel& model = self.body().model;
  if (!model.framed()) throw std::runtime_error(model.name() + ": has no handle and is not rigid");
  return model;
}

void setHandle(const BodyView& self, const Pose& pose, py::handle twist) {
  framedModel(self);
  const WorldOwner::Use use(*self.owner);
  HandleState state{pose, Vec6::Zero()};
  if (!twist.is_none()) state.twist = vec6From(twist, "twist");
  if (!pose.allFinite() || !state.twist.allFinite()) throw py::value_error("handle: is not finite");
  self.owner->world().setHandle(self.index, state);
  self.owner->wasSet();
}

py::array surfaceVertices(const BodyView& self) {
  const WorldOwner::Use use(*self.owner);
  const Body body = self.body();
  const SimulationMesh& mesh = body.model.mesh();
  py::array_t<double> out({static_cast<py::ssize_t>(mesh.embedding.size()), py::ssize_t{3}});
  double* target = out.mutable_data();
  for (const EmbeddedPoint& point : mesh.embedding) {
    Eigen::Map<Vec3> p(target);
    p.setZero();
    const auto& nodes = mesh.mesh.tetrahedra[static_cast<std::size_t>(point.tetrahedron)];
    for (std::size_t k = 0; k < 4; ++k) p += point.weights[k] * body.state.positions.segment<3>(3 * nodes[k]);
    target += 3;
  }
  return out;
}

template <class Get>
auto ofBody(Get get) {
  return [get](const py::object& self) { return get(self.cast<const BodyView&>().body(), self); };
}

void bindBody(py::module_& module) {
  py::class_<BodyView>(module, "Body", "One body of a world. Its arrays are views: they change as the world goes on.")
      .def_property_readonly("name", [](const BodyView& self) { return self.body().model.name(); })
      .def_readonly("index", &BodyView::index, "In World.bodies.")
      .def_property_readonly("rigid", [](const BodyView& self) { return self.body().model.isRigid(); })
      .def_property_readonly(
          "held", [](const BodyView& self) { return self.body().model.held(); }, "By the device.")
      .def_property_readonly("nodes", [](const BodyView& self) { return self.body().model.nodes(); })
      .def_property_readonly(
          "mass", [](const BodyView& self) { return self.body().model.totalMass(); }, "[kg]")
      .def_property_readonly("positions", ofBody([](const Body& body, py::handle self) {
                               return rowsOfThree(body.state.positions, self);
                             }),
                             "(nodes, 3) [m], read-only view.")
      .def_property_readonly("velocities", ofBody([](const Body& body, py::handle self) {
                               return rowsOfThree(body.state.velocities, self);
                             }),
                             "(nodes, 3) [m/s], read-only view.")
      .def_property_readonly(
          "forces",
          ofBody([](const Body& body, py::handle self) { return rowsOfThree(body.system.elasticForces(), self); }),
          "Elastic forces at the start of the last step (nodes, 3) [N], read-only view; ask again after a step, as the "
          "solver uses two buffers in turn. No rows before the first step.")
      .def_property_readonly("masses", ofBody([](const Body& body, py::handle self) {
                               return eigenView(body.model.elasticity().mass(), self, Access::read);
                             }),
                             "(nodes,) [kg], read-only view.")
      .def_property_readonly("rest_positions", ofBody([](const Body& body, py::handle self) {
                               return tableView(body.model.mesh().mesh.nodes, self);
                             }),
                             "Undeformed (nodes, 3) [m], read-only view.")
      .def_property_readonly("tetrahedra", ofBody([](const Body& body, py::handle self) {
                               return tableView(body.model.mesh().mesh.tetrahedra, self);
                             }),
                             "(tetrahedra, 4) int32, read-only view.")
      .def_property_readonly("triangles", ofBody([](const Body& body, py::handle self) {
                               return tableView(body.model.mesh().surface.triangles, self);
                             }),
                             "Of the surface (triangles, 3) int32, read-only view.")
      .def("surface_vertices", &surfaceVertices, "Where the surface now is (vertices, 3) [m]: a copy.")
      .def_property_readonly(
          "free_nodes", ofBody([](const Body& body, py::handle self) { return vectorView(body.model.free(), self); }),
          "Node of each block row of system() and stiffness(), int32, read-only view.")
      .def_property_readonly("attached_nodes", ofBody([](const Body& body, py::handle self) {
                               static const std::vector<int> kNone;
                               return vectorView(body.model.framed() ? body.model.handle().nodes : kNone, self);
                             }),
                             "Nodes on the handle, int32, read-only view.")
      .def_property_readonly(
          "handle_pose",
          [](const BodyView& self) {
            framedModel(self);
            return self.body().state.handle.pose;
          },
          "Of a held or rigid body: a copy.")
      .def_property_readonly("handle_twist", ofBody([](const Body& body, py::handle self) {
                               framedModel(self.cast<const BodyView&>());
                               return eigenView(body.state.handle.twist, self, Access::read);
                             }),
                             "(6,) [m/s, rad/s], read-only view.")
      .def("set_state", &setState, py::arg("positions") = py::none(), py::arg("velocities") = py::none(),
           "Puts the nodes elsewhere (nodes, 3) [m], [m/s]. Those on a handle stay on it: see set_handle().")
      .def("set_handle", &setHandle, py::arg("pose"), py::arg("twist") = py::none(),
           "Gives the handle of a held or rigid body a pose and a twist, and its nodes with it.")
      .def(
          "system",
          [](const py::object& self) {
            const auto& body = self.cast<const BodyView&>();
            const WorldOwner::Use use(*body.owner);
            body.owner->requireStep();
            return upperTriangle(body.body().system.matrix(), self);
          },
          "Upper triangle of the last step's A = (1 + h alpha) M + (h beta + h^2) K of the free nodes, a scipy.sparse "
          "BSR matrix on the solver's memory, read-only: see palpate.symmetric().")
      .def("stiffness", &stiffness,
           "Upper triangle of K [N/m] of the free nodes where they now are, a scipy.sparse BSR matrix of its own: see "
           "palpate.symmetric().");
}

// --- contacts

/// Contacts of one island, which act on one another.
struct IslandView {
  std::shared_ptr<ContactsView> contacts;
  std::size_t index;
  const ContactIsland& island() const { return contacts->set().islands[index]; }
};

template <class Number, class Row>
py::array fieldView(const std::vector<Row>& rows, const Number* first, py::ssize_t columns, py::handle owner) {
  const auto count = static_cast<py::ssize_t>(rows.size());
  if (columns == 1) return view(first, {count}, {sizeof(Row)}, owner, Access::read);
  return view(first, {count, columns}, {sizeof(Row), sizeof(Number)}, owner, Access::read);
}

template <class Get>
auto ofContacts(Get get) {
  return [get](const py::object& self) { return get(self.cast<const ContactsView&>().set(), self); };
}

void bindContacts(py::module_& module) {
  static const Contact kNoContact{};
  static const ContactStatus kNoStatus{};
  const auto first = [](const ContactSet& set) -> const Contact& {
    return set.contacts.empty() ? kNoContact : set.contacts.front();
  };
  py::class_<ContactsView, std::shared_ptr<ContactsView>> contacts(
      module, "Contacts", "Contacts of one step. Arrays are read-only views, one row a contact.");
  contacts.attr("STATES") = py::make_tuple("open", "stick", "slide", "edge", "vertex");
  contacts.def("__len__", [](const ContactsView& self) { return self.set().contacts.size(); })
      .def_property_readonly(
          "glued", [](const ContactsView& self) { return self.set().glued; },
          "How many, the first ones, are equalities.")
      .def_property_readonly("gap", ofContacts([first](const ContactSet& set, py::handle self) {
                               return fieldView(set.contacts, &first(set).gap, 1, self);
                             }),
                             "At the start of the step [m].")
      .def_property_readonly("friction", ofContacts([first](const ContactSet& set, py::handle self) {
                               return fieldView(set.contacts, &first(set).friction, 1, self);
                             }),
                             "Coefficient.")
      .def_property_readonly("normal", ofContacts([first](const ContactSet& set, py::handle self) {
                               return fieldView(set.contacts, first(set).normal.data(), 3, self);
                             }),
                             "From second to first (n, 3).")
      .def_property_readonly("position", ofContacts([first](const ContactSet& set, py::handle self) {
                               return fieldView(set.contacts, first(set).position.data(), 3, self);
                             }),
                             "At the end of the step (n, 3) [m].")
      .def_property_readonly("first", ofContacts([first](const ContactSet& set, py::handle self) {
                               return fieldView(set.contacts, &first(set).first.body, 1, self);
                             }),
                             "Index of a body, int32.")
      .def_property_readonly("second", ofContacts([first](const ContactSet& set, py::handle self) {
                               return fieldView(set.contacts, &first(set).second.body, 1, self);
                             }),
                             "Index of a body, int32; -1: fixed geometry.")
      .def_property_readonly("state", ofContacts([](const ContactSet& set, py::handle self) {
                               const ContactStatus& status = set.status.empty() ? kNoStatus : set.status.front();
                               return fieldView(set.status, reinterpret_cast<const std::uint8_t*>(&status.state), 1,
                                                self);
                             }),
                             "Index in STATES, uint8.")
      .def_property_readonly(
          "impulse", ofContacts([](const ContactSet& set, py::handle self) { return rowsOfThree(set.impulse, self); }),
          "Along normal and tangents (n, 3) [N s].")
      .def_property_readonly(
          "islands",
          [](const std::shared_ptr<ContactsView>& self) {
            py::list out;
            for (std::size_t i = 0; i < self->set().islands.size(); ++i) {
              out.append(IslandView{self, i});
            }
            return out;
          },
          "Groups of contacts that act on one another.");
  py::class_<IslandView>(module, "Island", "Contacts that act on one another.")
      .def_property_readonly(
          "contacts",
          [](const py::object& self) { return vectorView(self.cast<const IslandView&>().island().contacts, self); },
          "Indices of its contacts, int32, read-only view.")
      .def_property_readonly(
          "W",
          [](const py::object& self) {
            // symmetric, so its columns may be taken for rows
            const MatX& w = self.cast<const IslandView&>().island().delassus;
            constexpr py::ssize_t kSize = sizeof(double);
            return view(w.data(), {w.rows(), w.cols()}, {w.rows() * kSize, kSize}, self, Access::read);
          },
          "J A^-1 J^T (3 n, 3 n) [1/kg], three rows a contact: normal, tangents; read-only view.");
}

}  // namespace

void bindWorld(py::module_& module) {
  bindScene(module);
  bindBody(module);
  bindContacts(module);
  bindWorldClass(module);
}

}  // namespace palpate::python
