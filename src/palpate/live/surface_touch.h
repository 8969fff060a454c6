#pragma once

#include "palpate/live/live_model.h"

namespace palpate {

/// How a place of the tool touches a surface; world frame.
struct SurfaceTouch {
  double gap;   ///< [m]
  Vec3 normal;  ///< unit, out of the surface
};
SurfaceTouch touch(const LiveSurface& surface, const Vec3& place) noexcept;

/// From a place of the tool, along what is flat of it there, to where that comes nearest to the surface.
/// @param rotation  of the handle
/// @param place     world [m]
/// @returns in the handle's frame [m]; zero where nothing is flat
Vec3 slideAlongFlat(const LiveSurface& surface, const Mat3& rotation, const Vec3& place) noexcept;

}  // namespace palpate
