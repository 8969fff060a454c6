#include "palpate/devices/path.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "palpate/common/error.h"
#include "palpate/math/rotation.h"

namespace palpate {
namespace {

/// Share of a segment that is done, and its rate, at share s of the segment's time.
struct Blend {
  double value;
  double rate;
};

Blend blend(Interpolation interpolation, double s) {
  if (interpolation == Interpolation::linear) return {s, 1.0};
  // The polynomial of least jerk from rest to rest.
  return {s * s * s * (10.0 + s * (-15.0 + 6.0 * s)), 30.0 * s * s * (1.0 - s) * (1.0 - s)};
}

}  // namespace

Path::Path(std::vector<PathKey> keys, Interpolation interpolation)
    : keys_(std::move(keys)), interpolation_(interpolation) {
  for (std::size_t i = 0; i < keys_.size(); ++i) {
    const std::string key = "key " + std::to_string(i + 1);
    if (!std::isfinite(keys_[i].time) || !keys_[i].position.allFinite() || !keys_[i].rotation.allFinite())
      throw InputError("path", key, "must be finite");
    if (i > 0 && !(keys_[i].time > keys_[i - 1].time + kSameInstant))
      throw InputError("path", key, "times must increase");
  }
}

Path::Point Path::at(double t, const Pose& start) const noexcept {
  PathKey now;
  Vec3 velocity = Vec3::Zero();
  Vec3 rotation_rate = Vec3::Zero();
  // First key that lies after t; a key at t itself begins its segment.
  const auto after = std::upper_bound(keys_.begin(), keys_.end(), t + kSameInstant,
                                      [](double time, const PathKey& key) { return time < key.time; });
  if (after == keys_.begin() || after == keys_.end()) {
    if (!keys_.empty()) now = after == keys_.begin() ? keys_.front() : keys_.back();
  } else {
    const PathKey& from = *(after - 1);
    const double length = after->time - from.time;
    const Blend share = blend(interpolation_, std::max(0.0, t - from.time) / length);
    const Vec3 shift = after->position - from.position;
    const Vec3 turn = after->rotation - from.rotation;
    now.position = from.position + share.value * shift;
    now.rotation = from.rotation + share.value * turn;
    velocity = share.rate / length * shift;
    rotation_rate = share.rate / length * turn;
  }
  Vec6 offset;
  offset << now.position, now.rotation;
  Point point{advance(start, offset), Vec6()};
  point.twist << velocity, leftJacobian(now.rotation) * rotation_rate;
  return point;
}

}  // namespace palpate
