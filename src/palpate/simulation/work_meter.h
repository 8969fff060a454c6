#pragma once

#include <algorithm>
#include <chrono>
#include <limits>

namespace palpate {

/// What a visual step may cost. When it is used up, the step ends with the best that it has. Counted, so that runs stay
/// the same to the bit; or by the clock, where a hand waits.
struct StepBudget {
  double operations = std::numeric_limits<double>::infinity();  ///< floating-point; a core does some 1e10 a second
  double seconds = std::numeric_limits<double>::infinity();     ///< wall-clock time
  static constexpr double kOperationsPerSecond = 1e10;
  /// As many operations as take about that long [s].
  static StepBudget counted(double seconds) {
    return {kOperationsPerSecond * seconds, std::numeric_limits<double>::infinity()};
  }
};

/// What a visual step has cost so far.
class WorkMeter {
 public:
  void start(const StepBudget& budget) {
    budget_ = budget;
    spent_ = apart_ = 0;
    if (timed()) begin_ = Clock::now();
  }
  /// Whether the clock counts as well.
  bool timed() const { return budget_.seconds < std::numeric_limits<double>::infinity(); }
  void spend(double operations) {
    spent_ += operations;
    apart_ += operations;
  }
  /// Searches know from those before them where they need not look: what they cost is not known from the state.
  void spendSearching(double operations) { spent_ += operations; }
  double spent() const { return spent_; }
  double spentButForSearching() const { return apart_; }
  /// Operations that are left; a clock's time counts as those that fit into it.
  double left() const {
    double left = budget_.operations - spent_;
    if (timed()) {
      const double elapsed = std::chrono::duration<double>(Clock::now() - begin_).count();
      left = std::min(left, StepBudget::kOperationsPerSecond * (budget_.seconds - elapsed));
    }
    return std::max(left, 0.0);
  }
  /// The budget [operations].
  double whole() const { return std::min(budget_.operations, StepBudget::kOperationsPerSecond * budget_.seconds); }
  bool usedUp() const { return left() <= 0; }

 private:
  using Clock = std::chrono::steady_clock;

  StepBudget budget_;
  double spent_ = 0, apart_ = 0;
  Clock::time_point begin_;
};

/// What looking for contacts and solving them may cost in one try of a part of a step: a share of the budget where it
/// need not succeed; where it must, enough to come to an end that can be used, whatever is left.
class WorkShare {
 public:
  /// @param share    of the budget; 0: of a try that must succeed
  /// @param calm   what a try costs in which nothing happens: it is allowed in any case, as otherwise a scene that is
  ///               large, but not hard, or steps that are short, would never get through
  WorkShare(const WorkMeter& meter, double share, double calm)
      : meter_(&meter), before_(meter.spent()), allowed_(kLast) {
    if (share > 0) allowed_ = std::max(std::min(share * meter.whole(), kMostOfTry), calm);
  }
  double left() const { return allowed_ - (meter_->spent() - before_); }

 private:
  static constexpr double kMostOfTry = 1e10, kLast = 1e9;  // operations
  const WorkMeter* meter_;
  double before_, allowed_;
};

}  // namespace palpate
