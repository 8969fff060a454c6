// Contact between bodies against closed form and conservation laws: inclines, collisions, stacks, friction's power,
// order of bodies.
#include <gtest/gtest.h>

#include <cmath>

#include "shared/pair_scenes.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kGravity = 9.81;
const Vec3 kBlock(0.04, 0.03, 0.02);

// Gravity of an incline that falls along x: the ground stays level.
Vec3 tilted(double slope) {
  const double angle = std::atan(slope);
  return kGravity * Vec3(std::sin(angle), 0, -std::cos(angle));
}
double sine(double slope) { return std::sin(std::atan(slope)); }
double cosine(double slope) { return std::cos(std::atan(slope)); }

void run(World& world, double seconds, double h) {
  for (int n = 0; n < static_cast<int>(std::lround(seconds / h)); ++n) {
    const StepReport report = world.step({}, h);
    ASSERT_EQ(report.status, StepStatus::ok) << "step " << n << " residual " << report.solver_residual;
  }
}

// --- inclines

TEST(Incline, RigidBoxSlides) {
  constexpr double kSlope = 0.8, kFriction = 0.5;
  World world;
  world.gravity = tilted(kSlope);
  world.obstacles = {ground(kFriction)};
  world.add(box(Kind::rigid, "box", kBlock, at({0, 0, 0.5 * kBlock.z()})));
  run(world, 0.1, 0.01);
  const double before = centerVelocity(world.body(0)).x();
  run(world, 0.3, 0.01);
  const double expected = kGravity * (sine(kSlope) - kFriction * cosine(kSlope));
  EXPECT_NEAR((centerVelocity(world.body(0)).x() - before) / 0.3, expected, 1e-6 * expected);
  EXPECT_LT(world.body(0).state.handle.twist.tail<3>().norm(), 1e-6);
}

TEST(Incline, RigidBoxSticks) {
  World world;
  world.gravity = tilted(0.99 * 0.5);
  world.obstacles = {ground(0.5)};
  world.add(box(Kind::rigid, "box", kBlock, at({0, 0, 0.5 * kBlock.z()})));
  run(world, 0.5, 0.01);
  EXPECT_LT(fastest(world.body(0)), 1e-6);
}

// Facets cost a rolling ball speed at every edge: w falls by about a/2/1.4 of itself a radian, a the angle between
// vertices (1.4 degrees here), so by less than 1 % of the acceleration up to 7 rad/s.
TEST(Incline, RigidBallRolls) {
  constexpr double kSlope = 0.3, kRadius = 0.03, kStep = 0.002;
  World world;
  world.gravity = tilted(kSlope);
  world.obstacles = {ground(0.8)};
  world.add(BodyModel::rigid("ball", placed(sphereSurface(kRadius, 6), at({0, 0, kRadius})), 1000, 0.8));
  run(world, 0.02, kStep);
  const double before = world.body(0).state.handle.twist[0];
  run(world, 0.08, kStep);
  const Vec6 twist = world.body(0).state.handle.twist;
  const double expected = 5.0 / 7.0 * kGravity * sine(kSlope);
  EXPECT_NEAR((twist[0] - before) / 0.08, expected, 0.02 * expected);
  EXPECT_NEAR(twist[4], twist[0] / kRadius, 0.02 * twist[4]);  // rolls without slipping
}

// A block on a slab that sticks to the ground.
struct Support {
  const char* name;
  Kind block, slab;
  double tolerance;  // of the acceleration; a soft slab gives way under the block that slides over it
};
class OnBody : public ::testing::TestWithParam<Support> {};

World blockOnSlab(const Support& p, double slope, double friction) {
  World world;
  world.gravity = tilted(slope);
  world.obstacles = {ground(3.0)};
  BoxOptions slab;
  slab.cells = {6, 3, 2};
  slab.youngs_modulus = 3e5;
  slab.damping_beta = 0.02;
  BoxOptions block;
  block.youngs_modulus = 3e5;
  block.damping_beta = 0.02;
  world.add(box(p.slab, "slab", Vec3(0.24, 0.08, 0.02), at({0, 0, 0.01}), slab));
  world.add(box(p.block, "block", kBlock, at({-0.06, 0, 0.0302}), block));
  world.setFriction(0, 1, friction);
  return world;
}

TEST_P(OnBody, Slides) {
  constexpr double kSlope = 0.8, kFriction = 0.4;
  World world = blockOnSlab(GetParam(), kSlope, kFriction);
  run(world, 0.1, 0.01);
  const double before = centerVelocity(world.body(1)).x();
  run(world, 0.2, 0.01);
  const double expected = kGravity * (sine(kSlope) - kFriction * cosine(kSlope));
  EXPECT_NEAR((centerVelocity(world.body(1)).x() - before) / 0.2, expected, GetParam().tolerance * expected);
  EXPECT_LT(std::abs(centerVelocity(world.body(0)).x()), 2e-3);
}

TEST_P(OnBody, Sticks) {
  World world = blockOnSlab(GetParam(), 0.97 * 0.4, 0.4);
  run(world, 1.5, 0.01);
  EXPECT_LT(fastest(world.body(1)), 1e-6);
  const Vec3 place = center(world.body(1));
  run(world, 0.3, 0.01);
  EXPECT_LT((center(world.body(1)) - place).norm(), 1e-6 * 0.3);
}

INSTANTIATE_TEST_SUITE_P(Pairs, OnBody,
                         ::testing::Values(Support{"soft_on_soft", Kind::soft, Kind::soft, 0.02},
                                           Support{"rigid_on_soft", Kind::rigid, Kind::soft, 0.02},
                                           Support{"soft_on_rigid", Kind::soft, Kind::rigid, 0.02},
                                           Support{"rigid_on_rigid", Kind::rigid, Kind::rigid, 1e-5}),
                         [](const auto& param) { return std::string(param.param.name); });

// A tilted box falls by 2 mm on a ball and rocks: in short steps, too, the facets that it comes upon, which are a
// little nearer than surfaces are to be, must not throw it.
TEST(Facets, DoNotKickWhatRocksOnThem) {
  constexpr double kFall = 0.002;
  const Pose tilt{{0, 0, 0.02 + kFall}, Quat(Eigen::AngleAxisd(0.05, Vec3(1, 0.7, 0).normalized()))};
  for (const double h : {0.001, 0.002}) {
    World world;
    world.obstacles = {{SphereShape{Vec3(0, 0, -0.1), 0.1}, 0.5, "ball"}};
    world.add(box(Kind::rigid, "box", {0.1, 0.06, 0.04}, tilt));
    const Body body = world.body(0);
    const double falls = body.model.handle().mass * kGravity * kFall;
    double most = 0, made = 0;
    for (int n = 0; n < static_cast<int>(std::lround(1.0 / h)); ++n) {
      const StepReport report = world.step({}, h);
      ASSERT_EQ(report.status, StepStatus::ok);
      most = std::max(most, report.kinetic_energy);
      made = std::max(made, report.energy_made);
    }
    EXPECT_LT(most, 1.1 * falls) << h;
    EXPECT_LT(made, 1e-5) << h;  // in a step
  }
}

// Block thrown onto a slab that is free to slide: friction brakes the one by mu g and takes the other along by
// mu g m1 / m2.
TEST(Incline, RigidBlockTakesAFreeSlabAlong) {
  World world;
  world.obstacles = {ground(0.0)};
  world.add(box(Kind::rigid, "slab", Vec3(0.3, 0.1, 0.02), at({0, 0, 0.01})));
  world.add(box(Kind::rigid, "block", kBlock, at({-0.1, 0, 0.0302}), {}, moving({0.8, 0, 0})));
  world.setFriction(0, 1, 0.3);
  run(world, 0.05, 0.01);
  const Vec3 slab = centerVelocity(world.body(0));
  const Vec3 block = centerVelocity(world.body(1));
  run(world, 0.1, 0.01);
  const double expected = 0.3 * kGravity;
  const double ratio = world.body(1).model.totalMass() / world.body(0).model.totalMass();
  EXPECT_NEAR((centerVelocity(world.body(1)) - block).x() / 0.1, -expected, 1e-3 * expected);
  EXPECT_NEAR((centerVelocity(world.body(0)) - slab).x() / 0.1, ratio * expected, 1e-3 * ratio * expected);
}

// --- collisions

struct Pair {
  const char* name;
  Kind first, second;
};
class Collision : public ::testing::TestWithParam<Pair> {};

Vec3 totalMomentum(const World& world) {
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < world.bodies(); ++i) sum += momentum(world.body(i));
  return sum;
}

// Corner first and off center, so that both turn, with friction.
World collision(const Pair& p) {
  World world;
  world.gravity.setZero();
  world.add(box(p.first, "first", kBlock, {Vec3(-0.03, 0, 0), expRotation({0.3, 0.5, -0.2})}, {},
                moving({0.7, 0.1, 0}, {1, 2, -1})));
  world.add(box(p.second, "second", kBlock, {Vec3(0.03, 0.008, 0.005), expRotation({-0.4, 0.1, 0.6})}, {},
                moving({-0.6, 0, 0.05}, {0, -1, 2})));
  return world;
}

// Each contact gives one body what it takes from the other. Points that are near each other at the start of the step
// have been put at one place there, so moments cancel as well. Those of a contact that is found along the path meet at
// the impact, not at the start: the moment left is their distance at the start times the impulse, no more.
struct Counts {
  int together = 0, apart = 0;
};
void expectActsEqually(const World& world, Counts& counts) {
  constexpr double kLever = 0.02;  // [m] a body's size
  const double near = 2 * world.contact.surfaceReach();
  const ContactSet& set = world.contacts();
  for (std::size_t i = 0; i < set.contacts.size(); ++i) {
    const Contact& c = set.contacts[i];
    const Vec3 impulse = impulseOf(set, i);
    if (impulse.norm() == 0 || c.first.body < 0 || c.second.body < 0) continue;
    const Given first = give(world, c.first, impulse);
    const Given second = give(world, c.second, -impulse);
    EXPECT_LT((first.impulse + second.impulse).norm(), 1e-9 * impulse.norm());
    const Vec3 apart = c.first.at(world.body(c.first.body).system.startPositions()) -
                       c.second.at(world.body(c.second.body).system.startPositions());
    const Vec3 moment = first.moment + second.moment;
    EXPECT_LT((moment - apart.cross(impulse)).norm(), 1e-9 * kLever * impulse.norm());
    if (apart.norm() < near) {
      EXPECT_LT(moment.norm(), 1e-9 * kLever * impulse.norm());
      ++counts.together;
    } else {
      ++counts.apart;
    }
  }
}

// Momentum to 1e-9 of one body's, after every step.
TEST_P(Collision, KeepsMomentumAndActsEqually) {
  for (const double h : {0.005, 0.033}) {
    World world = collision(GetParam());
    ASSERT_FALSE(overlap(world.body(0), world.body(1)));
    const Vec3 start = totalMomentum(world);
    const Vec3 before = momentum(world.body(0));
    Counts counts;
    for (int n = 0; n < static_cast<int>(0.3 / h); ++n) {
      ASSERT_NE(world.step({}, h).status, StepStatus::restored);
      EXPECT_LT((totalMomentum(world) - start).norm(), 1e-9 * before.norm()) << "step " << n;
      EXPECT_FALSE(overlap(world.body(0), world.body(1))) << "step " << n;
      expectActsEqually(world, counts);
    }
    if (h < 0.01) {  // in a longer step they may meet and part
      EXPECT_GT(counts.together, 0);
    }
    EXPECT_GT((momentum(world.body(0)) - before).norm(), 0.3 * before.norm());  // they did collide
  }
}

INSTANTIATE_TEST_SUITE_P(Pairs, Collision,
                         ::testing::Values(Pair{"soft_soft", Kind::soft, Kind::soft},
                                           Pair{"soft_rigid", Kind::soft, Kind::rigid},
                                           Pair{"rigid_soft", Kind::rigid, Kind::soft},
                                           Pair{"rigid_rigid", Kind::rigid, Kind::rigid}),
                         [](const auto& param) { return std::string(param.param.name); });

// --- stacks

struct Stack {
  const char* name;
  std::vector<Kind> kinds;        // from below
  std::vector<double> densities;  // [kg/m^3]
  double youngs_modulus;          // [Pa]
  double turn;                    // of each box against the one below [rad]
  double step;                    // [s]
};
class Stacked : public ::testing::TestWithParam<Stack> {};

World stack(const Stack& p) {
  constexpr double kHeight = 0.02, kGap = 2e-4;
  World world;
  world.obstacles = {ground(0.5)};
  for (std::size_t i = 0; i < p.kinds.size(); ++i) {
    const auto level = static_cast<double>(i);
    BoxOptions options;
    options.density = p.densities[i];
    options.youngs_modulus = p.youngs_modulus;
    options.damping_beta = 0.05;
    const double width = 0.05 - 0.006 * level;
    world.add(box(p.kinds[i], "box", Vec3(width, 0.8 * width, kHeight),
                  {Vec3(0, 0, level * (kHeight + kGap) + 0.5 * kHeight), expRotation({0, 0, p.turn * level})},
                  options));
  }
  return world;
}

Vec3 weightFrom(const World& world, int lowest) {
  Vec3 weight = Vec3::Zero();
  for (int i = lowest; i < world.bodies(); ++i) weight += world.body(i).model.totalMass() * world.gravity;
  return weight;
}

TEST_P(Stacked, InterfacesCarryWhatLiesAbove) {
  World world = stack(GetParam());
  const int steps = static_cast<int>(3.0 / GetParam().step);
  for (int n = 0; n < steps; ++n) ASSERT_NE(world.step({}, GetParam().step).status, StepStatus::restored);
  for (int i = 0; i < world.bodies(); ++i) {
    const Vec3 weight = weightFrom(world, i);
    EXPECT_LT((forceBetween(world, i, i - 1) + weight).norm(), 1e-3 * weight.norm()) << "interface " << i;
    EXPECT_LT(fastest(world.body(i)), 1e-6);
    if (i > 0) {
      EXPECT_FALSE(overlap(world.body(i), world.body(i - 1)));
    }
  }
}

constexpr Kind kSoft = Kind::soft;
constexpr Kind kRigid = Kind::rigid;
INSTANTIATE_TEST_SUITE_P(
    Stacks, Stacked,
    ::testing::Values(
        Stack{"soft_on_soft", {kSoft, kSoft}, {1000, 1000}, 5e4, 0.2, 0.02},
        Stack{"rigid_on_soft", {kSoft, kRigid}, {1000, 1000}, 5e4, 0.2, 0.02},
        Stack{"three_soft", {kSoft, kSoft, kSoft}, {1000, 1000, 1000}, 5e4, 0.2, 0.02},
        Stack{"three_rigid", {kRigid, kRigid, kRigid}, {1000, 1000, 1000}, 1, 0.2, 0.02},
        Stack{"heavy_on_light_rigid", {kRigid, kRigid, kRigid}, {100, 100, 20000}, 1, 0.2, 0.02},
        Stack{"heavy_on_light_soft", {kSoft, kSoft, kRigid}, {100, 100, 20000}, 2e5, 0.0, 0.02},
        Stack{"heavy_on_light_soft_turned_short_steps", {kSoft, kSoft, kRigid}, {100, 100, 10000}, 1e5, 0.2, 0.005},
        Stack{"heavy_on_light_soft_turned", {kSoft, kSoft, kRigid}, {100, 100, 10000}, 1e5, 0.2, 0.02}),
    [](const auto& param) { return std::string(param.param.name); });

// --- energy

void expectFrictionTakes(const World& world, int step) {
  const ContactSet& set = world.contacts();
  double impulse = 0;
  for (std::size_t i = 0; i < set.contacts.size(); ++i) impulse = std::max(impulse, impulseOf(set, i).norm());
  if (impulse == 0) return;
  // the solver's residual is a velocity by which a contact may miss the law
  EXPECT_LE(worstFrictionPower(world), impulse * std::max(1e-12, 10 * set.solver.residual)) << "step " << step;
}

TEST_P(Collision, FrictionTakesAndEnergyDoesNotGrow) {
  World world = collision(GetParam());
  const double start = totalEnergy(world);
  double before = start;
  for (int n = 0; n < 60; ++n) {
    ASSERT_NE(world.step({}, 0.005).status, StepStatus::restored);
    expectFrictionTakes(world, n);
    const double now = totalEnergy(world);
    EXPECT_LT(now, before + 5e-4 * start) << "step " << n;
    before = now;
  }
}

// Boxes and a ball fall onto each other, sliding and turning.
World pile(const std::vector<int>& order) {
  World world;
  world.obstacles = {ground(0.4)};
  std::vector<BodyModel> bodies;
  BoxOptions options;
  bodies.push_back(
      box(Kind::soft, "a", Vec3(0.06, 0.05, 0.02), {Vec3(0, 0, 0.012), expRotation({0.02, 0.01, 0})}, options));
  bodies.push_back(box(Kind::rigid, "b", kBlock, {Vec3(0.006, 0.004, 0.038), expRotation({0.1, 0.05, 0.4})}, options,
                       moving({0.3, 0, 0}, {0, 0, 3})));
  bodies.push_back(box(Kind::soft, "c", kBlock, {Vec3(-0.004, 0, 0.066), expRotation({-0.1, 0.1, 1})}, options));
  bodies.push_back(BodyModel("d", ballMesh(0.012, {0.003, 0.002, 0.094}), {}));
  for (const int i : order) world.add(std::move(bodies[i]), i != 1);
  return world;
}

TEST(Pile, FrictionTakesAndEnergyDoesNotGrow) {
  World world = pile({0, 1, 2, 3});
  const double start = totalEnergy(world);
  double before = start;
  double gain = 0;
  Counts counts;
  for (int n = 0; n < 80; ++n) {
    ASSERT_NE(world.step({}, 0.005).status, StepStatus::restored);
    expectFrictionTakes(world, n);
    expectActsEqually(world, counts);
    const double now = totalEnergy(world);
    gain = std::max(gain, now - before);
    before = now;
  }
  // contact that begins nearer than the thickness it keeps lifts what lies above it, once
  double weight = 0;
  for (int i = 0; i < world.bodies(); ++i) weight -= world.body(i).model.totalMass() * world.gravity.z();
  EXPECT_LT(gain, weight * world.contact.thickness);
  EXPECT_GT(counts.together, 200);
}

// The order of bodies decides that of the candidates, and which surface is a pair's first. Without friction the contact
// problem is convex and its velocities are unique, so each step from the same state ends in the same places whatever
// the order: to the solver's tolerance, 1e-10 of some 2 m/s, in a step of 5 ms. (With friction Coulomb's law allows
// several solutions, and which is found is decided by rounding.)
TEST(Pile, OrderOfBodiesDoesNotMatter) {
  const std::vector<std::vector<int>> orders{{0, 1, 2, 3}, {3, 2, 1, 0}, {2, 0, 3, 1}};
  std::vector<World> worlds;
  for (const auto& order : orders) worlds.push_back(pile(order));
  for (World& world : worlds) {
    world.contact.solver.acceptable = 0;
    world.obstacles = {ground(0)};
    for (int i = 0; i < world.bodies(); ++i) {
      world.setFriction(i, FrictionTable::obstacle(0), 0);
      for (int j = 0; j <= i; ++j) world.setFriction(i, j, 0);
    }
  }
  int most = 0;
  for (int n = 0; n < 60; ++n) {
    for (std::size_t w = 1; w < worlds.size(); ++w) {
      for (int k = 0; k < 4; ++k) worlds[w].setBody(k, worlds[0].body(orders[w][k]).state);
    }
    std::vector<std::vector<Vec3>> places(orders.size(), std::vector<Vec3>(4));
    for (std::size_t w = 0; w < worlds.size(); ++w) {
      ASSERT_NE(worlds[w].step({}, 0.005).status, StepStatus::restored);
      for (int k = 0; k < 4; ++k) places[w][orders[w][k]] = center(worlds[w].body(k));
    }
    most = std::max(most, worlds[0].contacts().active());
    for (std::size_t w = 1; w < worlds.size(); ++w) {
      for (std::size_t i = 0; i < 4; ++i) {
        EXPECT_LT((places[0][i] - places[w][i]).norm(), 1e-12) << "step " << n << " body " << i;
      }
    }
  }
  EXPECT_GT(most, 10);  // the pile has formed
}

}  // namespace
}  // namespace palpate
