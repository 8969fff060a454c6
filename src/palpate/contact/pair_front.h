#pragma once

#include <cmath>
#include <limits>
#include <vector>

namespace palpate {

/// Where earlier searches among the same two surfaces, or within one, stopped to descend their trees: pairs of boxes
/// or of clusters whose triangles were apart, with the motion that it takes before they can meet, and those that met.
/// The next search goes on from there and looks only at what the surfaces' relative motion since then may have brought
/// together. It finds the same as one from the roots. The front of Li and Chen 1998 ("Incremental 3D collision
/// detection with hierarchical data structures"), with a bound of motion for each of its pairs.
class PairFront {
 public:
  /// Vertices of the two surfaces have moved relative to each other, from the start of the last search's motion to that
  /// of the next one, by at most `distance` [m]. A jump is a motion, too.
  void moved(double distance) {
    accumulated_motion_ += distance;
    if (!std::isfinite(accumulated_motion_)) forget();
  }
  /// There was a search, and what it left is kept.
  bool known() const { return roots_size_ > 0; }
  std::size_t size() const { return pairs_.size(); }
  /// Calls visit(node, node) for the pairs that may be within reach where the surfaces now start.
  /// @param moved  since the last search, as for moved() [m]
  template <class Visit>
  void nearPairs(double moved, Visit visit) const {
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      if (!staysApart(i, moved)) visit(pairs_[i].a, pairs_[i].b);
    }
  }
  /// The next search begins at the roots.
  void forget() {
    pairs_.clear();
    motion_limit_.clear();
    roots_size_ = 0;
    accumulated_motion_ = 0;
  }

 private:
  friend class SurfacePairFinder;
  struct NodePair {
    int a, b;  ///< nodes of the trees; a = -1: to be removed
  };

  /// Whether there is nothing to go on from, or a search from the roots would do with far fewer pairs.
  bool mustRestart(double reach) const { return roots_size_ == 0 || reach != reach_ || pairs_.size() > mostPairs(); }
  std::size_t mostPairs() const { return 2 * roots_size_ + 256; }
  /// From the roots; later searches find room for what they add.
  void beganWith(std::size_t pairs) {
    roots_size_ = pairs;
    pairs_.reserve(mostPairs());
    motion_limit_.reserve(mostPairs());
  }
  /// Adds a pair that is apart until it has moved by `gap` more [m].
  void addApart(NodePair pair, double gap) { add(pair, accumulated_motion_ + gap); }
  /// The same of pair i, which is there.
  void setApart(std::size_t i, double gap) { motion_limit_[i] = accumulated_motion_ + gap; }
  /// Adds a pair that the next search has to look at in any case.
  void addMeeting(NodePair pair) { add(pair, -std::numeric_limits<double>::infinity()); }
  /// Whether pair i stays apart in a search along a motion of `relative` [m].
  bool staysApart(std::size_t i, double relative) const { return accumulated_motion_ + relative < motion_limit_[i]; }
  void add(NodePair pair, double limit) {
    pairs_.push_back(pair);
    motion_limit_.push_back(limit);
  }
  void shorten(std::size_t size) {
    pairs_.resize(size);
    motion_limit_.resize(size);
  }
  void removeMarked() {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      if (pairs_[i].a < 0) continue;
      pairs_[kept] = pairs_[i];
      motion_limit_[kept++] = motion_limit_[i];
    }
    shorten(kept);
  }

  std::vector<NodePair> pairs_;
  std::vector<double> motion_limit_;  // apart as long as accumulated and present motion stay below it [m]
  double reach_ = 0;                  // of the searches [m]
  double accumulated_motion_ = 0;     // relative, since the front began [m]
  std::size_t roots_size_ = 0;        // pairs right after the search from the roots
};

}  // namespace palpate
