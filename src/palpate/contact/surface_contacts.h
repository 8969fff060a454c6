#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include "palpate/contact/collision_surface.h"
#include "palpate/contact/contact.h"
#include "palpate/contact/contact_settings.h"
#include "palpate/contact/friction_table.h"
#include "palpate/contact/overlap.h"
#include "palpate/contact/pair_exclusion.h"
#include "palpate/contact/surface_pairs.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// What the next step's contacts between surfaces depend on beside the positions of their nodes. All else that
/// SurfaceContacts keeps from step to step only saves time: without it the results have the same bits.
struct SurfaceContactsState {
  /// One a pair of surfaces: 0 where they were seen apart, since when contact keeps them so; overlap is not looked for.
  std::vector<char> may_overlap;
  /// One a surface: 1 where it was last seen to pass through itself.
  std::vector<char> tangled;
  bool operator==(const SurfaceContactsState&) const = default;
};

/// The vertex, edge or face of a surface that a contact is with; at the start of the step.
struct SurfaceFeature {
  const CollisionSurface* surface = nullptr;  ///< null: none, as of a plane
  std::vector<int> triangles;                 ///< that it belongs to
  std::vector<Vec3> corners;                  ///< one, two or three [m]
  Vec3 middle() const {
    Vec3 sum = Vec3::Zero();
    for (const Vec3& x : corners) sum += x;
    return sum / static_cast<double>(corners.size());
  }
  Vec3 nearestTo(const Vec3& point) const;
};

/// Two surfaces that start inside each other.
struct SurfaceOverlap {
  std::array<int, 2> body{-1, -1};      ///< -1: fixed
  std::array<int, 2> obstacle{-1, -1};  ///< of what is fixed
  double depth = 0;                     ///< the deepest point's [m]
};

/// Contact between triangle surfaces: of bodies, soft and rigid, with each other, with themselves, with fixed ones.
/// Vertex against face and edge against edge, by distance and along the whole motion of a step (docs/contact.md).
class SurfaceContacts {
 public:
  /// Surface of a body; its vertices follow the mesh's nodes.
  /// @param self  whether it touches itself
  void addBody(int body, const SimulationMesh& mesh, bool self);
  /// Fixed surface, in world coordinates.
  void addObstacle(int obstacle, const Surface& surface);
  /// Two bodies whose surfaces do not touch at some place: features around marked vertices of the first, and what is
  /// as near as that to these on the second where both now start.
  /// @param marks  of each vertex of the first body's surface
  /// @param near   [m]
  /// @returns whether the two lie inside each other beyond that: then they do not touch at all
  bool leaveOut(int first, const std::vector<char>& marks, int second, double near);
  /// What is left out between two bodies, of which the first was added before the second; null: nothing.
  const PairExclusion* leftOut(int first, int second) const;
  /// Whether there is anything to find.
  bool active() const;

  /// Node positions at the start of the step, and at the end that is to be examined; start must come first.
  void setStart(int body, const VecX& x);
  void setEnd(int body, const VecX& x);
  /// Before the first find() of a step: looks for surfaces that start inside each other, among pairs that may; and,
  /// after trouble, where tetrahedra are turned over, or as long as there are some, for places where a surface passes
  /// through itself. Contact there, and of what is inside out with what is near, would keep it so: it is left out until
  /// elasticity has pulled it apart.
  /// @param trouble  the steps before could not keep what they should
  void examineOverlaps(bool trouble);
  /// Pairs that were seen apart are examined for overlap again, and surfaces for passing through themselves (after
  /// positions were set from outside).
  void recheckOverlaps();

  /// Between two steps. restore() is cheap, and setStart() then takes any positions: fronts of earlier searches stay.
  SurfaceContactsState state() const;
  /// @param state  of an object with the same surfaces, added in the same order
  /// Throws std::invalid_argument if it has another number of surfaces.
  void restore(const SurfaceContactsState& state);

  /// Candidates along the motion from the present start to the present end; appends.
  /// @param body  of this one only; -1: of all
  void find(const ContactSettings& settings, const FrictionTable& friction, std::vector<Contact>& out, int body = -1);
  /// Of searches from now on: see PairSettings.
  void setAsNow(bool on) {
    forFinders([on](SurfacePairFinder& f) { f.setAsNow(on); });
  }
  void setAhead(bool on) {
    forFinders([on](SurfacePairFinder& f) { f.setAhead(on); });
  }
  static constexpr double kOperations = 2e4;  ///< of a search, for a pair of clusters that meet
  /// What searches from now on may cost together, and what they did [floating-point operations, about].
  void allow(double operations) {
    allowed_ = operations / kOperations;
    tested_ = 0;
    gave_up_ = false;
  }
  double operations() const { return kOperations * tested_; }
  /// A search was given up since allow(): what it found is not complete.
  bool gaveUp() const { return gave_up_; }
  /// Those pairs, as examineOverlaps() found them.
  std::vector<SurfaceOverlap> overlaps() const;
  /// Points of surfaces that start inside each other, as examineOverlaps() found them; appends.
  void findOverlapping(const ContactSettings& settings, const FrictionTable& friction, std::vector<Contact>& out);
  /// The same features as in an earlier step, where they now are, if they are within reach; appends. Which of the pairs
  /// around a place is nearest changes from step to step; keeping those that carried force keeps the force steady.
  void follow(const Contact& earlier, const ContactSettings& settings, const FrictionTable& friction,
              std::vector<Contact>& out);
  /// Whether those features still are where the surfaces are nearest to each other. What slides along the other leaves
  /// that place, and the line between the features then leans over.
  bool isNearest(const Contact& earlier, const ContactSettings& settings);
  /// An earlier contact that is no longer where the surfaces are nearest. Where one of them still faces along its
  /// normal beside the other's point, it is that of before, at gap 0. Else one surface has slid off what it was on: the
  /// point of this body, of the first where both are of it, is then against the nearest place of the other surface,
  /// with the gap there, which may be wide. After setStart().
  void renew(int body, Contact& contact) const;
  /// Which obstacle a surface is; -1: a body's.
  int obstacleOf(int surface) const { return items_[static_cast<std::size_t>(surface)].obstacle; }
  /// Its feature on a body's surface, or on the obstacle's (body: -1); none of what touches itself.
  SurfaceFeature featureOn(int body, const Contact& contact) const;
  /// Deepest overlap at the start [m], 0: none.
  double overlap() const { return overlap_; }

 private:
  struct Item {
    int body = -1;  // -1: fixed
    int obstacle = -1;
    bool self = false;
    CollisionSurface surface;
    SelfExclusion exclusion;
    bool tangled = false;
    bool tangle_known = false;  // as of the present start
    std::vector<char> crossed;  // vertices of triangles that pass through each other, while it is tangled
    std::vector<std::array<int, 4>> tetrahedra;  // of what touches itself
    std::vector<int> patch;                      // of each vertex: what moves affinely
    double extension = 1;                        // largest sum of a vertex's absolute weights
    VecX rest;                                   // node positions, as built
    VecX start, end;                             // node positions
    bool start_known = false;                    // to the surface: where the nodes start
    bool end_placed = true;                      // the surface's end is that of the nodes
    bool end_bounded = false;                    // and so are its bounds
    bool stale = false;                          // boxes are older than positions
    MotionBounds moved;                          // of the starts, since the last search
    PairFront front;                             // of self-contact
    std::vector<FeaturePair> found;              // the same, in the present search
    /// Whether it is the body's; -1: any's.
    bool isOf(int any_or_body) const { return any_or_body < 0 || any_or_body == body; }
  };
  struct PairState {
    bool may_overlap = true;
    std::vector<OverlapPoint> points;
    PairFront front;
    PairExclusion left_out;
    const PairExclusion* leftOut() const { return left_out.first.empty() ? nullptr : &left_out; }
  };
  PairState& pair(std::size_t a, std::size_t b) { return pairs_[b * (b - 1) / 2 + a]; }
  const PairState& pair(std::size_t a, std::size_t b) const { return pairs_[b * (b - 1) / 2 + a]; }
  std::size_t itemOf(int body) const;
  static int id(const Item& item);
  static void place(const Item& item, const std::array<int, 3>& vertices);
  static MotionBounds motionOf(const Item& item, const VecX& from, const VecX& to);
  static void moveEnd(Item& item, const VecX& x);
  static void refit(Item& item);
  static int patch(const Item& item, int vertex);
  SurfaceFeature featureAt(const Contact& contact, bool second) const;
  bool slidesOff(Contact& contact) const;
  static FeaturePair pairAtStart(const ContactFeatures& features, const Item& item_a, const Item& item_b);
  static bool facesOutward(const Item& a, const Item& b, const FeaturePair& pair);
  static ContactPoint point(const Item& item, const std::array<int, 3>& vertex, const std::array<double, 3>& weight);
  static double shareOfShift(const Item& item, const int* node, const std::array<Vec3, 4>& x,
                             const std::array<Vec3, 4>& gradient, const Vec3& offset);
  static void shift(const Item& item, int vertex, const Vec3& offset, ContactPoint& point);
  // Surfaces whose self-contact is searched one after the other; those of different groups at the same time.
  struct SelfGroup {
    SurfacePairFinder finder;
    std::vector<std::size_t> items;
  };
  static constexpr std::size_t kMostGroups = 4;
  void groupSelves();
  void searchSelves(double reach, int body);
  void account(const SurfacePairFinder& finder);
  template <class F>
  void forFinders(F f) {
    f(finder_);
    for (SelfGroup& group : groups_) f(group.finder);
  }
  void addSelf(std::size_t i, const ContactSettings& settings, const FrictionTable& friction,
               std::vector<Contact>& out);
  void findPair(std::size_t first, std::size_t second, PairState& state, const ContactSettings& settings,
                const FrictionTable& friction, std::vector<Contact>& out);
  void add(std::size_t ia, std::size_t ib, const FeaturePair& pair, const ContactSettings& settings, double mu,
           bool overlapping, std::vector<Contact>& out);
  void keepDependable(std::vector<FeaturePair>& found) const;
  void findTangle(Item& item);
  static bool inTangle(const Item& item, const FeaturePair& pair);
  void addOverlap(std::size_t ia, std::size_t ib, const OverlapPoint& overlap, const ContactSettings& settings,
                  double mu, std::vector<Contact>& out);

  std::vector<Item> items_;
  std::vector<PairState> pairs_;
  std::array<SelfGroup, kMostGroups> groups_;
  SurfacePairFinder finder_;                                               // between two surfaces
  double allowed_ = std::numeric_limits<double>::infinity(), tested_ = 0;  // pairs of clusters that meet
  bool gave_up_ = false;
  std::vector<FeaturePair> found_;
  std::vector<std::array<int, 2>> crossings_;
  double overlap_ = 0;
};

}  // namespace palpate
