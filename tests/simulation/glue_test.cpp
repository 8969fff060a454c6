// Bodies that are glued to each other: against one body, balance of forces, momentum, contact beside the joint, state.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "palpate/common/error.h"
#include "shared/attached_bodies.h"
#include "shared/pair_scenes.h"

namespace palpate {
namespace {

using namespace test;

const Vec3 kSize(0.08, 0.02, 0.02);  // [m]

template <class Region>
Attachment glued(const BodyModel& body, const Region& region, const std::string& name = "joint") {
  Attachment out = fixed(body, region, name);
  out.glued = true;
  return out;
}

BodyModel barAt(const std::string& name, const Vec3& size, const std::array<int, 3>& cells, double x,
                const Material& m = material(3e5)) {
  return {name, moved(barMesh(size, cells), at({x, 0, 0})), m};
}

bool atWall(const Vec3& x) { return x.x() < 1e-9; }
bool atJoint(const Vec3& x) { return std::abs(x.x() - 0.5 * kSize.x()) < 1e-9; }
bool atTip(const Vec3& x) { return x.x() > kSize.x() - 1e-9; }

/// A bar that a wall holds, of two halves; cells are a half's.
World halves(const std::array<int, 3>& first, const std::array<int, 3>& second, bool wall = true) {
  World world;
  world.gravity = {0, 0, -kDown};
  const Vec3 half(0.5 * kSize.x(), kSize.y(), kSize.z());
  BodyModel a = barAt("near", half, first, 0), b = barAt("far", half, second, half.x());
  if (wall) a.attach(fixed(a, atWall));
  b.attach(glued(b, atJoint));
  world.add(std::move(a));
  world.add(std::move(b));
  world.glue(1, 0, 0);
  return world;
}

World whole(const std::array<int, 3>& cells) {
  BodyModel bar = barAt("bar", kSize, cells, 0);
  bar.attach(fixed(bar, atWall));
  return alone(std::move(bar));
}

double tip(const Body& body) { return meanHeight(body, nodesWhere(body.model.mesh().mesh.nodes, atTip)); }

double largestGap(const World& world) {
  double largest = 0;
  for (const Joint& joint : world.joints()) {
    const Body own = world.body(joint.body);
    const std::vector<int>& nodes = own.model.attachments()[joint.attachment].nodes;
    for (std::size_t k = 0; k < nodes.size(); ++k) {
      const Vec3 x = own.state.positions.segment<3>(3 * nodes[k]);
      largest = std::max(largest, (x - joint.places[k].at(world.body(joint.partner).state.positions)).norm());
    }
  }
  return largest;
}

Vec3 weight(const Body& body) { return {0, 0, -kDown * body.model.totalMass()}; }

// Of the same mesh they are the same bar.
TEST(Glue, TwoHalvesAreABar) {
  World two = halves({6, 3, 3}, {6, 3, 3}), one = whole({12, 3, 3});
  two.settle({0, 1}, {});
  one.settle({0}, {});
  EXPECT_LT(tip(one.body(0)), -1e-4);
  EXPECT_NEAR(tip(two.body(1)), tip(one.body(0)), 1e-6 * std::abs(tip(one.body(0))));
  ASSERT_EQ(two.step({}, 0.01).status, StepStatus::ok);
  const Vec3 held = two.body(0).system.attachmentForces()[0].force;
  const Vec3 joint = two.body(1).system.attachmentForces()[0].force;
  EXPECT_LT((joint + weight(two.body(1))).norm(), 1e-5 * joint.norm());
  EXPECT_LT((held + weight(two.body(0)) + weight(two.body(1))).norm(), 1e-5 * held.norm());
}

TEST(Glue, TwoHalvesSwingAsABar) {
  World two = halves({6, 3, 3}, {6, 3, 3}), one = whole({12, 3, 3});
  for (int n = 0; n < 60; ++n) {
    const StepReport report = two.step({}, 0.01);
    ASSERT_EQ(report.status, StepStatus::ok);
    EXPECT_EQ(report.contacts, 0);
    EXPECT_EQ(report.active, 0);
    EXPECT_EQ(report.redone, 0);
    EXPECT_LT(report.energy_made, 1e-12);
    ASSERT_EQ(one.step({}, 0.01).status, StepStatus::ok);
    EXPECT_NEAR(tip(two.body(1)), tip(one.body(0)), 1e-9) << "step " << n;
    EXPECT_LT(largestGap(two), 1e-14);
  }
}

// Meshes that do not fit: between the coarse bar and the fine one.
TEST(Glue, OtherMeshesBendAsWellWithinRefinement) {
  World coarse = whole({8, 2, 2}), fine = whole({12, 3, 3}), two = halves({4, 2, 2}, {6, 3, 3}),
        turned = halves({6, 3, 3}, {4, 2, 2});
  coarse.settle({0}, {});
  fine.settle({0}, {});
  const double c = tip(coarse.body(0)), f = tip(fine.body(0));
  for (World* world : {&two, &turned}) {
    world->settle({0, 1}, {});
    EXPECT_NEAR(tip(world->body(1)), 0.5 * (c + f), std::abs(f - c));
  }
}

// What one body gets through the joint, the other gives; of all together nothing is lost.
TEST(Glue, MomentumIsKept) {
  World world = halves({4, 2, 2}, {5, 3, 3}, false);
  world.gravity.setZero();
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0.0, 0.1);
  for (int b = 0; b < 2; ++b) {
    BodyState state = world.body(b).state;
    for (double& v : state.velocities) v = normal(random);
    world.setBody(b, state);
  }
  for (int n = 0; n < 40; ++n) {
    const Vec3 first = momentum(world.body(0)), second = momentum(world.body(1));
    const double h = n % 2 == 0 ? 0.005 : 0.033;
    const StepReport report = world.step({}, h);
    ASSERT_NE(report.status, StepStatus::restored);
    const Vec3 all = momentum(world.body(0)) + momentum(world.body(1));
    EXPECT_LT((all - first - second).norm(), 1e-9 * (first.norm() + second.norm()) + 1e-12) << "step " << n;
    if (report.redone > 0) continue;
    const Vec3 impulse = h * world.body(1).system.attachmentForces()[0].force;
    EXPECT_LT((momentum(world.body(1)) - second - impulse).norm(), 1e-9 * impulse.norm() + 1e-12) << "step " << n;
    EXPECT_LT((momentum(world.body(0)) - first + impulse).norm(), 1e-9 * impulse.norm() + 1e-12) << "step " << n;
  }
}

// A block that is glued upon a rigid plate, which lies on the ground: each carries what is above.
TEST(Glue, ASoftBlockStandsOnARigidPlate) {
  World world;
  world.gravity = {0, 0, -kDown};
  world.obstacles.push_back(ground());
  world.add(box(Kind::rigid, "plate", {0.06, 0.06, 0.01}, at({0, 0, 0.005})));
  BodyModel block = box(Kind::soft, "block", {0.03, 0.03, 0.04}, at({0, 0, 0.03}), {{3, 3, 4}});
  block.attach(glued(block, [](const Vec3& x) { return x.z() < 0.01 + 1e-9; }));
  world.add(std::move(block));
  world.glue(1, 0, 0);
  world.settle({1}, {});
  StepReport report;
  for (int n = 0; n < 40; ++n) {
    report = world.step({}, 0.02);
    ASSERT_EQ(report.status, StepStatus::ok);
  }
  EXPECT_LT(report.kinetic_energy, 1e-10);
  EXPECT_LT(largestGap(world), 1e-9);
  const Vec3 joint = world.body(1).system.attachmentForces()[0].force;
  EXPECT_LT((joint + weight(world.body(1))).norm(), 1e-4 * joint.norm());
  const ContactSet& set = world.contacts();
  Vec3 from_ground = Vec3::Zero();
  for (std::size_t i = static_cast<std::size_t>(set.glued); i < set.contacts.size(); ++i) {
    EXPECT_LT(set.contacts[i].second.body, 0);  // none between plate and block
    from_ground +=
        set.contacts[i].frame().transpose() * set.impulse.segment<3>(static_cast<Eigen::Index>(3 * i)) / 0.02;
  }
  EXPECT_LT((from_ground + weight(world.body(0)) + weight(world.body(1))).norm(), 1e-3 * from_ground.norm());
}

// A rigid body that hangs on a soft one swings through half a circle and stays where it is glued.
TEST(Glue, ARigidBodyHangsOnASoftOne) {
  World world;
  world.gravity = {0, 0, -kDown};
  world.add(box(Kind::rigid, "weight", {0.02, 0.02, 0.02}, at({0.11, 0, 0})));
  BodyModel rope = box(Kind::soft, "rope", {0.1, 0.01, 0.01}, at({0.05, 0, 0}), {{10, 1, 1}, 1e5});
  rope.attach(fixed(rope, atWall));
  rope.attach(glued(rope, [](const Vec3& x) { return x.x() > 0.1 - 1e-9; }));
  world.add(std::move(rope));
  world.glue(1, 1, 0);
  double lowest = 0, made = 0;
  for (int n = 0; n < 60; ++n) {
    const StepReport report = world.step({}, 0.01);
    ASSERT_NE(report.status, StepStatus::restored);
    lowest = std::min(lowest, world.body(0).state.handle.pose.position.z());
    made += report.energy_made;
    EXPECT_LT(largestGap(world), 1e-4) << "step " << n;
  }
  EXPECT_LT(lowest, -0.06);
  EXPECT_LT(made, 1e-5);
}

// Two arms of a fork, glued at one end, whose other ends are pressed together and touch.
TEST(Glue, TouchesBesideTheJoint) {
  World world;
  world.gravity.setZero();
  BodyModel low = box(Kind::soft, "low", {0.08, 0.02, 0.01}, at({0.04, 0, 0.005}), {{8, 2, 1}});
  low.attach(fixed(low, [](const Vec3& x) { return x.z() < 1e-9; }));
  // a foot that stands on the lower arm, and an arm that is 4 mm above it
  const SimulationMesh bar = moved(barMesh({0.08, 0.02, 0.014}, {8, 2, 7}), at({0, -0.01, 0.01}));
  TetrahedralMesh arm;
  std::vector<int> number(bar.mesh.nodes.size(), -1);
  for (auto t : bar.mesh.tetrahedra) {
    Vec3 center = Vec3::Zero();
    for (const int n : t) center += 0.25 * bar.mesh.nodes[n];
    if (center.x() > 0.02 && center.z() < 0.014) continue;
    for (int& n : t) {
      if (number[n] < 0) {
        number[n] = static_cast<int>(arm.nodes.size());
        arm.nodes.push_back(bar.mesh.nodes[n]);
      }
      n = number[n];
    }
    arm.tetrahedra.push_back(t);
  }
  BodyModel high("high", simulationMeshOf(arm), material(5e4));
  high.attach(glued(high, [](const Vec3& x) { return x.z() < 0.01 + 1e-9; }));
  const auto tip_nodes = nodesWhere(high.mesh().mesh.nodes, [](const Vec3& x) { return x.x() > 0.08 - 1e-9; });
  world.add(std::move(low));
  world.add(std::move(high));
  world.glue(1, 0, 0);
  for (int n = 0; n < 10; ++n) {
    const StepReport report = world.step({}, 0.01);
    ASSERT_EQ(report.status, StepStatus::ok);
    EXPECT_EQ(report.contacts, 0);  // nothing touches around the joint
  }
  world.gravity = {0, 0, -40.0};
  int touched = 0;
  for (int n = 0; n < 60; ++n) {
    const StepReport report = world.step({}, 0.01);
    ASSERT_NE(report.status, StepStatus::restored);
    touched += report.active > 0 ? 1 : 0;
    EXPECT_LT(largestGap(world), 1e-9);
  }
  EXPECT_GT(touched, 40);
  const ContactSet& set = world.contacts();
  double up = 0;
  for (std::size_t i = static_cast<std::size_t>(set.glued); i < set.contacts.size(); ++i) {
    EXPECT_GT(set.contacts[i].position.x(), 0.04);
    up +=
        (set.contacts[i].frame().transpose() * set.impulse.segment<3>(static_cast<Eigen::Index>(3 * i))).norm() / 0.01;
  }
  EXPECT_GT(up, 0.1 * 40 * world.body(1).model.totalMass());
  for (const int n : tip_nodes) EXPECT_GT(world.body(1).state.positions[3 * n + 2], 0.009);
}

// What a large joint costs in every step is no sign of a hard one: nothing is given up, done again or cut.
TEST(Glue, ALargeJointLeavesTheBudgetToContact) {
  constexpr double kSpan = 0.06, kHeight = 0.015;  // [m]
  const auto slab = [&](const std::string& name, double z) {
    return BodyModel(name, moved(barMesh({kSpan, kSpan, kHeight}, {8, 8, 2}), at({0, 0, z})), material(5e4));
  };
  World world;
  world.gravity = {0, 0, -kDown};
  BodyModel low = slab("low", 0), high = slab("high", kHeight);
  low.attach(fixed(low, [](const Vec3& x) { return x.z() < 1e-9; }));
  high.attach(glued(high, [&](const Vec3& x) { return x.z() < kHeight + 1e-9; }));
  world.add(std::move(low));
  world.add(std::move(high));
  world.add(box(Kind::rigid, "load", {0.02, 0.02, 0.01}, at({0.03, 0.03, 2 * kHeight + 0.006})));
  world.glue(1, 0, 0);
  world.budget = StepBudget::counted(0.003);
  int touched = 0;
  for (int n = 0; n < 20; ++n) {
    const StepReport report = world.step({}, 0.01);
    ASSERT_EQ(report.status, StepStatus::ok) << "step " << n;
    touched += report.active > 0 ? 1 : 0;
    if (n == 0) continue;  // orders nodes, and meets the load
    EXPECT_EQ(report.redone, 0) << "step " << n;
    EXPECT_EQ(report.motion_share, 1.0) << "step " << n;
  }
  EXPECT_GT(touched, 5);
}

// A world that goes on from a saved state does the same to the bit.
TEST(Glue, StateIsSavedAndRestored) {
  const auto make = [] {
    World world = halves({4, 2, 2}, {5, 3, 3});
    world.obstacles.push_back({PlaneShape{{0, 0, -0.0001}, Vec3::UnitZ()}, 0.5, "ground"});
    return world;
  };
  World first = make(), second = make();
  for (int n = 0; n < 12; ++n) (void)first.step({}, 0.01);
  const std::string saved = toBytes(first.state());
  second.restore(worldStateFrom(saved));
  int touched = 0;
  for (int n = 0; n < 25; ++n) {
    touched += first.step({}, 0.01).active > 0 ? 1 : 0;
    (void)second.step({}, 0.01);
    ASSERT_TRUE(sameBits(first.state(), second.state())) << "step " << n;
  }
  EXPECT_GT(touched, 0);
}

// Nodes that are glued to fixed ones are fixed.
TEST(Glue, HoldsToWhatIsFixed) {
  const Vec3 half(0.5 * kSize.x(), kSize.y(), kSize.z());
  BodyModel wall = barAt("wall", half, {2, 2, 2}, 0), bar = barAt("bar", half, {5, 3, 3}, half.x());
  wall.attach(fixed(wall, [&](const Vec3& x) { return x.x() > 1e-9; }));
  bar.attach(glued(bar, atJoint));
  World world;
  world.gravity = {0, 0, -kDown};
  world.add(std::move(wall));
  world.add(std::move(bar));
  world.glue(1, 0, 0);
  BodyModel other = barAt("bar", half, {5, 3, 3}, half.x());
  other.attach(fixed(other, atJoint));
  World alike = alone(std::move(other));
  for (int n = 0; n < 20; ++n) {
    ASSERT_EQ(world.step({}, 0.01).status, StepStatus::ok);
    ASSERT_EQ(alike.step({}, 0.01).status, StepStatus::ok);
    EXPECT_LT((world.body(1).state.positions - alike.body(0).state.positions).norm(), 1e-10);
    const Vec3 force = alike.body(0).system.attachmentForces()[0].force;
    EXPECT_LT((world.body(1).system.attachmentForces()[0].force - force).norm(), 1e-6 * force.norm());
  }
}

// What was pulled apart from outside comes together again, at a bounded speed.
TEST(Glue, ClosesWhatWasTornOpen) {
  World world = halves({4, 2, 2}, {4, 2, 2});
  world.gravity.setZero();
  BodyState state = world.body(1).state;
  for (Eigen::Index k = 0; k < state.positions.size(); k += 3) state.positions[k] += 0.02;
  world.setBody(1, state);
  const double h = 0.01;
  const double rate = world.contact.max_recovery_speed * h;
  double before = largestGap(world);
  EXPECT_NEAR(before, 0.02, 1e-12);
  for (int n = 0; n < 30; ++n) {
    ASSERT_NE(world.step({}, h).status, StepStatus::restored);
    const double now = largestGap(world);
    EXPECT_LE(now, std::max(before - 0.99 * rate, 1e-12)) << "step " << n;
    EXPECT_GE(now, before - 1.01 * rate - 1e-12);
    before = now;
  }
}

TEST(Glue, RefusesWhatCannotBe) {
  const Vec3 half(0.5 * kSize.x(), kSize.y(), kSize.z());
  const auto refused = [](World& world, int body, int attachment, int partner, const char* word) {
    try {
      world.glue(body, attachment, partner);
      ADD_FAILURE() << "not refused: " << word;
    } catch (const InputError& e) {
      EXPECT_NE(std::string(e.what()).find(word), std::string::npos) << e.what();
    }
  };
  World world;
  BodyModel a = barAt("near", half, {2, 2, 2}, 0), b = barAt("far", half, {2, 2, 2}, half.x());
  a.attach(glued(a, atJoint));
  b.attach(glued(b, atJoint));
  b.attach(glued(b, atTip, "tip"));
  EXPECT_THROW(b.attach(fixed(b, atTip, "again")), InputError);
  EXPECT_THROW(b.attach(glued(b, atTip, "again")), InputError);
  EXPECT_THROW(holdNodes(b, atTip, kPlainHandle), InputError);
  world.add(std::move(a));
  world.add(std::move(b));
  world.glue(1, 0, 0);
  refused(world, 0, 0, 1, "glued to them");
  World other;
  BodyModel c = barAt("near", half, {2, 2, 2}, 0), d = barAt("far", half, {2, 2, 2}, half.x());
  d.attach(glued(d, atTip, "tip"));
  other.add(std::move(c));
  other.add(std::move(d));
  refused(other, 1, 0, 0, "mean edge");
  refused(other, 1, 0, 1, "itself");
}

// Contact would push apart what glue holds together: a block that is sunk in what it carries.
TEST(Glue, BodiesInsideEachOtherDoNotTouch) {
  for (const double sunk : {0.0, 0.005, 0.01, 0.02}) {
    World world;
    world.gravity = {0, 0, -kDown};
    world.obstacles.push_back({PlaneShape{}, 0.4, "ground"});
    world.add(
        BodyModel::rigid("block", placed(boxSurface({0.08, 0.08, 0.03}, {3, 3, 2}), at({0, 0, 0.015})), 2000, 0.4));
    BodyModel organ("organ", moved(barMesh({0.06, 0.06, 0.03}, {4, 4, 3}), at({-0.03, -0.03, 0.03 - sunk})),
                    material(4e4));
    organ.attach(glued(organ, [&](const Vec3& x) { return x.z() < 0.03 - sunk + 1e-9; }));
    world.add(std::move(organ));
    EXPECT_EQ(world.glue(1, 0, 0), sunk > 0.0099);
    for (int n = 0; n < 60; ++n) {
      const StepReport report = world.step({}, 0.033);
      ASSERT_EQ(report.status, StepStatus::ok) << n;
      EXPECT_EQ(report.energy_made, 0);
    }
    EXPECT_LT(world.body(1).state.velocities.cwiseAbs().maxCoeff(), 1e-3);
    EXPECT_LT(largestGap(world), 1e-6);
  }
}

}  // namespace
}  // namespace palpate
