#include "palpate/library/world.h"

#include <algorithm>
#include <stdexcept>

#include "palpate/library/convert.h"
#include "palpate/library/scene.h"
#include "palpate/visual/visual_step.h"

namespace palpate::v0 {

using library::from;
using library::guarded;
using library::to;

namespace {

StepReport reportOf(const palpate::StepReport& r, double more_seconds = 0) {
  StepReport out;
  out.failed = r.failed();
  out.sound = r.sound();
  out.converged = r.converged;
  out.contacts_found = r.contacts_found;
  out.contacts = r.contacts;
  out.active = r.active;
  out.sticking = r.sticking;
  out.sliding = r.sliding;
  out.solver_iterations = r.solver_iterations;
  out.solver_residual = r.solver_residual;
  out.penetration = r.penetration;
  out.motion_share = r.motion_share;
  out.redone = r.redone;
  out.kinetic_energy = r.kinetic_energy;
  out.elastic_energy = r.elastic_energy;
  out.energy_made = r.energy_made;
  out.seconds = r.times.total() + more_seconds;
  return out;
}

template <class T>
std::span<const double> view(const T& vector) {
  return {vector.data(), static_cast<std::size_t>(vector.size())};
}

template <std::size_t N>
std::span<const int> view(const std::vector<std::array<int, N>>& rows) {
  static_assert(sizeof(rows[0]) == N * sizeof(int));
  return {reinterpret_cast<const int*>(rows.data()), N * rows.size()};
}

void append(std::vector<double>& out, const Vec3& v) { out.insert(out.end(), v.begin(), v.end()); }

palpate::Body bodyOf(const palpate::World& world, int i) {
  if (i < 0 || i >= world.bodies()) {
    throw std::out_of_range("there is no body " + std::to_string(i) + "; there are " + std::to_string(world.bodies()));
  }
  return world.body(i);
}

// With the rotations of the present positions.
ElasticState elasticNow(const palpate::Body& body) {
  ElasticState state = body.state.elastic;
  body.model.elasticity().updateRotations(body.state.positions, state);
  return state;
}

}  // namespace

VisualStep visualStepOf(const VisualRecord& record) {
  return {record.time, reportOf(record.step, record.linearization_s), to(record.model)};
}

World::Impl::Impl(SceneConfig of, int threads) : config(std::move(of)) {
  if (isHardware(config.device.kind) && !config.device.driver)
    config.device.kind = DeviceName::prescribed;  // none here
  if (threads > 1) team = std::make_unique<ThreadTeam>(threads);
  const ExecutorScope scope(team.get());
  scene = buildScene(config);
  timing = timingOf(config);
  last.pose = last.handle_pose = scene.world.tool().state.handle.pose;
}

World::World(const Scene& scene, int threads)
    : impl_(guarded([&] { return std::make_unique<Impl>(scene.impl_->config, threads); })) {}
World::World(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
World::~World() = default;
World::World(World&&) noexcept = default;
World& World::operator=(World&&) noexcept = default;

// --- steps

StepReport World::step(const DeviceState& device, double step) {
  return guarded([&] {
    Impl& m = *impl_;
    const ExecutorScope scope(m.team.get());
    const double h = step > 0 ? step : m.timing.visual_step;
    const palpate::StepReport report = m.scene.world.step({from(device.pose), from(device.twist)}, h);
    m.last_step = report.failed() || report.redone > 0 ? 0 : h;
    return reportOf(report);
  });
}

VisualStep World::visualStep(const DeviceState& device, double step) {
  return guarded([&] {
    Impl& m = *impl_;
    const ExecutorScope scope(m.team.get());
    VisualStepSettings settings = visualSettings(m.scene, m.timing);
    if (step > 0) settings.step = step;
    const VisualRecord record = palpate::visualStep(m.scene.world, {from(device.pose), from(device.twist)}, settings,
                                                    m.scene.world.state().time, m.last);
    m.last = record.model;
    m.last_step = record.step.failed() || record.step.redone > 0 || settings.substeps > 1 ? 0 : settings.step;
    return visualStepOf(record);
  });
}

HandleModel World::modelAtRest() {
  return guarded([&] {
    const ExecutorScope scope(impl_->team.get());
    impl_->last = startModel(impl_->scene, impl_->timing);
    impl_->last_step = 0;
    return to(impl_->last);
  });
}

HandleModel World::linearize(const Linearization& how) const {
  return guarded([&] {
    const Impl& m = *impl_;
    if (m.last_step <= 0) throw palpate::RunError("there is no step that can be linearized: none, or not in one go");
    const ExecutorScope scope(m.team.get());
    const LinearizationSettings settings{how.exact ? DelassusModel::exact : DelassusModel::diagonal,
                                         how.full ? Derivative::full : Derivative::frozen};
    return to(palpate::linearize(m.scene.world, settings, m.scene.world.state().time - m.last_step));
  });
}

Vector6 World::couplingWrench() const { return to(palpate::couplingWrench(impl_->scene.world)); }

double World::time() const noexcept { return impl_->scene.world.state().time; }
Pose World::start() const noexcept { return to(impl_->scene.start); }
Pose World::handle() const noexcept { return to(impl_->scene.world.tool().state.handle.pose); }
Vector6 World::handleTwist() const noexcept { return to(impl_->scene.world.tool().state.handle.twist); }

void World::setHandle(const Pose& pose, const Vector6& twist) {
  palpate::World& world = impl_->scene.world;
  world.setHandle(world.toolIndex(), {from(pose), from(twist)});
  impl_->last_step = 0;
}

HapticSettings World::hapticSettings() const { return to(impl_->scene.haptic); }

// --- bodies

int World::bodies() const noexcept { return impl_->scene.world.bodies(); }
const std::string& World::bodyName(int body) const { return bodyOf(impl_->scene.world, body).model.name(); }
bool World::isRigid(int body) const { return bodyOf(impl_->scene.world, body).model.isRigid(); }
std::span<const double> World::positions(int body) const {
  return view(bodyOf(impl_->scene.world, body).state.positions);
}
std::span<const double> World::velocities(int body) const {
  return view(bodyOf(impl_->scene.world, body).state.velocities);
}
std::span<const double> World::masses(int body) const {
  return view(bodyOf(impl_->scene.world, body).model.elasticity().mass());
}
std::span<const int> World::tetrahedra(int body) const {
  return view(bodyOf(impl_->scene.world, body).model.mesh().mesh.tetrahedra);
}
std::span<const int> World::triangles(int body) const {
  return view(bodyOf(impl_->scene.world, body).model.mesh().surface.triangles);
}

std::vector<double> World::surface(int body) const {
  const palpate::Body b = bodyOf(impl_->scene.world, body);
  const SimulationMesh& mesh = b.model.mesh();
  std::vector<double> out;
  out.reserve(3 * mesh.embedding.size());
  for (const EmbeddedPoint& p : mesh.embedding) {
    Vec3 place = Vec3::Zero();
    for (int k = 0; k < 4; ++k) {
      place += p.weights[k] * b.state.positions.segment<3>(3 * mesh.mesh.tetrahedra[p.tetrahedron][k]);
    }
    append(out, place);
  }
  return out;
}

std::vector<double> World::forces(int body) const {
  const palpate::Body b = bodyOf(impl_->scene.world, body);
  VecX f(b.state.positions.size());
  b.model.elasticity().forces(b.state.positions, elasticNow(b), f);
  return {f.begin(), f.end()};
}

std::span<const int> World::freeNodes(int body) const { return bodyOf(impl_->scene.world, body).model.free(); }

BlockMatrix World::stiffness(int body) const {
  const palpate::Body b = bodyOf(impl_->scene.world, body);
  SymmetricBlockMatrix k = b.model.pattern();
  BlockMatrix out;
  out.rows = k.size;
  if (k.size > 0) b.model.elasticity().assemble(0.0, 1.0, elasticNow(b), k);
  // Columns of the lower triangle, each block by columns, are rows of the upper one, each block by rows.
  out.begin = std::move(k.column);
  out.column = std::move(k.row);
  out.value = std::move(k.values);
  return out;
}

void World::setStiffnessScale(int body, double scale) {
  bodyOf(impl_->scene.world, body);
  if (!(scale > 0)) throw InputError("stiffness scale", "", "must be above 0");
  impl_->scene.world.setStiffnessScale(body, scale);
  impl_->last_step = 0;
}

void World::setFrictionScale(double scale) {
  if (!(scale >= 0)) throw InputError("friction scale", "", "must not be negative");
  impl_->scene.world.setFrictionScale(scale);
  impl_->last_step = 0;
}

// --- contacts

std::vector<Contact> World::contacts() const {
  const ContactSet& set = impl_->scene.world.contacts();
  const double h = impl_->scene.world.tool().system.input().step;
  std::vector<Contact> out;
  for (std::size_t i = 0; i < set.contacts.size(); ++i) {
    const palpate::Contact& c = set.contacts[i];
    const auto row = static_cast<Eigen::Index>(3 * i);
    const Vec3 impulse = set.impulse.size() >= row + 3 ? Vec3(set.impulse.segment<3>(row)) : Vec3::Zero();
    const bool active = i < set.status.size() && set.status[i].state != ContactState::open;
    Contact shown{c.first.body, c.second.body, c.glued(), to(c.position), to(c.normal), c.gap, c.friction};
    shown.force = to(Vec3(c.frame().transpose() * impulse / h));
    shown.active = active;
    shown.sliding = active && set.status[i].state != ContactState::stick;
    out.push_back(shown);
  }
  return out;
}

std::vector<ContactIsland> World::islands() const {
  std::vector<ContactIsland> out;
  for (const palpate::ContactIsland& island : impl_->scene.world.contacts().islands) {
    out.push_back({island.contacts, view(island.delassus)});
  }
  return out;
}

// --- state

std::string World::save() const { return toBytes(impl_->scene.world.state()); }

void World::restore(std::string_view state) {
  guarded([&] { impl_->scene.world.restore(worldStateFrom(std::string(state))); });
  impl_->last_step = 0;
}

}  // namespace palpate::v0
