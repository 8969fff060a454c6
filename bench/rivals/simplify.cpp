// Simplifications of the scanned bunny: simplifySurface() and meshoptimizer. Writes a table.
#include <meshoptimizer.h>

#include <algorithm>
#include <cstdio>

#include "alternate.h"
#include "palpate/mesh/simplify_surface.h"
#include "palpate/mesh/surface_measures.h"
#include "palpate/mesh/surface_repair.h"
#include "shared/bunny.h"

namespace palpate::rivals {
namespace {

constexpr int kRounds = 3;
constexpr double kReach = 0.005;  // [m]
constexpr double kSize = 0.12;    // [m]

/// The bunny in the form that meshoptimizer takes.
class Optimizer {
 public:
  explicit Optimizer(const Surface& surface) : surface_(surface) {
    for (const Vec3& x : surface.vertices)
      for (int d = 0; d < 3; ++d) positions_.push_back(static_cast<float>(x[d]));
    for (const auto& t : surface.triangles)
      for (const int v : t) corners_.push_back(static_cast<unsigned>(v));
  }

  /// @param error  [m]
  Surface simplified(double error) const {
    std::vector<unsigned> left(corners_.size());
    const float scale = meshopt_simplifyScale(positions_.data(), surface_.vertices.size(), 3 * sizeof(float));
#if MESHOPTIMIZER_VERSION >= 180
    left.resize(meshopt_simplify(left.data(), corners_.data(), corners_.size(), positions_.data(),
                                 surface_.vertices.size(), 3 * sizeof(float), 0, static_cast<float>(error) / scale, 0,
                                 nullptr));
#else
    left.resize(meshopt_simplify(left.data(), corners_.data(), corners_.size(), positions_.data(),
                                 surface_.vertices.size(), 3 * sizeof(float), 0, static_cast<float>(error) / scale,
                                 nullptr));
#endif
    Surface out{surface_.vertices, {}};
    for (std::size_t i = 0; i + 2 < left.size(); i += 3)
      out.triangles.push_back(
          {static_cast<int>(left[i]), static_cast<int>(left[i + 1]), static_cast<int>(left[i + 2])});
    return repairSurface(out).surface;
  }

 private:
  const Surface& surface_;
  std::vector<float> positions_;
  std::vector<unsigned> corners_;
};

// Errors that are asked for, as shares of the tolerance.
std::vector<double> shares() {
  std::vector<double> out;
  for (double share = 1; share > 0.15; share *= 0.9) out.push_back(share);
  return out;
}

void compare(const Surface& bunny, double tolerance) {
  const Optimizer optimizer(bunny);
  SimplifiedSurface own;
  const double plain = farthestApart(bunny, optimizer.simplified(tolerance), kReach);
  int open = 0;
  Surface best = bunny;
  double best_error = 0;
  for (const double share : shares()) {
    Surface out = optimizer.simplified(share * tolerance);
    if (!inspectTopology(out).closed()) {
      ++open;
    } else if (out.triangles.size() < best.triangles.size() && farthestApart(bunny, out, kReach) <= tolerance) {
      best = std::move(out);
      best_error = share * tolerance;
    }
  }
  const std::vector<double> t = alternate(
      {{{}, [&] { own = simplifySurface(bunny, tolerance); }}, {{}, [&] { optimizer.simplified(best_error); }}},
      kRounds);
  std::printf("| %g | %zu | %.3f | %s | %zu | %s | %.3f | %d of %zu |\n", 1e3 * tolerance, own.surface.triangles.size(),
              1e3 * own.deviation, digits(1e3 * t[0]).c_str(), best.triangles.size(), against(t[1], t[0]).c_str(),
              1e3 * plain, open, shares().size());
  std::fflush(stdout);
}

}  // namespace
}  // namespace palpate::rivals

int main() {
  using namespace palpate;
  const Surface bunny = repairSurface(loadSolid(test::kBunnyFile, rivals::kSize)).surface;
  std::printf("The bunny, 12 cm, of %zu triangles; lengths in mm, times in ms (times ours).\n\n",
              bunny.triangles.size());
  std::printf(
      "| tolerance | ours: triangles | farthest | time | meshoptimizer: fewest triangles within it | time "
      "| farthest, if its error is the tolerance | not closed |\n|---|---|---|---|---|---|---|---|\n");
  for (const double tolerance : {5e-5, 1e-4, 2e-4, 4e-4}) rivals::compare(bunny, tolerance);
}
