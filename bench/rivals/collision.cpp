// Searches for contact of two spheres pressed flat against each other: SurfacePairFinder and FCL. Writes a table.
#include <algorithm>
#include <cstdio>

#include "alternate.h"
#include "fcl_pair.h"
#include "palpate/contact/surface_pairs.h"
#include "shared/count_allocations.h"
#include "shared/pressed_spheres.h"

namespace palpate::rivals {
namespace {

constexpr double kReach = 4e-4;  // [m]
constexpr int kRounds = 5;

Points points(const std::vector<Vec3>& vertices) {
  Points out;
  for (const Vec3& p : vertices) out.push_back({p[0], p[1], p[2]});
  return out;
}

int allocationsOf(const std::function<void()>& run) {
  test::allocations = 0;
  test::counting = true;
  run();
  test::counting = false;
  return test::allocations;
}

void compare(int triangles, const char* name, const Vec3& motion) {
  testing::PressedSpheres s = testing::pressedSpheres(triangles, motion);
  SurfacePairFinder finder;
  std::vector<FeaturePair> pairs;

  const Points left = points(s.left.start), right = points(s.right.start), left_end = points(s.left.end),
               right_end = points(s.right.end);
  FclPair fcl(left, right, s.left.triangles());
  fcl.place(left, right);
  FclPair::Found within, meeting;
  double nearest = 0;

  const auto refit = [&] {
    s.left.refit();
    s.right.refit();
  };
  const auto find = [&] {
    pairs.clear();
    finder.find(s.left, s.right, kReach, pairs);
  };
  const auto move_back = [&] { fcl.moveTo(left, right); };
  const auto move = [&] { fcl.moveTo(left_end, right_end); };
  const auto step = [&] {
    fcl.moveTo(left, right);
    fcl.moveTo(left_end, right_end);
  };
  const std::vector<double> t = alternate({{{},
                                            [&] {
                                              refit();
                                              find();
                                            }},
                                           {move_back, move},
                                           {{}, [&] { within = fcl.within(kReach); }},
                                           {{}, [&] { meeting = fcl.meeting(); }}},
                                          kRounds);
  // dearer than the square of the triangles: so not in turn with the others
  const double once = alternate({{{}, [&] { nearest = fcl.nearest(); }}}, 1)[0];
  const long hits = std::count_if(pairs.begin(), pairs.end(), [](const FeaturePair& p) { return p.hit; });
  double first = 1, least = 1;
  for (const FeaturePair& p : pairs) {
    if (p.hit) first = std::min(first, p.toi);
    least = std::min(least, p.start_distance);
  }
  std::printf("| %dk %s | %s | %zu, %ld | %s | %s | %ld | %s | %ld | %s | %s |\n", triangles / 1000, name,
              digits(1e3 * t[0]).c_str(), pairs.size(), hits, digits(1e3 * t[1]).c_str(), digits(1e3 * t[2]).c_str(),
              within.pairs, digits(1e3 * t[3]).c_str(), meeting.pairs, against(t[1] + t[2] + t[3], t[0]).c_str(),
              against(once, t[0]).c_str());
  std::fflush(stdout);
  const auto all = [&] {
    step();
    fcl.within(kReach);
    fcl.meeting();
  };
  const auto own = [&] {
    refit();
    find();
  };
  const int own_allocations = allocationsOf(own), fcl_allocations = allocationsOf(all);
  std::fprintf(stderr,
               "%d %s: first contact at %.4f (ours: a tenth of the reach before), FCL %.4f; least distance %.6g, FCL "
               "%.6g m; allocations %d, FCL %d\n",
               triangles, name, first, meeting.first, least, nearest, own_allocations, fcl_allocations);
  if (triangles == 5000) {
    const double start = processorTime(), time = fcl.firstTime({motion[0], motion[1], motion[2]});
    std::fprintf(stderr, "  FCL, whole surface moved, conservative advancement: first contact at %.4f in %.1f ms\n",
                 time, 1e3 * (processorTime() - start));
  }
}

}  // namespace
}  // namespace palpate::rivals

int main(int argc, char** argv) {
  using namespace palpate;
  const int most = argc > 1 ? std::atoi(argv[1]) : 70000;
  std::printf("Milliseconds (times ours), pairs found.\n\n");
  std::printf(
      "| Triangles, motion | ours | pairs, hits | FCL: refit | within reach | pairs | meeting | pairs | all three "
      "| nearest pair only |\n|---|---|---|---|---|---|---|---|---|---|\n");
  for (const int triangles : {5000, 20000, 70000}) {
    if (triangles > most) break;
    rivals::compare(triangles, "sliding", Vec3(-1e-4, 5e-4, 0));
    rivals::compare(triangles, "pressing", Vec3(-1e-3, 5e-4, 0));
  }
}
