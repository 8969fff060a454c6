#pragma once

#include <cstdint>
#include <span>

#include "palpate/linear/aligned_buffer.h"
#include "palpate/math/types.h"

namespace palpate {

/// Cone that bounds the friction impulse.
struct FrictionCone {
  bool exact = false;  ///< exact (round) Coulomb cone; otherwise the paper's linearized cone
  /// Number of vertices k of the linearized cone's cross-section, inscribed in the circle of radius mu lambda_n, the
  /// first along the contact's first tangent. It errs by 1 - cos(pi / k) between two vertices: 29 % at 4, 7.6 % at 8.
  int facets = 8;
};

/// What a contact does at the solution. For the linearized cone: the friction impulse inside the polygon (stick), on
/// one of its edges, or at one of its vertices.
enum class ContactState : std::uint8_t { open, stick, slide, edge, vertex };

/// State with the index that edge and vertex need: vertex k lies at angle 2 pi k / facets from the first tangent, edge
/// k runs from vertex k to vertex k + 1.
struct ContactStatus {
  ContactState state = ContactState::open;
  int index = 0;
  bool operator==(const ContactStatus&) const = default;
};

/// Contact with friction on condensed coordinates. m contacts, three rows each: normal, first and second tangent.
///   w = delassus lambda + free,   w_n >= bias  perp  lambda_n >= 0,   lambda_t of maximal dissipation in the cone mu
///   lambda_n
struct ContactProblem {
  Eigen::Ref<const MatX> delassus;  ///< W = J A^-1 J^T [1/kg], symmetric positive semi-definite, 3m x 3m
  Eigen::Ref<const VecX> free;      ///< velocity of the rows without contact impulse [m/s], 3m
  Eigen::Ref<const VecX> bias;      ///< least normal velocity, -gap / h [m/s], m
  Eigen::Ref<const VecX> friction;  ///< coefficient mu, m
  FrictionCone cone;
};

/// Unit vector to vertex `index` of the linearized cone's cross-section, in contact coordinates (normal, first, second
/// tangent), so its first entry is 0. Friction at that vertex is mu lambda_n times it. Any index; it wraps around.
Vec3 vertexDirection(int index, int facets);
/// Outward unit normal of edge `index` (from vertex index to index + 1); the edge lies at mu lambda_n cos(pi / facets).
Vec3 edgeNormal(int index, int facets);
/// Unit tangent of edge `index`, from vertex index towards index + 1.
Vec3 edgeTangent(int index, int facets);

/// How far `lambda` (3m, [N s]) is from obeying the contact law, as a velocity [m/s]: the natural map of each contact,
///   normal       | rho lambda_n - max(0, rho lambda_n - (w_n - bias)) |
///   tangential   | rho lambda_t - P(rho lambda_t - w_t) |,   P nearest point of rho max(0, mu lambda_n) K
/// with w = delassus lambda + free, K the unit disc or the polygon inscribed in it, and rho = trace(W_ii) / 3 [1/kg],
/// which makes impulses and velocities of contact i comparable (if that is 0, the mean over the contacts, or 1). The
/// largest entry over all contacts. Zero if and only if lambda solves the problem: a point of K that stays put when it
/// takes a step along -w_t and is projected back is one that dissipates most. Infinite if anything is not finite.
/// Plainly written and independent of ContactSolver. Throws std::invalid_argument if the sizes do not match.
double contactResidual(const ContactProblem& problem, const VecX& lambda);

/// Throws std::invalid_argument if the sizes do not match, for negative friction or fewer than three facets.
void checkSizes(const ContactProblem& problem);
bool isFinite(const ContactProblem& problem);
/// rho of contact i, trace(W_ii) / 3: the impulses of a contact times rho compare with its velocities [1/kg].
double impulseScale(const ContactProblem& problem, Eigen::Index i);
double meanScale(const ContactProblem& problem);  ///< over the contacts; 1 if that is 0 [1/kg]
/// w = W lambda + free; W being symmetric, one half of a large one is read.
/// @param shares  workspace
void contactVelocity(const ContactProblem& problem, const VecX& lambda, AlignedBuffer& shares, VecX& w);

/// The blocks of W where the given contacts' rows and columns cross, 3 rows x 3 columns, into `out`.
void gatherBlocks(const ContactProblem& problem, std::span<const int> rows, std::span<const int> columns,
                  Eigen::Ref<MatX> out);

/// Index in [0, facets).
inline int wrapped(int index, int facets) { return ((index % facets) + facets) % facets; }

}  // namespace palpate
