#pragma once

#include <algorithm>
#include <vector>

#include "palpate/common/parallel.h"
#include "palpate/contact/contact.h"
#include "palpate/simulation/body_system.h"

namespace palpate {

/// The bodies of a world that take a step; all others stand still meanwhile.
class MovingBodies {
 public:
  void clear() {
    systems_.clear();
    indices_.clear();
    slot_.clear();
  }
  /// @param index  in the world
  void add(int index, BodySystem& system) {
    if (static_cast<int>(slot_.size()) <= index) slot_.resize(static_cast<std::size_t>(index) + 1, -1);
    slot_[index] = size();
    indices_.push_back(index);
    systems_.push_back(&system);
  }
  int size() const { return static_cast<int>(systems_.size()); }
  bool empty() const { return systems_.empty(); }
  BodySystem& operator[](int slot) const { return *systems_[slot]; }
  int index(int slot) const { return indices_[slot]; }  ///< in the world, as contact points name the body
  const std::vector<int>& indices() const { return indices_; }
  /// Place of a point's body among these, or -1.
  int slot(const ContactPoint& point) const {
    return point.body >= 0 && point.body < static_cast<int>(slot_.size()) ? slot_[point.body] : -1;
  }

  /// Calls f(slot) for each of them: at the same time where they are of like size, one after the other where one is
  /// most of the work, so that its own loops are shared out.
  template <class F>
  void forEach(F&& f) const {
    parallelByWeight(
        size(), [&](int b) { return systems_[b]->model().nodes(); }, f);
  }

 private:
  std::vector<BodySystem*> systems_;
  std::vector<int> indices_;
  std::vector<int> slot_;  // of a body of the world, -1
};

}  // namespace palpate
