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
constexpr int kRounds = 7;

Points points(const std::vector<Vec3>& vertices) {
  Points out;
  for (const Vec3& p : vertices) out.push_back({p[0], p[1], p[2]});
  return out;
}

int allocationsOf(const std::function<void()>& run) {
  allocations = 0;
  counting = true;
  run();
  counting = false;
  return allocations;
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
  double nearest = 0, advanced = 1;

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
  const std::vector<double> t = alternate({{{}, refit},
                                           {refit, find},
                                           {move_back, move},
                                           {{}, [&] { within = fcl.within(kReach); }},
                                           {{}, [&] { meeting = fcl.meeting(); }},
                                           {{}, [&] { fcl.place(left, right); }},
                                           {{}, [&] { nearest = fcl.nearest(); }},
                                           {{},
                                            [&] {
                                              advanced = fcl.firstTime({motion[0], motion[1], motion[2]});
                                            }}},
                                          kRounds);
  const long hits = std::count_if(pairs.begin(), pairs.end(), [](const FeaturePair& p) { return p.hit; });
  double first = 1, least = 1;
  for (const FeaturePair& p : pairs) {
    if (p.hit) first = std::min(first, p.toi);
    least = std::min(least, p.start_distance);
  }
  std::printf("| %dk %s | %s | %s | %zu, %ld | %s | %s | %ld | %s | %ld | %s | %s |\n", triangles / 1000, name,
              digits(1e3 * t[0]).c_str(), digits(1e3 * t[1]).c_str(), pairs.size(), hits, against(t[2], t[0]).c_str(),
              against(t[3], t[1]).c_str(), within.pairs, against(t[4], t[1]).c_str(), meeting.pairs,
              against(t[6], t[1]).c_str(), against(t[7], t[1]).c_str());
  std::fprintf(
      stderr,
      "%d %s: first time %.4f, FCL %.4f, whole surfaces %.4f; least distance %.4g, FCL %.4g m; FCL's refit of "
      "oriented boxes %.2f ms; allocations: refit and find %d, FCL's refit %d, within %d, meeting %d, nearest %d\n",
      triangles, name, first, meeting.first, advanced, least, nearest, 1e3 * t[5], allocationsOf([&] {
        refit();
        find();
      }),
      allocationsOf(step), allocationsOf([&] { fcl.within(kReach); }), allocationsOf([&] { fcl.meeting(); }),
      allocationsOf([&] { fcl.nearest(); }));
}

}  // namespace
}  // namespace palpate::rivals

int main() {
  using namespace palpate;
  std::printf("Milliseconds (times ours), pairs found.\n\n");
  std::printf(
      "| Triangles, motion | refit | find | pairs, hits | FCL: refit | all within reach | pairs | all meeting | "
      "pairs | nearest pair | first time, rigid |\n|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const int triangles : {5000, 20000, 70000}) {
    rivals::compare(triangles, "sliding", Vec3(-1e-4, 5e-4, 0));
    rivals::compare(triangles, "pressing", Vec3(-1e-3, 5e-4, 0));
  }
}
