#include "palpate/haptics/passivity.h"

#include <algorithm>

namespace palpate {

Vec3 passivityForce(const PassivitySettings& settings, const PassivityObserver& observer, const Vec3& device_velocity,
                    double dt) noexcept {
  const double surplus = observer.delivered() - settings.allowance;
  const double speed2 = device_velocity.squaredNorm();
  if (!settings.enabled || surplus <= 0.0 || speed2 < settings.quiet_speed * settings.quiet_speed) return Vec3::Zero();
  const double damping = std::min(surplus / (dt * speed2), settings.max_damping);
  return -damping * device_velocity;
}

}  // namespace palpate
