#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "palpate/common/error.h"
#include "palpate/math/types.h"

namespace palpate {

/// What a device remembers between two ticks, as plain numbers in an order of its own: SI units, world frame, a
/// quaternion as x, y, z, w. Copied, compared and written by anybody; understood by the kind of device that made it.
using DeviceMemory = std::vector<double>;

inline void append(DeviceMemory& memory, double value) { memory.push_back(value); }
inline void append(DeviceMemory& memory, const Vec6& v) { memory.insert(memory.end(), v.begin(), v.end()); }
inline void append(DeviceMemory& memory, const Pose& pose) {
  const auto& q = pose.rotation.coeffs();
  memory.insert(memory.end(), pose.position.begin(), pose.position.end());
  memory.insert(memory.end(), q.begin(), q.end());
}

/// Takes the numbers out again in the order in which they were appended.
class MemoryReader {
 public:
  /// @throws InputError unless there are `count` numbers
  MemoryReader(const DeviceMemory& memory, std::size_t count, const char* device) : memory_(memory) {
    if (memory.size() == count) return;
    throw InputError("memory of the device", device,
                     "must be " + std::to_string(count) + " numbers, not " + std::to_string(memory.size()));
  }
  double number() { return memory_[next_++]; }
  Vec6 vec6() {
    Vec6 v;
    for (double& x : v) x = number();
    return v;
  }
  Pose pose() {
    Pose pose;
    for (double& x : pose.position) x = number();
    for (double& x : pose.rotation.coeffs()) x = number();
    return pose;
  }

 private:
  const DeviceMemory& memory_;
  std::size_t next_ = 0;
};

}  // namespace palpate
