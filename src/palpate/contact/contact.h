#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// A material point of one body, x = sum_k weight[k] x(node[k]), the weights summing to 1. A surface vertex lies in one
/// tetrahedron; a point of a surface triangle in up to three.
struct ContactPoint {
  static constexpr int kCapacity = 12;
  int body = -1;  ///< index in the world; -1: fixed geometry, which has no unknowns
  int count = 0;
  std::array<int, kCapacity> node{};
  std::array<double, kCapacity> weight{};

  /// Adds to the weight of a node. At most kCapacity different nodes.
  void add(int n, double w) {
    for (int k = 0; k < count; ++k) {
      if (node[k] == n) {
        weight[k] += w;
        return;
      }
    }
    node[count] = n;
    weight[count++] = w;
  }
  /// Of flat node positions [m] (or velocities).
  Vec3 at(const VecX& x) const {
    Vec3 p = Vec3::Zero();
    for (int k = 0; k < count; ++k) p += weight[k] * x.segment<3>(3 * node[k]);
    return p;
  }
  bool operator==(const ContactPoint&) const = default;
};

/// Features of two surfaces that a contact is between; on planes: none.
struct ContactFeatures {
  int first_surface = -1;  ///< in SurfaceContacts' order
  int second_surface = -1;
  int kind = 0;  ///< FeaturePair::Kind
  int first = -1;
  int second = -1;
  bool operator==(const ContactFeatures&) const = default;
};

/// One unilateral contact with friction: gap + h normal . (v_first - v_second) >= 0; or two places that are glued: the
/// same as an equality, and likewise along both tangents.
struct Contact {
  static constexpr int kGlue = -2;  ///< as a partner
  std::uint64_t key = 0;            ///< of the pair of features
  std::uint64_t track = 0;  ///< of what persists while features slide on each other; carries impulses over to next step
  ContactFeatures features;
  ContactPoint first;
  ContactPoint second;
  Vec3 normal;    ///< unit, from second to first
  Vec3 tangent1;  ///< unit; the linearized cone's first vertex lies along it
  Vec3 tangent2;
  double gap = 0;      ///< at the start of the step, linearized along the normal [m]
  double follows = 1;  ///< share of a change of the true gap that `gap` takes on: it may be what a step recovers
  std::array<double, 2> tangent_gap{};  ///< along the tangents, of what is glued [m]
  double friction = 0;                  ///< Coulomb coefficient
  std::uint64_t patch = 0;  ///< points of one patch move affinely against each other (as long as their normals agree)
  int partner = 0;          ///< obstacle, or surface of the other body: contacts of one pair of surfaces share it
  Vec3 position;            ///< of the point at the end of the (predicted) step [m]
  double end_gap = 0;       ///< gap there [m]
  double thickness = 0;     ///< gap that is kept, already taken off `gap` and `end_gap` [m]
  double slack = 0;         ///< end gaps down to -slack need no further pass [m]
  double impact_time = 1;   ///< in (0, 1): at that share of the predicted motion one surface would meet the other
  bool crosses() const { return impact_time < 1; }
  bool glued() const { return partner == kGlue; }

  /// Rows normal, tangent1, tangent2.
  Mat3 frame() const {
    Mat3 f;
    f.row(0) = normal.transpose();
    f.row(1) = tangent1.transpose();
    f.row(2) = tangent2.transpose();
    return f;
  }
  bool operator==(const Contact&) const = default;
};

/// Whether two contacts are of one pair of surfaces, and of one patch of it.
inline bool samePair(const Contact& a, const Contact& b) {
  return a.first.body == b.first.body && a.partner == b.partner;
}
inline bool samePatch(const Contact& a, const Contact& b) { return samePair(a, b) && a.patch == b.patch; }

/// Tangents of a contact frame: the first is world x made tangent to the contact (world y where the normal is along x),
/// so the linearized cone is exact for sliding along world x or y on level ground.
void setTangents(Contact& contact);

/// The same contact with its sides exchanged: points, features and normal. Tangents stay.
Contact turnedAround(Contact contact);

/// Mixes numbers into a key; for features' identities, so the order of arguments counts.
std::uint64_t contactKey(std::uint64_t a, std::uint64_t b, std::uint64_t c = 0, std::uint64_t d = 0);

/// Chooses from all candidates a small, well-spread set. A patch moves affinely, so against a plane a few extreme
/// points of it bound all others; patches overlap in the nodes they share, so points of one pair of surfaces that are
/// nearer to each other than `spacing` and face the same way are thinned, deepest first. Each contact needs a node of a
/// soft body for itself, of some weight in it, that no other contact of like facing has: so there are hardly more
/// contacts than nodes near, and W stays far from singular. Those in `kept` (sorted tracks: contacts that carried force
/// in the last step) come before all others. What the choice misses is found by the check at the end of the step and
/// added.
/// @param soft  which bodies are
/// @returns indices into candidates, in order of choice
class ContactReduction {
 public:
  const std::vector<int>& choose(const std::vector<Contact>& candidates, const std::vector<std::uint64_t>& kept,
                                 double spacing, const std::vector<char>& soft = {});

 private:
  void propose(const std::vector<Contact>& all, const std::vector<std::uint64_t>& kept);
  void proposeByFacing(const std::vector<Contact>& all, std::size_t begin, std::size_t end);
  void extremePoints(const std::vector<Contact>& all, std::size_t begin, std::size_t end);
  void takeSpaced(const std::vector<Contact>& all, double spacing, const std::vector<char>& soft);
  bool takeNode(const Contact& contact, const std::vector<char>& soft);

  struct Taken {  // a node, and the way that its contact faces
    int body, node;
    Vec3 normal;
  };

  std::vector<int> order_, proposals_, chosen_;
  std::vector<char> kept_, taken_;
  std::unordered_multimap<std::uint64_t, Taken> nodes_;
  int pairs_ = 0;                             // of surfaces
  std::vector<int> pair_, latest_, earlier_;  // pair of surfaces of a candidate; its last chosen; the one before that
};

}  // namespace palpate
