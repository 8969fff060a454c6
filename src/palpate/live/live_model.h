#pragma once

#include <array>
#include <cstdint>

#include "palpate/math/types.h"

namespace palpate {

/// A moment of the proxy's path. Ticks are counted, not timed: one that was missed is not part of the path.
struct PathPoint {
  std::int64_t index = 0;  ///< of the tick that begins there
  Pose pose;
  Vec6 twist = Vec6::Zero();  ///< [m/s; rad/s], world
};

/// Sizes of a live model: memory and work of a tick are bounded by them.
struct LiveSize {
  static constexpr int kToolModes = 16;
  static constexpr int kPartnerModes = 12;  ///< of all bodies that the tool touches
  static constexpr int kModes = kToolModes + kPartnerModes;
  static constexpr int kContacts = 16;
  static constexpr int kRows = 3 * kContacts;
  static constexpr int kSupports = kContacts / 2;             ///< of the contacts
  static constexpr int kSecond = 4;                           ///< modes with a second order
  static constexpr int kPairs = kSecond * (kSecond + 1) / 2;  ///< of those
  static constexpr int kUnknowns = 6 + kModes;
};

/// Matrices with as many rows and columns as are used, in place.
template <int kMaxRows, int kMaxColumns>
using BoundedMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxRows, kMaxColumns>;
template <int kMaxRows>
using BoundedVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxRows, 1>;
using ModalVector = BoundedVector<LiveSize::kModes>;
using RowVector = BoundedVector<LiveSize::kRows>;

/// What a contact of a live model is against; world frame.
struct LiveSurface {
  enum class Kind {
    plane,     ///< through `a` with `normal`; with `bend`, what is tangent to it there
    capsule,   ///< around the segment from a to b, a sphere where they are one
    internal,  ///< the tool itself: the normal is in the handle's frame, and the place is that of one side against the
               ///< other
    tied,      ///< the place `a` of another body, to which the tool is glued: three equalities, no cone
    support    ///< of a touched body against what it rests on: friction alone, as far as `load` bears it; the normal is
               ///< in the handle's frame
  };
  Kind kind = Kind::plane;
  Vec3 normal = Vec3::UnitZ();
  Vec3 a = Vec3::Zero(), b = Vec3::Zero();  ///< [m]
  double offset = 0;                        ///< taken off the distance: radius, and gap that is kept [m]
  /// Of a plane: at x the normal lies along normal + bend (x - a), until it has turned by kMostTurn [1/m]. Symmetric,
  /// bend normal = 0; positive where the obstacle is convex.
  Mat3 bend = Mat3::Zero();
  static constexpr double kMostTurn = 0.7;  ///< tangent of the angle
  double load = 0;                          ///< normal force of a support at the model's time [N]
  /// What is flat of a rigid tool at its place: a line, or two that span a face. The tool touches where they come
  /// nearest to what is round.
  struct Flat {
    Vec3 direction = Vec3::UnitX();  ///< unit, handle's frame
    double least = 0, greatest = 0;  ///< it reaches from there to there, from the place [m]
  };
  int flat_directions = 0;
  std::array<Flat, 2> flat{};
};

/// The tool, reduced, in the frame of its handle, about the handle's origin (docs/live.md): rigid inertia, the lowest
/// modes with the handle fixed, and contacts with the compliance that these leave out. Units: modes are
/// mass-normalized, z in kg^1/2 m.
struct LiveModel {
  std::int64_t index = -1;  ///< path index of its time; -1: no model
  double time = 0;          ///< [s]
  Pose pose;                ///< visual handle at that time
  Vec6 twist = Vec6::Zero();

  // handle and tool
  double mass = 0;              ///< [kg]
  Vec3 moment = Vec3::Zero();   ///< mass times center [kg m]
  Mat6 inertia = Mat6::Zero();  ///< Mb
  double alpha = 0, beta = 0;   ///< damping [1/s], [s]
  double elastic_energy = 0;    ///< at that time [J]

  /// Torque of contact at that time beyond that of the model's merged contacts; about the handle's origin [N m].
  Vec3 torque = Vec3::Zero();

  // modes: r entries each, the tool's first, then those of bodies that it touches, which have neither coupling nor spin
  int partner_modes = 0;          ///< of those
  ModalVector squared_frequency;  ///< w2 [1/s^2]
  ModalVector damping;            ///< alpha + beta w2, by the mode's own material [1/s]
  ModalVector force;              ///< f1, elastic and what merged contacts leave out; a partner's weight too
  ModalVector speed;              ///< z' at that time
  /// H, of the tool's modes: stiffness that stress adds to w2 or takes away [1/s^2]; w2 + H has no negative eigenvalue.
  BoundedMatrix<LiveSize::kToolModes, LiveSize::kToolModes> turning;
  BoundedMatrix<6, LiveSize::kModes> coupling;  ///< Mbz
  /// Q^T M (w x (w x y)) = centrifugal (wx wx, wy wy, wz wz, wx wy, wx wz, wy wz).
  BoundedMatrix<LiveSize::kModes, 6> centrifugal;
  /// Q^T M (e_k x Q), k = x, y, z: skew.
  std::array<BoundedMatrix<LiveSize::kModes, LiveSize::kModes>, 3> coriolis;
  /// sum of m y x (e_k x Q), 3 x r.
  std::array<BoundedMatrix<3, LiveSize::kModes>, 3> coriolis_torque;

  // contacts: m of them, three rows each
  int contacts = 0;
  RowVector arm;                                                    ///< rc [m]
  BoundedMatrix<LiveSize::kRows, LiveSize::kModes> shape;           ///< Qc
  BoundedMatrix<LiveSize::kRows, LiveSize::kRows> compliance;       ///< W [m/N]
  BoundedMatrix<LiveSize::kRows, LiveSize::kRows> tool_compliance;  ///< the tool's part of W
  RowVector damped_force, contact_force;                            ///< lb1, lambda1 [N]
  std::array<LiveSurface, LiveSize::kContacts> surface;
  std::array<double, LiveSize::kContacts> friction{};
  int facets = 0;  ///< of the friction cones, the first vertex along world x made tangent; 0: round, as for many
  static constexpr int kFacets = 16;  ///< at most
  bool partners_yield = false;        ///< W has more than the tool's part
  int supports = 0;                   ///< the last of the contacts
  /// What their loads gain by the contacts' forces beyond those at the model's time.
  BoundedMatrix<LiveSize::kSupports, LiveSize::kRows> bearing;

  // second order of the contacts' places: pairs (i, j), i <= j, of the lowest modes
  int second = 0;
  BoundedMatrix<LiveSize::kRows, LiveSize::kPairs> curvature;  ///< Pc

  int modes() const { return static_cast<int>(squared_frequency.size()); }
  int toolModes() const { return modes() - partner_modes; }
};

/// Where a live model is; all that it remembers.
struct LiveState {
  std::int64_t index = -1;  ///< path index
  ModalVector z, speed;
  RowVector damped_force, contact_force;
};

/// A model on its way to the haptic loop, replayed along the path as far as that was known.
struct LiveUpdate {
  LiveModel model;
  LiveState state;
};

/// At the model's time.
LiveState startState(const LiveModel& model) noexcept;
/// True where every number is finite.
bool isFinite(const LiveModel& model) noexcept;
bool isFinite(const LiveState& state) noexcept;

}  // namespace palpate
