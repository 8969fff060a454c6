#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <chrono>
#include <limits>

#include "palpate/common/cancellation.h"
#include "palpate/common/error.h"
#include "palpate/math/decompositions.h"
#include "palpate/mesh/surface_measures.h"
#include "palpate/simulation/world.h"

namespace palpate {
namespace {

constexpr int kMaxSteps = 1500;
constexpr double kTolerance = 1e-12;  // displacement of a step, relative to the bodies' mean edge
// in contact: another choice among contacts that say the same would begin a small motion anew
constexpr double kContactTolerance = 1e-8;
// in contact the solver's tolerance, times so long a step, is a floor that displacements do not fall below
constexpr double kContactFloor = 1e-6;
constexpr int kPatience = 5;  // steps without a smaller displacement
// choices among redundant contacts may go in a circle: that little, for that long, is rest
constexpr double kChatter = 1e-3;
constexpr int kChatterPatience = 60;
constexpr double kFirstStep = 0.02, kShortestStep = 1e-5, kLongestStep = 20.0;  // [s]
// nobody holds a free body: its rigid motions meet only its mass, which a long step makes small beside h^2 K
constexpr double kLongestFreeStep = 0.05;  // [s]
// glue alone holds a body whose own system is as free: its equations lose digits likewise, but it does not drift
constexpr double kLongestGluedStep = 0.5;  // [s]
constexpr double kRise = 1e-9;             // of an energy that rounding may make

/// Lengths of settling steps: short where the energy rises or displacements jump, then longer and longer.
class StepLength {
 public:
  explicit StepLength(double longest) : longest_(longest) {}
  double value() const { return h_; }
  bool shortest() const { return h_ <= kShortestStep; }
  void shorten() { h_ = std::max(0.25 * h_, kShortestStep); }

  /// Takes the displacement of a step of this length, relative to the mean edge. @returns whether the bodies stand
  /// still
  bool settled(double displacement, bool in_contact) {
    stale_ = displacement < best_ ? 0 : stale_ + 1;
    best_ = std::min(best_, displacement);
    const bool floor_reached = displacement < kContactFloor && stale_ >= kPatience;
    const double tolerance = in_contact ? kContactTolerance : kTolerance;
    if (h_ >= longest_ && (displacement < tolerance || floor_reached)) return true;
    if (in_contact && stale_ > kChatterPatience && displacement < kChatter) return true;
    // a jump of the displacement says that the step was too long for the nonlinearity
    const bool jumped = !first_ && displacement > 4.0 * previous_ && displacement > 1e-3;
    const double growth = displacement > 0.3 ? 1.2 : displacement > 0.03 ? 1.6 : 3.0;
    h_ = jumped ? std::max(0.5 * h_, kShortestStep) : std::min(growth * h_, longest_);
    previous_ = displacement;
    first_ = false;
    return false;
  }

 private:
  double longest_, h_ = kFirstStep;
  double previous_ = 0, best_ = std::numeric_limits<double>::infinity();
  int stale_ = 0;
  bool first_ = true;
};

std::string vectorText(const Vec3& v) {
  const auto round = [](double x) { return std::abs(x) < 1e-6 ? 0.0 : x; };
  return fmt::format("({:.2g}, {:.2g}, {:.2g})", round(v.x()), round(v.y()), round(v.z()));
}

/// The rigid motion nearest to a body's last one, and how much of that it is.
struct RigidPart {
  Vec6 twist = Vec6::Zero();
  double share = 0;
};

RigidPart rigidPart(const VecX& x, const VecX& motion) {
  const Eigen::Index n = x.size() / 3;
  Vec3 center = Vec3::Zero();
  for (Eigen::Index i = 0; i < n; ++i) center += x.segment<3>(3 * i) / static_cast<double>(n);
  Mat6 normal = Mat6::Zero();
  Vec6 right = Vec6::Zero();
  for (Eigen::Index i = 0; i < n; ++i) {
    Eigen::Matrix<double, 3, 6> g;
    g << Mat3::Identity(), -skew(x.segment<3>(3 * i) - center);
    normal += g.transpose() * g;
    right += g.transpose() * motion.segment<3>(3 * i);
  }
  RigidPart out;
  out.twist = solve(normal, right);
  const double all = motion.squaredNorm();
  if (all > 0) out.share = out.twist.dot(right) / all;
  return out;
}

double largestStretch(const ElasticMesh& fem, const VecX& x) {
  double most = 1;
  for (const ElasticElement& e : fem.elements()) {
    const Mat3 f = e.deformationGradient(x);
    most = std::max(most, std::sqrt(Eigen::SelfAdjointEigenSolver<Mat3>(f.transpose() * f).eigenvalues()[2]));
  }
  return most;
}

}  // namespace

// Of gravity and elasticity of bodies that move, and of the link [J].
double World::potentialEnergy(const std::vector<int>& of, const Pose& device) const {
  double sum = 0;
  for (const int i : of) {
    const BodyState& state = state_.bodies[i];
    const VecX& mass = models_[i]->elasticity().mass();
    sum += systems_[i]->elasticEnergy(state_.bodies[i], state_.time);
    for (int n = 0; n < models_[i]->nodes(); ++n) {
      if (models_[i]->row()[n] >= 0) sum -= mass[n] * gravity.dot(state.positions.segment<3>(3 * n));
    }
    if (!models_[i]->framed()) continue;
    sum -= models_[i]->handle().mass * gravity.dot(state.handle.pose.position);
    if (!models_[i]->held()) continue;
    sum += linkEnergy(link, poseDifference(state.handle.pose, device));
  }
  return sum;
}

// What keeps a body from standing still, as far as its last motion tells; with what a wrong unit would show by.
std::string World::unrest(int i, const VecX& before) const {
  const BodyModel& model = *models_[i];
  const VecX& x = state_.bodies[i].positions;
  const Bounds box = boundsOf(model.mesh().surface.vertices);
  std::string text =
      fmt::format("{}, {:.3g} x {:.3g} x {:.3g} m, {:.3g} kg, ", model.name(), box.high.x() - box.low.x(),
                  box.high.y() - box.low.y(), box.high.z() - box.low.z(), model.totalMass());
  const RigidPart rigid = rigidPart(x, x - before);
  if (rigid.share > 0.9) {
    const Vec3 along = rigid.twist.head<3>(), about = rigid.twist.tail<3>();
    const double size = 0.5 * (box.high - box.low).norm();
    return text + (along.norm() > size * about.norm() ? "moves freely along " + vectorText(along.normalized())
                                                      : "turns freely about " + vectorText(about.normalized()));
  }
  Eigen::Index worst = 0;
  (x - before).cwiseAbs().maxCoeff(&worst);
  const Vec3 place = x.segment<3>(worst - worst % 3);
  return text + fmt::format("still moves at {}, and is stretched by up to {:.2f}", vectorText(place),
                            largestStretch(model.elasticity(), x));
}

// Of a body, by what holds it: device or world, glue to what is held or stands still, or nothing.
double World::longestSettlingStep(int body, const std::vector<int>& moving) const {
  const auto held = [&](int i) {
    const std::vector<Attachment>& own = models_[i]->attachments();
    return models_[i]->held() || std::any_of(own.begin(), own.end(), [](const Attachment& a) { return !a.glued; });
  };
  if (held(body)) return kLongestStep;
  const auto moves = [&](int i) { return std::find(moving.begin(), moving.end(), i) != moving.end(); };
  const std::vector<int> together = gluedTogether(body);
  const bool by_bodies = std::any_of(together.begin(), together.end(), [&](int i) { return moves(i) && held(i); });
  const bool by_others = std::any_of(joints_.begin(), joints_.end(), [&](const Joint& joint) {
    return std::find(together.begin(), together.end(), joint.body) != together.end() && moves(joint.body) &&
           !moves(joint.partner);
  });
  return by_bodies || by_others ? kLongestGluedStep : kLongestFreeStep;
}

// Backward Euler with growing steps from rest is a damped Newton iteration on the static problem: its matrix has the
// energy's whole curvature but for what is negative. A step that makes energy is taken back and shortened.
double World::settle(const std::vector<int>& moving, Pose device, const SettleProgress& progress) {
  double longest = kLongestStep, edge = std::numeric_limits<double>::infinity();
  for (const int i : moving) {
    longest = std::min(longest, longestSettlingStep(i, moving));
    edge = std::min(edge, models_[i]->contactFinder().edgeLength());
  }
  meter_.start({});
  const DeviceTarget still{device, Vec6::Zero()};
  StepLength h(longest);
  double speed = 0, displacement = 0, energy = potentialEnergy(moving, device);
  bool settled = false;
  WorldState before;
  for (int n = 0; n < kMaxSteps && !settled; ++n) {
    throwIfCancelled();
    before = state_;
    for (const int i : moving) state_.bodies[i].clearVelocities();
    StepInput input{h.value(), gravity, linkTo(still), still, true};
    input.end_time = state_.time;
    const StepReport report = stepBodies(moving, input, Ending::held);
    speed = largestSpeed(moving);
    displacement = speed * h.value() / edge;
    const double after = potentialEnergy(moving, device);
    // contact may lift what begins too deep
    const bool uphill = report.active == 0 && after > energy + kRise * std::abs(energy) && displacement > kContactFloor;
    if ((report.failed() || uphill || !std::isfinite(after)) && !h.shortest()) {
      restore(before);
      h.shorten();
      continue;
    }
    if (report.failed()) break;
    energy = after;
    settled = h.settled(displacement, report.active > 0);
    if (progress) progress(n, displacement * edge);
  }
  if (!settled && !(displacement <= kContactFloor)) {
    std::string text;
    for (const int i : moving) text += (text.empty() ? "" : "; ") + unrest(i, before.bodies[i].positions);
    throw RunError("no static equilibrium at the start: " + text);
  }
  for (const int i : moving) clearVelocities(i);
  return speed;
}

}  // namespace palpate
