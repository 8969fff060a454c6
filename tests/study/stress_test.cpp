// What palpate stress looks for is found where it was made by hand; its hands keep their bounds.
#include "palpate/study/stress.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "palpate/math/rotation.h"
#include "palpate/mesh/shapes.h"
#include "palpate/scene/reader.h"
#include "palpate/study/examiner.h"
#include "palpate/study/freeze_watch.h"
#include "shared/held_scenes.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kStep = 0.033;

// --- the examiner

// A box and a slender one that ends at `tip` inside or above it, as one surface.
Surface boxAndPin(double tip) {
  Surface out = boxSurface(Vec3(2, 2, 2));  // up to z = 1
  const Surface pin = boxSurface(Vec3(0.2, 0.3, 1));
  const int first = static_cast<int>(out.vertices.size());
  for (const Vec3& p : pin.vertices) out.vertices.push_back(p + Vec3(0.31, 0.27, tip + 0.5));
  for (const auto& t : pin.triangles) out.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  return out;
}

TEST(SelfIntersections, AreFoundWherePartsPass) {
  std::vector<std::array<int, 2>> pairs;
  findSelfIntersections(CollisionSurface(boxAndPin(1.1)), pairs);
  EXPECT_TRUE(pairs.empty());
  findSelfIntersections(CollisionSurface(boxAndPin(0.6)), pairs);
  ASSERT_FALSE(pairs.empty());
  for (const auto& [box, pin] : pairs) {  // each of the box's top with one of the pin's sides
    EXPECT_LT(box, 12);
    EXPECT_GE(pin, 12);
  }
  EXPECT_GE(pairs.size(), 8u);  // one for each triangle around the pin at least
}

TEST(SelfIntersections, AgreeWithEachPairByItself) {
  // a ball whose top hangs through its bottom
  Surface ball = sphereSurface(1, 2);
  for (Vec3& p : ball.vertices) {
    if (p.z() > 0.5) p.z() -= 4.2 * (p.z() - 0.5);
  }
  std::vector<std::array<int, 2>> pairs;
  findSelfIntersections(CollisionSurface(ball), pairs);
  std::sort(pairs.begin(), pairs.end());
  std::vector<std::array<int, 2>> expected;  // a triangle at a time against each of the rest, in trees of two
  for (int t = 0; t < static_cast<int>(ball.triangles.size()); ++t) {
    for (int u = t + 1; u < static_cast<int>(ball.triangles.size()); ++u) {
      Surface two;
      for (const int of : {t, u})
        for (const int v : ball.triangles[of]) two.vertices.push_back(ball.vertices[v]);
      two.triangles = {{0, 1, 2}, {3, 4, 5}};
      const auto& p = ball.triangles[t];
      const auto& q = ball.triangles[u];
      const bool shared =
          std::any_of(p.begin(), p.end(), [&](int v) { return std::find(q.begin(), q.end(), v) != q.end(); });
      // far apart: not worth a tree
      if (shared || (two.vertices[0] - two.vertices[3]).norm() > 1.2) continue;
      std::vector<std::array<int, 2>> one;
      findSelfIntersections(CollisionSurface(two), one);
      if (!one.empty()) expected.push_back({t, u});
    }
  }
  EXPECT_GT(pairs.size(), 10u);
  EXPECT_EQ(pairs, expected);
}

TEST(SelfIntersections, LeaveOutWhatIsExcluded) {
  Surface ball = sphereSurface(1, 3);
  for (Vec3& p : ball.vertices) {
    if (p.z() > 0.5) p.z() -= 4.2 * (p.z() - 0.5);
  }
  // groups of a few vertices; one pair of them in twelve is excluded
  const int count = static_cast<int>(ball.vertices.size()), groups = (count + 3) / 4;
  std::vector<int> group, offset{0}, neighbor;
  for (int v = 0; v < count; ++v) group.push_back(v / 4);
  for (int g = 0; g < groups; ++g) {
    for (int h = 0; h < groups; ++h) {
      if ((g + h) % 12 == 0) neighbor.push_back(h);
    }
    offset.push_back(static_cast<int>(neighbor.size()));
  }
  std::vector<int> clusters;  // small ones, some of which are excluded as wholes
  for (const auto& t : ball.triangles) clusters.push_back(group[static_cast<std::size_t>(t[0])]);
  const CollisionSurface surface(ball, clusters);
  const SelfExclusion exclusion(surface, group, offset, neighbor);
  std::vector<std::array<int, 2>> all, left;
  findSelfIntersections(surface, all);
  findSelfIntersections(surface, left, &exclusion);
  EXPECT_LT(left.size(), all.size());
  EXPECT_FALSE(left.empty());
  std::erase_if(all, [&](const auto& pair) {
    return exclusion.excludes(surface.triangles()[static_cast<std::size_t>(pair[0])],
                              surface.triangles()[static_cast<std::size_t>(pair[1])]);
  });
  std::sort(all.begin(), all.end());
  std::sort(left.begin(), left.end());
  EXPECT_EQ(left, all);
}

TEST(SelfIntersections, AreNotFoundInFlatFacesOrAtRest) {
  std::vector<std::array<int, 2>> pairs;
  Surface box = boxSurface(Vec3(0.06, 0.04, 0.03), {9, 7, 5});
  const Quat turn = expRotation({0.3, -0.2, 0.1});
  for (Vec3& p : box.vertices) p = turn * p;
  findSelfIntersections(CollisionSurface(box), pairs);
  findSelfIntersections(CollisionSurface(sphereSurface(0.1)), pairs);
  EXPECT_TRUE(pairs.empty());
}

World heldBar() {
  World world;
  BodyModel body = bar({3, 2, 2}, {});
  holdNodes(body, onTop);
  world.add(std::move(body));
  return world;
}

TEST(Examiner, CountsInvertedTetrahedraAndIntersectionsOfABody) {
  World world = heldBar();
  Examiner examiner(world, 1e-5);
  Examination seen = examiner.examine(world);
  EXPECT_EQ(seen.inverted, 0);
  EXPECT_EQ(seen.self_intersections, 0);
  // a corner of the bottom, pulled through the opposite side
  BodyState state = world.tool().state;
  state.positions.segment<3>(0) = Vec3(0.09, 0.031, 0.012);
  world.setBody(0, state);
  seen = examiner.examine(world);
  EXPECT_GT(seen.inverted, 0);
  EXPECT_GT(seen.self_intersections, 0);
  EXPECT_GT(seen.passed, 0);
  EXPECT_EQ(Examiner(world, 1e-5).examine(world).self_intersections, 0);  // had it been built so
  EXPECT_EQ(Examiner(heldBar(), 1e-5, {0}).examine(world).self_intersections, 0);
  state.positions[4] = std::nan("");
  world.setBody(0, state);
  EXPECT_FALSE(examiner.examine(world).finite);
}

TEST(Examiner, OneTetrahedronTurnedOver) {
  TetrahedralMesh mesh{{Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)}, {{0, 1, 2, 3}}};
  VecX x(12);
  x << 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1;
  EXPECT_EQ(invertedTetrahedra(mesh, x), 0);
  x[11] = -0.1;
  EXPECT_EQ(invertedTetrahedra(mesh, x), 1);
  x[11] = 0;
  EXPECT_EQ(invertedTetrahedra(mesh, x), 1);
}

TEST(Examiner, SeesABodyBelowThePlane) {
  World world = heldBar();
  world.obstacles = {ground()};
  Examiner examiner(world, 1e-4);
  EXPECT_EQ(examiner.examine(world).wrong_side, 0);
  HandleState handle = world.tool().state.handle;
  handle.pose.position.z() -= 0.5 * kBarSize.z();
  world.setHandle(0, handle);
  const Examination seen = examiner.examine(world);
  EXPECT_EQ(seen.depth, 0.0);  // only the top has moved
  BodyState state = world.tool().state;
  state.positions[2] = -0.002;
  world.setBody(0, state);
  EXPECT_NEAR(examiner.examine(world).depth, 0.002, 1e-12);
  EXPECT_EQ(examiner.examine(world).wrong_side, 1);
}

// --- frozen bodies

constexpr int kFrozenSteps = 10;  // 0.3 s

TEST(FreezeWatch, ABodyThatIsStoppedEachTimeIsFrozen) {
  World world = heldBar();
  const Pose start = world.tool().state.handle.pose;
  FreezeWatch watch(world, start, kStep);
  BodyState state = world.tool().state;
  for (int n = 0; n < 30; ++n) EXPECT_EQ(watch.after(world, start, false, false), 0);  // at rest, and not moved
  state.velocities[0] = 0.01;
  world.setBody(0, state);
  for (int n = 1; n < 30; ++n) EXPECT_EQ(watch.after(world, start, true, true), n >= kFrozenSteps ? 1 : 0) << n;
  state.positions[0] += 1e-5;
  world.setBody(0, state);
  EXPECT_EQ(watch.after(world, start, true, true), 0);
}

TEST(FreezeWatch, AToolThatDoesNotFollowTheDeviceIsFrozen) {
  World world = heldBar();
  const Pose start = world.tool().state.handle.pose;
  const auto frozen = [&](double moved, double per_step, bool touches) {
    FreezeWatch watch(world, start, kStep);
    int last = 0;
    for (int n = 0; n <= 30; ++n) {
      const double x = moved + n * per_step;
      last = watch.after(world, {start.position + Vec3(x, 0, 0), start.rotation}, touches, false);
    }
    return last;
  };
  EXPECT_EQ(frozen(0, 0, false), 0);
  EXPECT_EQ(frozen(0.02, 0, false), 1);   // pulled by the link, by nothing else, and still
  EXPECT_EQ(frozen(0.02, 0, true), 0);    // it may be held: a static balance
  EXPECT_EQ(frozen(0, 0.001, true), 1);   // but not while the device moves on
  EXPECT_EQ(frozen(0, 0.0001, true), 0);  // unless it hardly does
  world.link.peak_force = 0.01 * world.link.stiffness;
  EXPECT_EQ(frozen(0, 0.001, true), 0);   // or the link pulls with all it has, all the time
  EXPECT_EQ(frozen(0, 0.001, false), 1);  // which something must resist
}

// --- hands

StressMotion motionWithin(double reach) {
  StressMotion out;
  out.reach = reach;
  return out;
}

TEST(Ride, KeepsItsBoundsAndComesHome) {
  const Pose start{Vec3(0.1, -0.2, 0.3), expRotation({0.3, 0.2, -0.5})};
  for (const double reach : {0.04, 0.3}) {
    const StressMotion motion = motionWithin(reach);
    double fastest = 0, fastest_turn = 0, farthest = 0, farthest_turn = 0;
    for (std::uint64_t seed = 1; seed <= 8; ++seed) {
      const StressBout ride = rideOf(start, motion, seed);
      const std::size_t riding = 182, home = ride.way.size() - static_cast<std::size_t>(ride.calm);
      ASSERT_GT(home, riding);
      Pose before = start;
      for (std::size_t n = 0; n < ride.way.size(); ++n) {
        const Vec6 moved = poseDifference(ride.way[n].pose, before) / kStep;
        const Vec6 away = poseDifference(ride.way[n].pose, start);
        const bool homewards = n > riding + 4;  // once it has braked
        EXPECT_LE(moved.head<3>().norm(), (homewards ? 0.3 : motion.speed) + 1e-9);
        EXPECT_LE(moved.tail<3>().norm(), (homewards ? 3.0 : motion.spin) + 1e-9);
        EXPECT_LE(ride.way[n].twist.head<3>().norm(), motion.speed + 1e-9);
        fastest = std::max(fastest, moved.head<3>().norm());
        fastest_turn = std::max(fastest_turn, moved.tail<3>().norm());
        farthest = std::max(farthest, away.head<3>().norm());
        farthest_turn = std::max(farthest_turn, away.tail<3>().norm());
        if (n + 1 >= home) {
          EXPECT_EQ(away.norm(), 0.0);
          EXPECT_EQ(ride.way[n].twist.norm(), 0.0);
        }
        before = ride.way[n].pose;
      }
      EXPECT_EQ(ride.calm, 91);
      EXPECT_LT(home - riding, 150u);
    }
    EXPECT_LE(farthest, reach + 1e-12);
    EXPECT_GT(farthest, 0.9 * reach);
    EXPECT_LE(farthest_turn, 2.5 + 1e-9);
    EXPECT_GT(farthest_turn, 2.0);
    EXPECT_GT(fastest, reach > 0.1 ? 1.5 : 0.4);
    EXPECT_GT(fastest_turn, 6.0);
  }
}

TEST(Ride, IsTheSameForOneSeedAndAnotherForAnother) {
  const StressBout a = rideOf({}, {}, 1), b = rideOf({}, {}, 1), c = rideOf({}, {}, 2);
  ASSERT_EQ(a.way.size(), b.way.size());
  EXPECT_EQ(a.way[50].pose.position, b.way[50].pose.position);
  EXPECT_NE(a.way[50].pose.position, c.way[50].pose.position);
}

TEST(WildHand, StandsStillAfterEachBurstAndAtTheEnd) {
  WildHand hand({}, motionWithin(0.1), 3);
  for (const int most : {1000, 20}) {
    const StressBout bout = hand.bout(most);
    EXPECT_EQ(bout.way.size(), most == 20 ? 20u : 47u);
    EXPECT_EQ(bout.calm, 16);
    const DeviceTarget& end = bout.way.back();
    for (std::size_t n = bout.way.size() - static_cast<std::size_t>(bout.calm); n < bout.way.size(); ++n) {
      EXPECT_EQ(bout.way[n].twist.norm(), 0.0);
      EXPECT_EQ((bout.way[n].pose.position - end.pose.position).norm(), 0.0);
    }
    for (const DeviceTarget& d : bout.way) EXPECT_LE(d.pose.position.norm(), 0.1 + 1e-12);
  }
}

// --- what fails

TEST(StressFailures, OneLineForEachCriterion) {
  StressOutcome good;
  good.all.steps = 10000;
  good.all.cut = 10;
  good.all.crossed = good.all.folded = good.all.redone = 5;  // on the way: told, and no failure
  good.rides.resize(2);
  EXPECT_TRUE(stressFailures(good).empty());
  for (const auto count :
       {&StressTally::nan, &StressTally::restored, &StressTally::wrong_side, &StressTally::self_intersections,
        &StressTally::inverted, &StressTally::frozen, &StressTally::cut_twice, &StressTally::restless}) {
    StressOutcome bad = good;
    bad.all.*count = 1;
    EXPECT_EQ(stressFailures(bad).size(), 1u);
    bad.rides[1].tally.*count = 1;
    EXPECT_TRUE(bad.rides[1].failed());
    EXPECT_FALSE(bad.rides[0].failed());
  }
  StressOutcome bad = good;
  bad.all.cut = 11;
  bad.all.deepest_penetration_rel = 0.0011;
  bad.all.largest_energy_made = 0.00051;
  bad.rides[0].came_back = false;
  EXPECT_EQ(stressFailures(bad).size(), 4u);
}

// --- rides of other tools

StressSettings oneRide(const SceneConfig& config) {
  StressSettings settings;
  settings.timing = timingOf(config);
  settings.riding = true;
  settings.rides = 1;
  return settings;
}

// It never comes to rest, and hangs between hand and world: neither is a failure.
TEST(StressRide, ADrivenToolComesBackToItsMotion) {
  const SceneConfig config = readSceneFromString(R"(
palpate: 1
name: driven
method: hsl
tool:
  shape: {bar: {size: [0.03, 0.03, 0.04], cells: [2, 2, 2]}}
  material: {youngs_modulus: 2.0e5}
  handles:
    top: {region: {halfspace: {point: [0, 0, 0.0399], normal: [0, 0, 1]}}}
  attachments:
    foot:
      region: {halfspace: {point: [0, 0, 0.0001], normal: [0, 0, -1]}}
      motion: {period: 2, keyframes: [{t: 0}, {t: 1, position: [0, 0, 0.004]}, {t: 2}]}
)",
                                                 "driven");
  BuiltScene scene = buildScene(config);
  StressSettings settings = oneRide(config);
  settings.motion.speed = 0.5;
  settings.motion.ride = 1.2;  // ends half a period away from where the reference of a settled scene would be taken
  const StressOutcome outcome = runStress(scene, settings);
  EXPECT_TRUE(stressFailures(outcome).empty());
  ASSERT_EQ(outcome.rides.size(), 1u);
  EXPECT_EQ(outcome.rides[0].judge, RideJudge::reference);
  EXPECT_TRUE(outcome.rides[0].came_back) << outcome.rides[0].handle_off;
}

// A tool without damping that touches nothing: it swings for long, but hangs nowhere.
TEST(StressRide, AToolThatStillSwingsHasComeBackWhereItWouldRestAsBefore) {
  const SceneConfig config = readSceneFromString(R"(
palpate: 1
name: swings
method: hsl
tool:
  shape: {bar: {size: [0.02, 0.02, 0.1], cells: [1, 1, 5]}}
  material: {youngs_modulus: 1.0e4, damping_alpha: 0, damping_beta: 0}
  handles:
    top: {region: {halfspace: {point: [0, 0, 0.0999], normal: [0, 0, 1]}}}
)",
                                                 "swings");
  for (const bool with_static : {false, true}) {
    BuiltScene scene = buildScene(config);
    StressSettings settings = oneRide(config);
    settings.timing.visual_step = 0.002;  // longer steps damp by themselves
    settings.motion.ride = 1;
    settings.motion.home = 1;
    settings.solve_static = with_static;
    const StressOutcome outcome = runStress(scene, settings);
    ASSERT_EQ(outcome.rides.size(), 1u);
    EXPECT_GT(outcome.rides[0].energy_off, 1e-4);
    EXPECT_LT(outcome.rides[0].handle_off, 5e-4);
    EXPECT_EQ(outcome.rides[0].judge, with_static ? RideJudge::swings : RideJudge::reference);
    EXPECT_EQ(outcome.rides[0].came_back, with_static);
  }
}

TEST(StressHand, ByTheClockStepsHaveTheBudgetOfRealTime) {
  for (const bool by_clock : {false, true}) {
    BuiltScene scene = buildScene(readSceneFromString(R"(
palpate: 1
name: clock
tool:
  shape: {bar: {size: [0.03, 0.03, 0.04], cells: [1, 1, 2]}}
  handles:
    top: {region: {halfspace: {point: [0, 0, 0.0399], normal: [0, 0, 1]}}}
)",
                                                      "clock"));
    StressSettings settings;
    settings.steps = 4;
    settings.by_clock = by_clock;
    const StepBudget before = scene.world.budget;
    int seen = 0;
    runStress(scene, settings, [&](double) {
      ++seen;
      EXPECT_EQ(scene.world.budget.operations, before.operations);
      EXPECT_EQ(scene.world.budget.seconds, by_clock ? 0.8 * settings.timing.visual_step : before.seconds);
      return true;
    });
    EXPECT_EQ(seen, 4);
    EXPECT_EQ(scene.world.budget.seconds, before.seconds);
  }
}

// A soft tool that is led along a path by a hand of 2 m/s, and swings: what the step's linear forces would add to it is
// no more than of a tool that is pulled.
TEST(StressRide, WhoLeadsASoftToolMakesNoEnergy) {
  const SceneConfig config = readSceneFromString(R"(
palpate: 1
name: led
method: live
tool:
  shape: {bar: {size: [0.02, 0.02, 0.1], cells: [2, 2, 8]}}
  material: {youngs_modulus: 1.0e4, density: 1050, damping_beta: 0.005}
  handles:
    top: {region: {halfspace: {point: [0, 0, 0.0999], normal: [0, 0, 1]}}}
)",
                                                 "led");
  BuiltScene scene = buildScene(config);
  StressSettings settings = oneRide(config);
  settings.timing.visual_step = 0.033;
  settings.rides = 3;
  const StressOutcome outcome = runStress(scene, settings);
  EXPECT_LE(outcome.all.largest_energy_made, 1e-5);
  EXPECT_GT(outcome.all.max_energy, 0.01);
}

// A tool so soft that the hand turns tetrahedra over: nothing must keep them so. Each of these rides
// once ended in a tangle.
TEST(StressRide, ASoftToolThatIsHeldLeavesNoTetrahedraTurnedOver) {
  const SceneConfig config = readSceneFromString(R"(
palpate: 1
name: soft
method: hsl
tool:
  shape: {bar: {size: [0.024, 0.012, 0.045], cells: [4, 2, 7]}}
  material: {youngs_modulus: 3.0e4, poisson_ratio: 0.4, density: 1050, damping_beta: 0.005}
  handles:
    edge: {region: {halfspace: {point: [0, 0, 0.038], normal: [0, 0, 1]}}, mass: 0.02}
  attachments:
    base: {region: {halfspace: {point: [0, 0, 0.0001], normal: [0, 0, -1]}}}
)",
                                                 "soft");
  for (const std::uint64_t seed : {16u, 35u, 43u}) {
    BuiltScene scene = buildScene(config);
    StressSettings settings = oneRide(config);
    settings.seed = seed;
    const StressOutcome outcome = runStress(scene, settings);
    EXPECT_GT(outcome.all.folded, 5) << seed;  // on the way
    EXPECT_EQ(outcome.all.inverted, 0) << seed;
    EXPECT_EQ(outcome.all.self_intersections, 0) << seed;
    ASSERT_EQ(outcome.rides.size(), 1u);
    EXPECT_TRUE(outcome.rides[0].came_back) << seed;
  }
}

}  // namespace
}  // namespace palpate
