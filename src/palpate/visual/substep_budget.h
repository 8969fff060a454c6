#pragma once

namespace palpate {

/// How many substeps fit a visual step, from the time that the last ones took.
class SubstepBudget {
 public:
  /// @param visual_step  [s]
  /// @param substeps     to begin with
  /// @param adapts       false: that number always
  SubstepBudget(double visual_step, int substeps, bool adapts)
      : visual_step_(visual_step), adapts_(adapts), substeps_(substeps) {}
  int substeps() const { return substeps_; }
  /// @param seconds  that a visual step with substeps() took, linearization included
  void took(double seconds);

 private:
  double visual_step_;
  bool adapts_;
  int substeps_;
};

}  // namespace palpate
