#include "palpate/picture/camera.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {

CameraFrame cameraFrame(const Vec3& direction) {
  CameraFrame frame;
  frame.forward = direction.normalized();
  frame.right = frame.forward.cross(Vec3::UnitZ()).normalized();
  frame.up = frame.right.cross(frame.forward);
  return frame;
}

PictureCamera fitCamera(const std::vector<Vec3>& points, const Vec3& direction, double field_of_view, double aspect,
                        double margin) {
  const CameraFrame frame = cameraFrame(direction);
  const double tan_v = (1.0 - margin) * std::tan(0.5 * field_of_view);
  const double tan_h = aspect * tan_v;
  // A point (x, y, z) is in sight of an eye e if |x - e_x| <= tan_h (z - e_z), and so for y: four linear bounds on e,
  // each of which one point makes tight.
  double right = -std::numeric_limits<double>::infinity(), left = right, top = right, bottom = right;
  for (const Vec3& point : points) {
    const double x = point.dot(frame.right), y = point.dot(frame.up), z = point.dot(frame.forward);
    right = std::max(right, x - tan_h * z);
    left = std::max(left, -x - tan_h * z);
    top = std::max(top, y - tan_v * z);
    bottom = std::max(bottom, -y - tan_v * z);
  }
  PictureCamera camera;
  camera.direction = frame.forward;
  camera.field_of_view = field_of_view;
  if (points.empty()) return camera;
  const double z = std::min(-(right + left) / (2.0 * tan_h), -(top + bottom) / (2.0 * tan_v));
  camera.eye = 0.5 * (right - left) * frame.right + 0.5 * (top - bottom) * frame.up + z * frame.forward;
  return camera;
}

double fitAspect(const std::vector<Vec3>& points, const Vec3& direction, double field_of_view, double narrowest,
                 double widest, double margin) {
  const auto place = [&](double aspect) {
    const PictureCamera camera = fitCamera(points, direction, field_of_view, aspect, margin);
    return camera.eye.dot(camera.direction);
  };
  constexpr double kNone = 1e3;  // so wide that height alone counts
  double low = narrowest, high = widest;
  const double full = place(kNone), wanted = full - 1e-6 * std::abs(full - place(low));  // rounding counts for nothing
  if (points.empty() || place(low) >= wanted) return low;
  for (int i = 0; i < 30; ++i) {
    const double middle = 0.5 * (low + high);
    (place(middle) < wanted ? low : high) = middle;
  }
  return high;
}

double gridSpacing(double size) {
  if (!(size > 0.0) || !std::isfinite(size)) return 0.0;
  const double largest = size / 5.0;
  const double power = std::pow(10.0, std::floor(std::log10(largest)));
  for (const double factor : {5.0, 2.0}) {
    if (factor * power <= largest) return factor * power;
  }
  return power;
}

}  // namespace palpate
