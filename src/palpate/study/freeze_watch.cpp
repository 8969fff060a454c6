#include "palpate/study/freeze_watch.h"

#include <algorithm>
#include <cmath>

#include "palpate/math/largest_norm.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

constexpr double kTime = 0.3;                     // [s]
constexpr double kStill = 1e-6, kGoing = 1e-5;    // of a node in a step [m]
constexpr double kDistance = 0.005, kTurn = 0.3;  // [m], [rad]

bool far(const Vec6& difference) {
  return difference.head<3>().norm() > kDistance || difference.tail<3>().norm() > kTurn;
}

}  // namespace

FreezeWatch::FreezeWatch(const World& world, const Pose& start, double step)
    : step_(step),
      steps_(std::max(2, static_cast<int>(std::ceil(kTime / step - 1e-9)))),
      hanging_(poseDifference(world.tool().state.handle.pose, start)) {
  restart(world);
}

void FreezeWatch::restart(const World& world) {
  watched_.clear();
  for (int i = 0; i < world.bodies(); ++i) watched_.push_back({world.body(i).state.positions, 0, 0});
  devices_.clear();
}

bool FreezeWatch::pulled(const World& world, const Pose& device) const {
  return far(poseDifference(world.tool().state.handle.pose, device) - hanging_);
}

// The handle stands still: the pull changes with the device.
bool FreezeWatch::pullChanged(const World& world, const Pose& device) const {
  const LinkParameters& link = world.link;
  const Pose& handle = world.tool().state.handle.pose;
  const auto stretch = [&](const Pose& of) {  // of the springs alone
    Vec6 out = saturatedWrenchOnDevice(link, handle, Vec6::Zero(), of, Vec6::Zero());
    out.head<3>() /= link.stiffness;
    out.tail<3>() /= link.rotational_stiffness;
    return out;
  };
  const Vec6 now = stretch(device);
  return std::any_of(devices_.begin(), devices_.end(),
                     [&](const Pose& earlier) { return far(now - stretch(earlier)); });
}

int FreezeWatch::after(const World& world, const Pose& device, bool tool_touches, bool cut) {
  devices_.push_back(device);
  if (static_cast<int>(devices_.size()) > steps_) devices_.pop_front();
  int frozen = 0;
  for (int i = 0; i < world.bodies(); ++i) {
    const BodyState& state = world.body(i).state;
    Watched& w = watched_[i];
    const bool still = largestNorm(state.positions - w.before) < kStill;
    w.before = state.positions;
    w.still = still ? w.still + 1 : 0;
    w.stopped = still && cut && step_ * largestNorm(state.velocities) > kGoing ? w.stopped + 1 : 0;
    if (w.still < steps_) continue;
    const bool held_back =
        i == world.toolIndex() && pulled(world, device) && (!tool_touches || pullChanged(world, device));
    if (w.stopped >= steps_ || held_back) ++frozen;
  }
  return frozen;
}

}  // namespace palpate
