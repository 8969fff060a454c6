#include "palpate/visual/live_step.h"

#include <algorithm>
#include <cmath>

#include "palpate/common/parallel.h"
#include "palpate/common/scoped_timer.h"
#include "palpate/math/largest_norm.h"
#include "palpate/mesh/surface_measures.h"

namespace palpate {
namespace {

constexpr double kLongest = 6.0;                   // visual steps that a replay may bridge
constexpr double kStrong = 3.0, kAnyway = 5.0;     // of the link's force, and [N]: with which the handle is led
constexpr double kFarthest = 0.01;                 // that a correction may move a node [m]: more is no correction
constexpr double kKnown = 1e-7;                    // [kg^1/2 m]: neither model nor world is known better
constexpr double kFirst = 3.0;                     // visual steps for which the first model may be in use
constexpr int kMostParts = 4;                      // steps in which a long way is made up for
constexpr double kStill = 0.003, kMoving = 0.006;  // [m/s]: where all is slower, it rests; where not, it moves

// Force and handle after a step, for the records: the tick has its own model.
HandleModel shownModel(const World& world, double step, double time) {
  const Body tool = world.tool();
  HandleModel model;
  model.force = tool.system.wrenchOnHandle(tool.state);
  model.pose = model.handle_pose = tool.state.handle.pose;
  model.twist = model.handle_twist = tool.state.handle.twist;
  model.time = time;
  model.step = step;
  return model;
}

// The tool with the corrections that the next step is to bring into the world.
ToolShape shiftedShape(const World& world, const VecX& shift) {
  ToolShape shape = toolShape(world);
  if (shift.size() > 0) shape.places += shift;
  return shape;
}

// Of the points that are fixed to a frame, by a small motion or a twist of it.
double largestMotion(const Handle& frame, const Pose& pose, const Vec6& motion) {
  double most = 0;
  for (int k = 0; k < static_cast<int>(frame.offsets.size()); ++k) {
    most = std::max(most, (frame.jacobian(k, pose) * motion).norm());
  }
  return most;
}

// Where a body is in the world and how it moves, by its modes.
struct ModalMotion {
  VecX z, speed;
};
ModalMotion modalMotion(const Body& body, const PartnerBasis& basis) {
  if (body.model.isRigid()) {
    const MatX project = basis.modes.transpose() * basis.mass;
    return {project * poseDifference(body.state.handle.pose, basis.pose), project * body.state.handle.twist};
  }
  const int n = body.model.freeNodes();
  VecX moved(3 * n), speed(3 * n);
  for (int k = 0; k < n; ++k) {
    const int i = body.model.free()[k];
    moved.segment<3>(3 * k) = body.state.positions.segment<3>(3 * i) - basis.places.segment<3>(3 * k);
    speed.segment<3>(3 * k) = body.state.velocities.segment<3>(3 * i);
  }
  const VecX mass = freeMasses(body.model);
  return {basis.project(mass, moved), basis.project(mass, speed)};
}

// From 0, it moves, to 1, it rests.
double stillAt(double speed) { return 1.0 - std::clamp((speed - kStill) / (kMoving - kStill), 0.0, 1.0); }

// Of what reaches so far from the handle's origin [m/s].
double largestSpeed(const ToolPath& way, double reach) {
  double most = 0;
  for (const HandleState& point : way.points) {
    most = std::max(most, point.twist.head<3>().norm() + reach * point.twist.tail<3>().norm());
  }
  return most;
}

}  // namespace

void LiveVisual::begin(World& world, double step, std::int64_t index, double time) {
  state_ = {};
  dampForces(world, 1e3, state_.damped);
  // no speed says yet what is near: all that a fall would reach while this model is in use
  LiveSettings settings = settings_;
  const double span = kFirst * step;
  settings.margin = std::max(settings.margin, 0.5 * world.gravity.norm() * span * span);
  reduce(world, settings, toolShape(world), 1.0, step, index, time);
}

ToolPath LiveVisual::pathSince(const HandlePath& path) const {
  ToolPath out;
  const std::int64_t last = path.end() - 1;
  for (std::int64_t i = std::clamp(state_.model.index, path.first(), last); i <= last; ++i) {
    out.points.push_back({path[i].pose, path[i].twist});
  }
  out.shift = state_.shift;
  out.velocity = state_.velocity;
  out.others = state_.others;
  return out;
}

// The last model along the recorded path.
bool LiveVisual::replayed(const Vec3& gravity, const HandlePath& path, LiveState& state) {
  return replay_.replayAll(path.end() - 1, state_.model, tick_, gravity, path, state) && isFinite(state);
}

// Whether handle, tool and what it touches hardly moved: from 0, all that moves, to 1, all at rest.
double LiveVisual::stillness(const World& world, const ToolPath& way, const LiveState& replayed) const {
  double speed = std::max(largestSpeed(way, largestNorm(state_.basis.places)),
                          largestNorm(state_.basis.modes * replayed.speed.head(state_.basis.modes.cols())));
  for (const PartnerBasis& basis : state_.basis.partners) {
    const VecX own = basis.modes * basis.own(replayed.speed);
    const Body body = world.body(basis.body);
    speed = std::max(speed, body.model.isRigid() ? largestMotion(body.model.handle(), body.state.handle.pose, own)
                                                 : largestNorm(own));
  }
  return stillAt(speed);
}

// The model began where they led to; a step that was pulled has not brought them into the world. While the handle moves
// the model knows better; where it rests, each step would find the same difference again.
void LiveVisual::forgetCorrections(const World& world, const ToolPath& way, double left) {
  LiveBasis& basis = state_.basis;
  const double share = left * stillAt(largestSpeed(way, largestNorm(basis.places)));
  if (way.shift.size() > 0) basis.places -= share * way.shift;
  for (PartnerBasis& partner : basis.partners) {
    const BodyCorrection* own = correctionOf(way.others, partner.body);
    if (own == nullptr) continue;
    if (world.body(partner.body).model.isRigid()) {
      partner.pose = advance(partner.pose, Vec6(-share * own->shift));
    } else {
      partner.places -= share * own->shift;
    }
  }
}

namespace {

// By which model and world may each be off, squared, as lengths of the modes. The world's steps end with the velocity
// that they have had all along; in the model elastic forces follow straight lines.
struct ModalErrors {
  double model, world;
};

ModalErrors errorsOf(const LiveModel& model, const LiveBasis& basis, const VecX& z, const VecX& speed,
                     const VecX& force, double time, int parts) {
  const Eigen::Index r = z.size();
  const VecX w2 = model.squared_frequency.head(r);
  const VecX unknown = force - basis.force + w2.cwiseProduct(z) + model.turning * z;
  const VecX moved = unknown.array() / (w2.array() + 12.0 / (time * time));  // it grew with the square of time
  return {moved.squaredNorm(), (0.5 * time / parts * (speed - model.speed.head(r))).squaredNorm()};
}

// On the tool's modes, where the world is.
VecX elasticForces(World& world, const LiveBasis& basis) {
  const Body tool = world.tool();
  const VecX& forces = tool.system.forcesAhead(tool.state.positions, tool.state);
  const Mat3 rt = tool.state.handle.pose.matrix().transpose();
  VecX own(3 * tool.model.freeNodes());
  for (int i = 0; i < tool.model.freeNodes(); ++i) {
    own.segment<3>(3 * i) = rt * forces.segment<3>(3 * tool.model.free()[i]);
  }
  return basis.modes.transpose() * own;
}

}  // namespace

// Its low modes in place of the world's, as far as they are the better known; what that changes is the next step's to
// bring into the world.
ToolShape LiveVisual::corrected(World& world, const LiveState& replayed, int parts) {
  ToolShape shape = toolShape(world);
  const VecX mass = freeMasses(world.tool().model);
  const LiveBasis& basis = state_.basis;
  const Eigen::Index r = basis.modes.cols();
  const VecX z = basis.project(mass, shape.places - basis.places), speed = basis.project(mass, shape.speeds);
  double share = settings_.feedback;
  if (r > 0) {
    const double time = tick_ * static_cast<double>(replayed.index - state_.model.index);
    const ModalErrors errors =
        errorsOf(state_.model, basis, z, speed, elasticForces(world, basis), time, std::max(1, parts));
    share *= errors.world / (errors.world + errors.model + kKnown * kKnown);
  }
  state_.velocity.resize(0);
  state_.shift = share * (basis.modes * (replayed.z.head(r) - z));
  if (state_.shift.size() > 0 && state_.shift.cwiseAbs().maxCoeff() > kFarthest) {
    state_.shift.resize(0);
    return shape;
  }
  state_.velocity = share * (basis.modes * (replayed.speed.head(r) - speed));
  shape.places += state_.shift;
  shape.speeds += state_.velocity;
  correctPartners(world, replayed, share);
  return shape;
}

// The same of the bodies that it touches.
void LiveVisual::correctPartners(const World& world, const LiveState& replayed, double share) {
  for (const PartnerBasis& basis : state_.basis.partners) {
    const Body body = world.body(basis.body);
    const ModalMotion now = modalMotion(body, basis);
    BodyCorrection correction{basis.body, {}, {}};
    correction.shift = share * (basis.modes * (basis.own(replayed.z) - now.z));
    const double most = body.model.isRigid()
                            ? largestMotion(body.model.handle(), body.state.handle.pose, correction.shift)
                            : correction.shift.cwiseAbs().maxCoeff();
    if (most > kFarthest) continue;
    correction.velocity = share * (basis.modes * (basis.own(replayed.speed) - now.speed));
    state_.others.push_back(std::move(correction));
  }
}

void LiveVisual::reduce(World& world, const LiveSettings& settings, const ToolShape& shape, double still, double step,
                        std::int64_t index, double time) {
  LiveBasis basis;
  LiveModel model = reduction_.reduce(
      world, settings, {shape, state_.damped, state_.basis.modes, step, state_.basis.partners, state_.others, still},
      basis);
  model.index = index;
  model.time = time;
  state_.ready = isFinite(model);
  state_.model = model;
  if (state_.ready) state_.basis = std::move(basis);
}

VisualRecord LiveVisual::step(World& world, const HandlePath& path, const DeviceTarget& device,
                              const VisualStepSettings& settings, double time, const HandleModel& previous) {
  VisualRecord record;
  record.time = time;
  record.model = previous;
  ToolPath way = pathSince(path);
  const HandleState& end = way.points.back();
  way.link = -saturatedWrenchOnDevice(world.link, end.pose, end.twist, device.pose, device.twist);
  way.largest_force = kStrong * way.link.head<3>().norm() + kAnyway;
  if (settings_.bend > 0) {
    way.largest_bend = settings_.bend * boundsOf(world.tool().model.mesh().mesh.nodes).diagonal();
  }
  const double length = tick_ * static_cast<double>(way.points.size() - 1);
  if (length <= 0) return record;
  if (state_.ready && !world.tool().system.prepared().ready) {
    ToolReduction::prepare(world, settings_, shiftedShape(world, state_.shift), settings.step);
  }
  // what the last model does along the path is no matter of the world's
  LiveState now;
  bool found = false;
  double replay = 0;
  Aside replaying([&] {
    const ScopedTimer own(replay);
    found = state_.ready && length <= kLongest * settings.step && replayed(world.gravity, path, now);
  });
  const int steps = std::clamp(static_cast<int>(std::ceil(length / (1.01 * settings.step))), 1, kMostParts);
  record.step = world.follow(way, length, steps * settings.substeps);

  const ScopedTimer timer(record.linearization_s);
  replaying.wait();
  const bool known = found && !record.step.failed();
  dampForces(world, length, state_.damped);
  state_.shift.resize(0);
  state_.velocity.resize(0);
  state_.others.clear();
  if (known) forgetCorrections(world, way, std::max(0.0, 1.0 - record.step.corrected_share));
  const double still = known ? stillness(world, way, now) : 0.0;
  reduce(world, settings_, known ? corrected(world, now, record.step.parts) : toolShape(world), still, settings.step,
         path.end() - 1, time);
  record.reduction = reduction_.times();
  record.reduction.replay = replay;

  if (!record.step.failed()) record.model = shownModel(world, settings.step, time);
  record.model.unsound = !record.step.sound();
  return record;
}

}  // namespace palpate
