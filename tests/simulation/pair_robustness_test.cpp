// Bodies against bodies, sheets and themselves: nothing passes through, starts inside each other are undone gently.
#include <gtest/gtest.h>

#include <cmath>

#include "palpate/contact/self_intersections.h"
#include "shared/attached_bodies.h"
#include "shared/pair_scenes.h"

namespace palpate {
namespace {

using namespace test;

// --- self-contact

constexpr double kArm = 0.06;     // [m]
constexpr double kBend = 0.0127;  // radius of the middle of the bend [m]
constexpr double kHalf = 0.005;   // thickness / 2 [m]
constexpr double kLength = 2 * kArm + M_PI * kBend;

// Bar that is bent by half a turn in its rest shape: one arm on the ground, the other 15 mm above it.
struct Hook {
  World world;
  std::vector<std::array<int, 3>> lower, upper;  // triangles of the arms

  explicit Hook(bool self) {
    const Vec3 size(kLength, 0.02, 2 * kHalf);
    TetrahedralMesh mesh = barMesh(size, {18, 2, 1}).mesh;
    std::vector<double> along;
    for (Vec3& p : mesh.nodes) {
      along.push_back(p.x());
      p = bent(p);
    }
    SimulationMesh hook = simulationMeshOf(std::move(mesh), "hook");
    for (const auto& t : hook.surface.triangles) {
      double low = 1e300;
      double high = -1e300;
      for (const int v : t) {
        const EmbeddedPoint& e = hook.embedding[v];
        double s = 0;
        for (int k = 0; k < 4; ++k) s += e.weights[k] * along[hook.mesh.tetrahedra[e.tetrahedron][k]];
        low = std::min(low, s);
        high = std::max(high, s);
      }
      if (high < kArm + 1e-9) lower.push_back(t);
      if (low > kLength - kArm - 1e-9) upper.push_back(t);
    }
    Material material;
    material.youngs_modulus = 2e5;
    material.damping_beta = 0.01;
    BodyModel body("hook", hook, material);
    std::vector<int> end;
    for (int i = 0; i < body.nodes(); ++i) {
      if (along[i] >= kLength - 0.009) end.push_back(i);
    }
    HandleOptions handle = kPlainHandle;
    handle.inertia.setConstant(1e-5);
    holdNodes(body, end, handle);
    world.link = {700, 2, 1.0, 0.01};
    world.obstacles = {ground(0.5)};
    world.add(std::move(body), self);
  }
  static Vec3 bent(const Vec3& p) {
    const double s = std::clamp((p.x() - kArm) / kBend, 0.0, M_PI);
    const double rest = p.x() < kArm ? p.x() - kArm : std::max(p.x() - kArm - M_PI * kBend, 0.0);
    const Vec3 direction(std::cos(s), 0, std::sin(s));
    const Vec3 inward(-std::sin(s), 0, std::cos(s));
    return Vec3(kArm, p.y(), kHalf + kBend) - kBend * inward + rest * direction + (p.z() - kHalf) * inward;
  }
  int crossing() const { return crossings(surfacePoints(world.tool()), lower, upper); }
};

struct Press {
  int crossings = 0;            // of all steps
  double force = 0;             // of the link on the device, upwards, at the end [N]
  double worst_power = -1e300;  // of friction, relative to the impulse of 1 N s
  double end_height = 0;
};
Press press(bool self) {
  Hook hook(self);
  Press out;
  const Pose start = hook.world.tool().state.handle.pose;
  for (int n = 0; n < 90; ++n) {
    DeviceTarget device{start, Vec6::Zero()};
    // down by 25 mm, then sideways to rub
    device.pose.position.z() -= 0.025 * std::min(n / 50.0, 1.0);
    device.pose.position.x() += 0.008 * std::clamp((n - 50) / 30.0, 0.0, 1.0);
    const StepReport report = hook.world.step(device, 0.02);
    EXPECT_NE(report.status, StepStatus::restored);
    out.crossings += hook.crossing();
    const ContactSet& set = hook.world.contacts();
    double impulse = 0;
    for (std::size_t i = 0; i < set.contacts.size(); ++i) impulse = std::max(impulse, impulseOf(set, i).norm());
    if (impulse > 0) {
      const double allowance = std::max(1e-12, 10 * set.solver.residual) * impulse;
      EXPECT_LE(worstFrictionPower(hook.world), allowance) << "step " << n;
    }
    out.force = 700 * (hook.world.tool().state.handle.pose.position - device.pose.position).z();
  }
  out.end_height = hook.world.tool().state.handle.pose.position.z();
  return out;
}

TEST(SelfContact, ArmsOfAHookMeetAndAreFelt) {
  EXPECT_EQ(Hook(true).crossing(), 0);
  const Press with = press(true);
  const Press without = press(false);
  EXPECT_EQ(with.crossings, 0);
  EXPECT_GT(without.crossings, 0);  // the check can fail
  EXPECT_GT(with.force, without.force + 1.0);
  EXPECT_GT(with.end_height, without.end_height + 0.003);
}

// What passes through itself is let go until it is apart again: contact would hold it as it is.
TEST(SelfContact, TangleComesApart) {
  Hook hook(true);
  const Pose start = hook.world.tool().state.handle.pose;
  BodyState tangled = hook.world.tool().state;
  const VecX rest = tangled.positions;
  for (const auto& t : hook.upper) {
    for (const int v : t) {
      const EmbeddedPoint& e = hook.world.tool().model.mesh().embedding[v];
      for (const int n : hook.world.tool().model.mesh().mesh.tetrahedra[e.tetrahedron]) {
        if (hook.world.tool().model.row()[n] < 0) continue;
        tangled.positions[3 * n + 2] = rest[3 * n + 2] - 0.02;
      }
    }
  }
  hook.world.setBody(hook.world.toolIndex(), tangled);
  ASSERT_GT(hook.crossing(), 0);
  for (int n = 0; n < 90; ++n) ASSERT_NE(hook.world.step({start, Vec6::Zero()}, 0.033).status, StepStatus::restored);
  EXPECT_EQ(hook.crossing(), 0);
  EXPECT_LT((hook.world.tool().state.positions - rest).lpNorm<Eigen::Infinity>(), 0.002);
}

// Triangles of a body's surface that pass through each other, those of neighboring tetrahedra included.
int selfCrossings(const Body& body) {
  CollisionSurface surface(body.model.mesh().surface);
  surface.start = surface.end = surfacePoints(body);
  surface.refit();
  std::vector<std::array<int, 2>> pairs;
  findSelfIntersections(surface, pairs);
  return static_cast<int>(pairs.size());
}

// A bar that is fixed at one end and pressed or folded onto itself by the other: tetrahedra at the creases, which share
// nodes, do not pass through each other.
TEST(SelfContact, CreasesDoNotPassThroughThemselves) {
  const Vec3 size(0.024, 0.012, 0.045);
  for (const auto& [move, turn] : {std::pair<Vec3, Vec3>{{0.02, 0, -0.03}, {0, 2, 0}},
                                   {{0.005, 0, -0.035}, {0, 0, 0}},
                                   {{0, 0.03, -0.07}, {3, 0, 0}}}) {
    BodyModel body("bar", barMesh(size, {4, 2, 7}), material(5e4));
    body.attach(fixed(body, [](const Vec3& x) { return x.z() < 1e-9; }));
    holdNodes(body, nodesWhere(body.mesh().mesh.nodes, [&](const Vec3& x) { return x.z() > size.z() - 0.008; }),
              kPlainHandle);
    World world;
    world.link = {3000, 5, 3.0, 0.01};
    world.add(std::move(body), true);
    DeviceTarget device{world.tool().state.handle.pose, Vec6::Zero()};
    const Pose start = device.pose;
    for (int n = 0; n < 120; ++n) {
      const double way = std::min(n / 60.0, 1.0);
      device.pose = {start.position + way * move, expRotation(way * turn)};
      ASSERT_NE(world.step(device, 0.02).status, StepStatus::restored);
      ASSERT_EQ(selfCrossings(world.tool()), 0) << "step " << n << ", turned by " << turn.norm();
    }
  }
}

// --- sheet

Obstacle sheet() {
  Surface s;
  s.vertices = {{-0.1, -0.1, 0}, {0.1, -0.1, 0}, {0.1, 0.1, 0}, {-0.1, 0.1, 0}};
  s.triangles = {{0, 1, 2}, {0, 2, 3}};
  return {MeshShape{s}, 0.5, "sheet"};
}

// From either side of the triangles, and off their common edge and onto it.
TEST(Sheet, SoftBallStaysOnTop) {
  for (const bool flipped : {false, true}) {
    for (const double y : {0.0, 0.02}) {
      World world;
      world.obstacles = {sheet()};
      if (flipped) {
        for (auto& t : std::get<MeshShape>(world.obstacles[0].shape).surface.triangles) std::swap(t[1], t[2]);
      }
      Material material;
      material.damping_alpha = 2;
      material.damping_beta = 0.01;
      world.add(BodyModel("ball", ballMesh(0.02, {0.0, y, 0.03}), material), true);
      for (int n = 0; n < 60; ++n) {
        ASSERT_NE(world.step({}, 0.02).status, StepStatus::restored);
        ASSERT_GT(extent(world.body(0), 2).first, 0.0) << "step " << n;
      }
      EXPECT_LT(extent(world.body(0), 2).first, 5e-4);  // and does lie on it
      const Vec3 weight = world.body(0).model.totalMass() * world.gravity;
      EXPECT_LT((contactForce(world, 0).total + weight).norm(), 1e-3 * weight.norm());
    }
  }
}

// --- deep starts

// 5 mm at the recovery speed are 10 ms, one step where steps are longer; soft bodies give way first. A free box pushed
// at a corner with the speed v along a face also turns: its corner moves at up to 1.25 v, where the box is twice as
// long along the push as across it (sideways a b / (4 a^2 / 3 + b^2 / 3) of v, for half lengths a and b); steps, which
// are linear, to 1 %.
void expectComesApartGently(World& world, double h) {
  double speed = 0;
  int apart = -1;
  for (int n = 0; n < static_cast<int>(0.5 / h); ++n) {
    ASSERT_NE(world.step({}, h).status, StepStatus::restored);
    for (int i = 0; i < 2; ++i) speed = std::max(speed, fastest(world.body(i)));
    const bool in = overlap(world.body(0), world.body(1));
    if (apart < 0 && !in) apart = n + 1;
    if (apart >= 0) {
      EXPECT_FALSE(in) << "h " << h << " step " << n;
    }
  }
  EXPECT_LT(speed, 1.01 * 1.25 * world.contact.max_recovery_speed - h * world.gravity.z()) << "h " << h;
  EXPECT_GT(apart, 0);
  EXPECT_LE(apart * h, 0.02 + 2 * h) << "h " << h;
}

struct Deep {
  const char* name;
  Kind first, second;
  double gravity;
};
class DeepStart : public ::testing::TestWithParam<Deep> {};

TEST_P(DeepStart, ComesApartGently) {
  const Deep& p = GetParam();
  for (const double h : {0.005, 0.02, 0.033}) {
    World world;
    world.gravity = Vec3(0, 0, -p.gravity);
    world.obstacles = {ground(0.5)};
    const Vec3 size(0.06, 0.06, 0.03);
    world.add(box(p.first, "lower", size, at({0, 0, 0.0151})));
    world.add(box(p.second, "upper", Vec3(0.03, 0.03, 0.03), {Vec3(0.003, 0.002, 0.0401), expRotation({0, 0, 0.3})}));
    ASSERT_TRUE(overlap(world.body(0), world.body(1)));
    expectComesApartGently(world, h);
  }
}

// Bodies that were apart are not looked at again, unless a state is set from outside.
TEST(DeepState, SetFromOutsideComesApartToo) {
  World world;
  world.obstacles = {ground(0.5)};
  world.add(box(Kind::soft, "lower", Vec3(0.06, 0.06, 0.03), at({0, 0, 0.0151})));
  world.add(box(Kind::soft, "upper", Vec3(0.03, 0.03, 0.03), {Vec3(0.003, 0.002, 0.06), expRotation({0, 0, 0.3})}));
  ASSERT_EQ(world.step({}, 0.005).status, StepStatus::ok);
  BodyState state = world.body(1).state;
  for (Eigen::Index i = 2; i < state.positions.size(); i += 3) state.positions[i] -= 0.02;
  world.setBody(1, state);
  ASSERT_TRUE(overlap(world.body(0), world.body(1)));
  expectComesApartGently(world, 0.02);
}

INSTANTIATE_TEST_SUITE_P(Pairs, DeepStart,
                         ::testing::Values(Deep{"soft_soft", Kind::soft, Kind::soft, 9.81},
                                           Deep{"soft_soft_weightless", Kind::soft, Kind::soft, 0},
                                           Deep{"soft_rigid", Kind::soft, Kind::rigid, 9.81},
                                           Deep{"rigid_rigid", Kind::rigid, Kind::rigid, 9.81}),
                         [](const auto& param) { return std::string(param.param.name); });

// A corner hangs over, so nearest ways out differ by right angles from place to place: a common one must be taken.
TEST(DeepStart, OverhangingCornerComesApartGently) {
  for (const double gravity : {0.0, 9.81}) {
    for (const double h : {0.005, 0.02, 0.033}) {
      World world;
      world.gravity.z() = -gravity;
      world.obstacles = {ground(0.5)};
      world.add(box(Kind::soft, "lower", Vec3(0.04, 0.04, 0.03), at({0, 0, 0.0151})));
      world.add(
          box(Kind::soft, "upper", Vec3(0.03, 0.03, 0.03), {Vec3(0.003, 0.002, 0.0401), expRotation({0, 0, 0.3})}));
      ASSERT_TRUE(overlap(world.body(0), world.body(1)));
      expectComesApartGently(world, h);
    }
  }
}

// --- fast

// 10 m/s and 33 ms: a third of a meter a step, onto a plate of 1 mm.
TEST(Fast, BallDoesNotPassAThinPlate) {
  for (const double offset : {0.0, 0.013, 0.11}) {
    World world;
    world.obstacles = {{BoxShape{Pose{}, Vec3(0.5, 0.5, 0.0005)}, 0.3, "plate"}};
    world.add(
        BodyModel("ball", ballMesh(0.02, {0.003, 0.007, 0.05 + offset}), {}, 0.5, moving({1, 0, -10}, {10, 5, 0})),
        true);
    for (int n = 0; n < 20; ++n) {
      ASSERT_NE(world.step({}, 0.033).status, StepStatus::restored);
      ASSERT_GT(extent(world.body(0), 2).first, 0.0005) << "offset " << offset << " step " << n;
    }
  }
}

class FastAtBody : public ::testing::TestWithParam<Kind> {};

// The target is wide and thin, and gives way: the ball must stay on its upper side, seen in the target's own frame.
TEST_P(FastAtBody, BallDoesNotPassABody) {
  for (const double offset : {0.0, 0.013, 0.11}) {
    World world;
    world.gravity.setZero();
    BoxOptions options;
    options.cells = {6, 6, 1};
    options.youngs_modulus = 2e5;
    world.add(box(GetParam(), "slab", Vec3(0.2, 0.2, 0.01), at({0, 0, -0.005}), options));
    world.add(
        BodyModel("ball", ballMesh(0.02, {0.003, 0.007, 0.03 + offset}), {}, 0.5, moving({0.5, 0, -10}, {10, 5, 0})),
        true);
    for (int n = 0; n < 10; ++n) {
      ASSERT_NE(world.step({}, 0.033).status, StepStatus::restored);
      ASSERT_FALSE(overlap(world.body(0), world.body(1))) << "offset " << offset << " step " << n;
      ASSERT_GT(center(world.body(1)).z(), center(world.body(0)).z()) << "offset " << offset << " step " << n;
    }
    EXPECT_LT(momentum(world.body(0)).z(), -0.02);  // hit
  }
}

INSTANTIATE_TEST_SUITE_P(Targets, FastAtBody, ::testing::Values(Kind::soft, Kind::rigid),
                         [](const auto& param) { return param.param == Kind::soft ? "soft" : "rigid"; });

}  // namespace
}  // namespace palpate
