#include "palpate/devices/path.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
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

Path::Path(std::vector<PathKey> keys, Interpolation interpolation, const Wander& wander)
    : keys_(std::move(keys)), interpolation_(interpolation), wander_(wander) {
  for (std::size_t i = 0; i < keys_.size(); ++i) {
    const std::string key = "key " + std::to_string(i + 1);
    if (!std::isfinite(keys_[i].time) || !keys_[i].position.allFinite() || !keys_[i].rotation.allFinite())
      throw InputError("path", key, "must be finite");
    if (i > 0 && !(keys_[i].time > keys_[i - 1].time + kSameInstant))
      throw InputError("path", key, "times must increase");
  }
  const bool finite = std::isfinite(wander.band) && std::isfinite(wander.from) && std::isfinite(wander.to) &&
                      wander.position.allFinite() && wander.rotation.allFinite();
  if (!finite || wander.band < 0) throw InputError("path", "wander", "must be finite, its band not negative");
  if (wander.band > 0 && !(wander.to > wander.from)) throw InputError("path", "wander", "ends before it begins");
  if (wander.band == 0) return;
  std::mt19937 random(wander.seed);
  const auto next = [&] { return static_cast<double>(random()) / 4294967296.0; };  // the same with every library
  for (auto& axis : sines_) {
    for (int k = 0; k < Wander::kSines; ++k) {
      const double frequency = wander.band * (k + next()) / Wander::kSines;
      axis[k] = {2 * std::numbers::pi * frequency, 2 * std::numbers::pi * next()};
    }
  }
}

void Path::addWander(double t, Vec6& offset, Vec6& rate) const noexcept {
  if (wander_.band <= 0 || t <= wander_.from || t >= wander_.to) return;
  const double fade = std::min(0.5, 0.25 * (wander_.to - wander_.from));
  const double left = std::min(t - wander_.from, wander_.to - t);
  Blend window{1.0, 0.0};
  if (left < fade) {
    window = blend(Interpolation::smooth, left / fade);
    window.rate *= (t - wander_.from <= wander_.to - t ? 1.0 : -1.0) / fade;
  }
  Vec6 size;
  size << wander_.position, wander_.rotation;
  size *= std::sqrt(2.0 / Wander::kSines);
  for (int axis = 0; axis < 6; ++axis) {
    if (size[axis] == 0) continue;
    double value = 0, speed = 0;
    for (const Sine& sine : sines_[axis]) {
      const double angle = sine.rate * (t - wander_.from) + sine.phase;
      value += std::sin(angle);
      speed += sine.rate * std::cos(angle);
    }
    offset[axis] += size[axis] * window.value * value;
    rate[axis] += size[axis] * (window.value * speed + window.rate * value);
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
  Vec6 offset, rate;
  offset << now.position, now.rotation;
  rate << velocity, rotation_rate;
  addWander(t, offset, rate);
  Point point{advance(start, offset), Vec6()};
  point.twist << rate.head<3>(), leftJacobian(offset.tail<3>()) * rate.tail<3>();
  return point;
}

}  // namespace palpate
