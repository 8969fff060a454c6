#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "palpate/mesh/types.h"

namespace palpate {

/// Outline of a solid of revolution about z: corners (r, z) [m] of a polygon in the half plane r >= 0, in either
/// direction, the last joined to the first. Sides along the axis make no surface.
using RevolutionProfile = std::vector<std::array<double, 2>>;

inline constexpr std::size_t kLargestProfile = 200;     ///< corners
inline constexpr double kShortestProfileSide = 1e-5;    ///< [m]; also the least distance of a corner from the axis
inline constexpr int kLeastRevolutionSegments = 8;      ///< around
inline constexpr int kLargestRevolutionSegments = 512;  ///< around

/// What keeps a profile from bounding a solid, if anything: too few or too many corners, one left of the axis or almost
/// on it, sides that are too short, cross or touch each other, a corner that touches the axis alone.
std::optional<std::string> profileObjection(const RevolutionProfile& profile);

/// Closed, outward-oriented surface of a solid of revolution; z stays the profile's own. With w the width of one of
/// `segments` on the largest circle, sides are divided into pieces of about w, and circles of less than half (a
/// quarter, ...) of the largest radius have half (a quarter, ...) as many vertices, so that triangles stay well shaped
/// up to the axis. A profile off the axis gives a ring, one with a notch on the axis a cavity.
/// @param segments  around the largest circle
/// @throws InputError("revolution", ...) for a bad profile, segments out of range, or more than a million triangles
Surface revolutionSurface(const RevolutionProfile& profile, int segments = 48);

}  // namespace palpate
