#include "palpate/devices/mouse_device.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "palpate/math/cut_norm.h"
#include "palpate/math/rotation.h"

namespace palpate {
MouseDevice::MouseDevice(const SimulatedDeviceSettings& settings, Path path, const Pose& start,
                         const MouseSettings& mouse)
    : SimulatedDevice(settings, std::move(path), start), mouse_(mouse) {
  target_.pose = this->path().at(0.0, start).pose;
  target_.twist.setZero();
}

void MouseDevice::command(const HandCommand& command) noexcept {
  HandCommand safe = command;
  const double norm = safe.pose.rotation.norm();
  if (!safe.pose.position.allFinite() || !(norm > 0.5 && norm < 2.0)) return;
  safe.pose.rotation.normalize();
  Vec3 away = safe.pose.position - startPose().position;
  cutNorm(away, mouse_.max_reach);
  safe.pose.position = startPose().position + away;
  commands_.write(safe);
}

DeviceMemory MouseDevice::save() const {
  DeviceMemory memory = SimulatedDevice::save();
  append(memory, current_.driver == HandCommand::Driver::hand ? 1.0 : 0.0);
  append(memory, current_.pose);
  append(memory, current_.sequence);
  append(memory, current_.plays);
  append(memory, target_.pose);
  append(memory, target_.twist);
  append(memory, path_start_);
  append(memory, left_);
  return memory;
}

void MouseDevice::restore(const DeviceMemory& memory) {
  MemoryReader reader(memory, kMemory + 25, name());
  SimulatedDevice::read(reader);
  current_.driver = reader.number() == 1.0 ? HandCommand::Driver::hand : HandCommand::Driver::path;
  current_.pose = reader.pose();
  current_.sequence = static_cast<std::uint32_t>(reader.number());
  current_.plays = static_cast<std::uint32_t>(reader.number());
  target_.pose = reader.pose();
  target_.twist = reader.vec6();
  path_start_ = reader.number();
  left_ = reader.number();
  taken_.store(current_.sequence, std::memory_order_relaxed);
  commands_.write(current_);  // in place of what waits there, which may be of another time
}

Path::Point MouseDevice::target(double t, double dt) noexcept {
  if (const HandCommand* newest = commands_.read()) {
    if (newest->plays != current_.plays) path_start_ = t;
    if (newest->sequence != current_.sequence) left_ = mouse_.interval;
    current_ = *newest;
    taken_.store(current_.sequence, std::memory_order_relaxed);
  }
  const bool on_path = current_.driver == HandCommand::Driver::path;
  Path::Point goal{current_.pose, Vec6::Zero()};
  if (on_path) goal = path().at(t + dt - path_start_, startPose());
  const double time = on_path ? dt : std::max(left_, dt);
  left_ = std::max(0.0, left_ - dt);
  Vec6 twist = poseDifference(goal.pose, target_.pose) / time;
  const bool linear_cut = cutNorm(twist.head<3>(), mouse_.max_speed);
  const bool angular_cut = cutNorm(twist.tail<3>(), mouse_.max_spin);
  if (on_path && !linear_cut && !angular_cut) {
    target_ = goal;
  } else {
    target_.pose = advance(target_.pose, dt * twist);
    target_.twist = twist;
  }
  return target_;
}

}  // namespace palpate
