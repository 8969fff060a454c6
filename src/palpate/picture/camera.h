#pragma once

#include <vector>

#include "palpate/picture/types.h"

namespace palpate {

/// The camera nearest to the given points that sees all of them, looking along `direction`.
/// @param direction      of sight [any length], not along z; z is up in the picture
/// @param field_of_view  vertical [rad], in (0, 3)
/// @param aspect         width over height of the picture
/// @param margin         share of half the picture that stays free on each side, in [0, 1)
PictureCamera fitCamera(const std::vector<Vec3>& points, const Vec3& direction, double field_of_view, double aspect,
                        double margin);

/// The narrowest picture, between the given aspects, in which width does not make the camera stand back from where
/// height alone would put it.
double fitAspect(const std::vector<Vec3>& points, const Vec3& direction, double field_of_view, double narrowest,
                 double widest, double margin);

/// Axes of the picture: to the right, up, and into it.
struct CameraFrame {
  Vec3 right, up, forward;
};
CameraFrame cameraFrame(const Vec3& direction);

/// The step of 1, 2 or 5 times a power of ten that is nearest below a fifth of `size`.
double gridSpacing(double size);

}  // namespace palpate
