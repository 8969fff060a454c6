#include "palpate/haptics/passivity.h"

#include <algorithm>

namespace palpate {

Vec6 passivityWrench(const PassivitySettings& settings, const PassivityObserver& observer, const Vec6& device_twist,
                     double dt) noexcept {
  const double surplus = observer.delivered() - settings.allowance;
  if (!settings.enabled || surplus <= 0.0) return Vec6::Zero();
  const Vec3 v = device_twist.head<3>(), w = device_twist.tail<3>();
  const double damping = v.norm() < settings.quiet_speed ? 0.0 : settings.max_damping;
  const double rotational = w.norm() < settings.quiet_spin ? 0.0 : settings.max_rotational_damping;
  const double most = dt * (damping * v.squaredNorm() + rotational * w.squaredNorm());  // energy of a tick
  if (!(most > 0.0)) return Vec6::Zero();
  const double share = std::min(surplus / most, 1.0);
  Vec6 out;
  out << -share * damping * v, -share * rotational * w;
  return out;
}

}  // namespace palpate
