#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/contact/collision_surface.h"
#include "palpate/contact/contact.h"
#include "palpate/contact/contact_settings.h"
#include "palpate/contact/overlap.h"
#include "palpate/contact/surface_pairs.h"
#include "palpate/mesh/types.h"

namespace palpate {

/// Coulomb coefficients: of a pair where it is given, else of the obstacle, else the geometric mean of both bodies'
/// own. Bodies count from 0; obstacle i is -1 - i.
class FrictionTable {
 public:
  void setBody(int body, double coefficient);
  void setObstacle(int obstacle, std::optional<double> coefficient);
  void setPair(int first, int second, double coefficient);
  /// Multiplies all coefficients; 1 at first.
  void setScale(double scale) { scale_ = scale; }
  double operator()(int first, int second) const;
  static int obstacle(int index) { return -1 - index; }

 private:
  struct Pair {
    int low, high;
    double coefficient;
  };
  double scale_ = 1.0;
  std::vector<double> bodies_;
  std::vector<std::optional<double>> obstacles_;
  std::vector<Pair> pairs_;
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
  /// Whether there is anything to find.
  bool active() const;

  /// Node positions at the start of the step, and at the end that is to be examined; start must come first.
  void setStart(int body, const VecX& x);
  void setEnd(int body, const VecX& x);
  /// Before the first find() of a step: looks for surfaces that start inside each other, among pairs that may.
  void examineOverlaps();
  /// Every pair is examined anew in the next steps (after a state was set from outside).
  void distrust();

  /// Candidates along the motion from the present start to the present end; appends.
  void find(const ContactSettings& settings, const FrictionTable& friction, std::vector<Contact>& out);
  /// Points of surfaces that start inside each other, as examineOverlaps() found them; appends.
  void findOverlapping(const ContactSettings& settings, const FrictionTable& friction, std::vector<Contact>& out);
  /// The same features as in an earlier step, where they now are, if they are within reach; appends. Which of the pairs
  /// around a place is nearest changes from step to step; keeping those that carried force keeps the force steady.
  void follow(const Contact& earlier, const ContactSettings& settings, const FrictionTable& friction,
              std::vector<Contact>& out);
  /// Deepest overlap at the start [m], 0: none.
  double overlap() const { return overlap_; }

 private:
  struct Item {
    int body = -1;  // -1: fixed
    int obstacle = -1;
    bool self = false;
    CollisionSurface surface;
    SelfExclusion exclusion;
    std::vector<std::array<int, 4>> nodes;  // of each vertex
    std::vector<std::array<double, 4>> weights;
    std::vector<int> patch;    // of each vertex: what moves affinely
    double leverage = 1;       // largest sum of a vertex's absolute weights
    VecX start, end;           // node positions
    bool end_placed = true;    // the surface's end is that of the nodes
    bool end_bounded = false;  // and so are its bounds
    bool stale = false;        // boxes are older than positions
    MotionBounds moved;        // of the starts, since the last search
    PairFront front;           // of self-contact
  };
  struct PairState {
    bool suspect = true;  // may overlap
    std::vector<OverlapPoint> points;
    PairFront front;
  };
  using Corners = std::vector<Eigen::Vector4d, Eigen::aligned_allocator<Eigen::Vector4d>>;
  PairState& pair(std::size_t a, std::size_t b) { return pairs_[b * (b - 1) / 2 + a]; }
  static int id(const Item& item);
  template <class Put>
  void place(const Item& item, const VecX& x, Put put);
  static void placeEnd(Item& item, const std::array<int, 3>& vertices);
  static MotionBounds motionOf(const Item& item, const VecX& from, const VecX& to);
  void refit(Item& item);
  static int patch(const Item& item, int vertex);
  static bool facesOutward(const Item& a, const Item& b, const FeaturePair& pair);
  static ContactPoint point(const Item& item, const std::array<int, 3>& vertex, const std::array<double, 3>& weight);
  static void shift(const Item& item, int vertex, const Vec3& offset, ContactPoint& point);
  void add(std::size_t ia, std::size_t ib, const FeaturePair& pair, const ContactSettings& settings, double mu,
           bool overlapping, std::vector<Contact>& out);
  void keepDependable();
  void addOverlap(std::size_t ia, std::size_t ib, const OverlapPoint& overlap, const ContactSettings& settings,
                  double mu, std::vector<Contact>& out);

  std::vector<Item> items_;
  std::vector<PairState> pairs_;
  SurfacePairFinder finder_;
  std::vector<FeaturePair> found_;
  Corners nodes_;  // padded, while vertices are placed
  double overlap_ = 0;
};

}  // namespace palpate
