#pragma once

#include <array>
#include <limits>

#include "palpate/math/types.h"

namespace palpate {

/// Two features of two surfaces (or of one) that come near each other in a step.
struct FeaturePair {
  enum class Kind { vertex_face, face_vertex, edge_edge };  ///< first, second
  Kind kind = Kind::vertex_face;
  std::array<int, 3> first_vertex{-1, -1, -1};  ///< of the first surface; -1: unused
  std::array<int, 3> second_vertex{-1, -1, -1};
  std::array<double, 3> first_weight{};  ///< barycentric, at reference_time
  std::array<double, 3> second_weight{};
  int first_triangle = -1;  ///< the face, or the owner of the vertex or edge
  int second_triangle = -1;
  int first_feature = -1;  ///< index of the vertex, face or edge
  int second_feature = -1;
  Vec3 normal = Vec3::UnitZ();  ///< unit, from second to first, at reference_time
  double start_distance = 0;    ///< >= 0 [m]
  /// Without a hit the distance at the end; else normal . (first - second) there, of the weighted points [m].
  double end_distance = 0;
  double toi = 1;    ///< of a hit: the distance stays above a fraction of the reach, or of the start's, until then
  bool hit = false;  ///< the path runs through the other feature, or comes down to that fraction
  /// The line from one feature to the other starts into one of the solids (of closed surfaces): they overlap already,
  /// or the pair comes after another hit, or something in front of it is nearer. Not a contact to keep apart along
  /// normal.
  bool from_inside = false;
  double reference_time = 0;  ///< that of weights and normal: 0, 1, or toi of a hit
  double rest_distance = std::numeric_limits<double>::infinity();  ///< of pairs of one surface, if below reach [m]
};

struct PairSettings {
  /// A path counts as a hit where it comes below this fraction of the reach, or of the start's distance if that is
  /// less.
  double hit_fraction = 0.1;
  /// Fast motion is taken in at most this many pieces of time.
  int max_pieces = 32;
  int max_iterations = 64;  ///< of continuous detection, a pair
  /// For who asks where rigid surfaces are near now and may soon touch, and not how to keep a motion from crossing:
  /// what is near at the start is described as it is then, though it hits, and the search goes on. A flat face on an
  /// edge has its nearest place at one end of it, and after a little turn at the other: both are reported.
  bool as_now = false;
  /// For who asks what may soon be touched: hollow edges are not looked at, as something else is hit before them, and
  /// hits whose line enters a face beside the vertex or edge are left out. What is hit from inside is left out by
  /// SurfaceContacts.
  bool ahead = false;
};

}  // namespace palpate
