#pragma once

#include <optional>
#include <vector>

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

}  // namespace palpate
