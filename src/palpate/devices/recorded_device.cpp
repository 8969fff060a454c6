#include "palpate/devices/recorded_device.h"

#include <cmath>
#include <utility>

#include "palpate/common/error.h"
#include "palpate/devices/path.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

DeviceState atRest(DeviceState state) {
  state.twist.setZero();
  return state;
}

}  // namespace

RecordedDevice::RecordedDevice(MotionRecording recording, const DeviceLimits& limits)
    : recording_(std::move(recording)), limits_(limits) {
  if (recording_.samples.empty()) throw InputError("recorded motion", "", "has no rows");
}

DeviceState RecordedDevice::sample(double t) noexcept {
  const auto& samples = recording_.samples;
  while (row_ + 1 < samples.size() && samples[row_ + 1].time <= t + kSameInstant) ++row_;
  const MotionSample& row = samples[row_];
  if (recording_.has_twist && std::abs(t - row.time) <= kSameInstant) return row.state;
  if (t < row.time - kSameInstant || row_ + 1 == samples.size()) return atRest(row.state);
  return between(row, samples[row_ + 1], t);
}

void RecordedDevice::restore(const DeviceMemory& memory) {
  Device::restore(memory);
  row_ = 0;
}

DeviceState RecordedDevice::between(const MotionSample& from, const MotionSample& to, double t) const noexcept {
  const double length = to.time - from.time;
  const double share = std::fmax(0.0, t - from.time) / length;
  const Vec6 difference = poseDifference(to.state.pose, from.state.pose);
  DeviceState state = from.state;
  state.pose = advance(from.state.pose, share * difference);
  state.twist = recording_.has_twist ? Vec6(from.state.twist + share * (to.state.twist - from.state.twist))
                                     : Vec6(difference / length);
  return state;
}

}  // namespace palpate
