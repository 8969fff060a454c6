#pragma once

#include <cmath>
#include <limits>
#include <vector>

namespace palpate {

/// Where earlier searches among the same two surfaces, or within one, stopped to descend their trees: pairs of boxes
/// or of clusters whose triangles were apart, with the motion that it takes before they can meet, and those that met.
/// The next search goes on from there and looks only at what the surfaces' relative motion since then may have brought
/// together. It finds the same as one from the roots.
class PairFront {
 public:
  /// Vertices of the two surfaces have moved relative to each other, from the start of the last search's motion to that
  /// of the next one, by at most `distance` [m].
  void moved(double distance) {
    odometer_ += distance;
    if (!std::isfinite(odometer_)) forget();
  }
  /// The next search begins at the roots.
  void forget() {
    pairs_.clear();
    until_.clear();
    roots_size_ = 0;
    odometer_ = 0;
  }

 private:
  friend class SurfacePairFinder;
  struct NodePair {
    int a, b;  ///< nodes of the trees; a = -1: to be removed
  };
  static constexpr double kAlways = -std::numeric_limits<double>::infinity();

  /// Whether there is nothing to go on from, or a search from the roots would do with far fewer pairs.
  bool worn(double reach) const { return roots_size_ == 0 || reach != reach_ || pairs_.size() > 2 * roots_size_ + 256; }
  void add(NodePair pair, double until) {
    pairs_.push_back(pair);
    until_.push_back(until);
  }
  void removeMarked() {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      if (pairs_[i].a < 0) continue;
      pairs_[kept] = pairs_[i];
      until_[kept++] = until_[i];
    }
    pairs_.resize(kept);
    until_.resize(kept);
  }

  std::vector<NodePair> pairs_;
  std::vector<double> until_;   // apart as long as odometer and present motion stay below it [m]
  double reach_ = 0;            // of the searches [m]
  double odometer_ = 0;         // relative motion since the front began [m]
  std::size_t roots_size_ = 0;  // pairs right after the search from the roots
};

}  // namespace palpate
