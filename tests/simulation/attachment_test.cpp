// Bodies that the world holds, by fixed nodes and by springs: theory, balance of forces, momentum, energy.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "palpate/common/error.h"
#include "shared/attached_bodies.h"

namespace palpate {
namespace {

using namespace test;

Vec3 weightOf(const Body& body) { return {0, 0, -kDown * body.model.totalMass()}; }

TEST(Attachment, AHangingBarIsLongerByHalfItsWeight) {
  const Vec3 size(0.02, 0.02, 0.16);
  const double e = 1e5;
  BodyModel body("bar", barMesh(size, {2, 2, 16}), material(e));
  body.attach(fixed(body, [&](const Vec3& x) { return x.z() > size.z() - 1e-9; }));
  World world = alone(std::move(body));
  world.settle({0}, {});
  const double sag = -meanHeight(world.body(0), nodesWhere(world.body(0).model.mesh().mesh.nodes, onBottom));
  EXPECT_NEAR(sag, 1000 * kDown * size.z() * size.z() / (2 * e), 0.01 * sag);
}

TEST(Attachment, CarriesTheWeight) {
  BodyModel body = bar({6, 4, 3}, material(2e4));
  body.attach(fixed(body, [](const Vec3& x) { return x.x() < 1e-9; }));
  body.attach(springs(
      body, [](const Vec3& x) { return x.x() > kBarSize.x() - 1e-9; }, 30.0));
  World world = alone(std::move(body));
  world.settle({0}, {});
  // settled to where a step of rest moves it no more
  ASSERT_EQ(world.step({}, 0.033).status, StepStatus::ok);
  const Body b = world.body(0);
  const auto forces = b.system.attachmentForces();
  const Vec3 weight = weightOf(b);
  EXPECT_LT((forces[0].force + forces[1].force + weight).norm(), 1e-5 * weight.norm());
  EXPECT_GT(forces[1].force.z(), 0.01 * weight.norm());
  Vec3 moment = Vec3::Zero();
  for (int i = 0; i < b.model.nodes(); ++i) {
    const Vec3 x = b.state.positions.segment<3>(3 * i);
    moment += x.cross(Vec3(0, 0, -kDown * b.model.elasticity().mass()[i]));
  }
  for (std::size_t k = 0; k < 2; ++k) {
    Vec3 middle = Vec3::Zero();
    for (const int n : b.model.attachments()[k].nodes) middle += b.model.mesh().mesh.nodes[n];
    middle /= static_cast<double>(b.model.attachments()[k].nodes.size());
    moment += forces[k].moment + middle.cross(forces[k].force);
  }
  EXPECT_LT(moment.norm(), 1e-5 * weight.norm() * kBarSize.norm());
}

// In motion, with contact: what attachments, weight and ground give is what the momentum changes by.
TEST(Attachment, MomentumAddsUp) {
  Material m = material(2e4);
  m.poisson_ratio = 0.4;
  BodyModel body = bar({6, 4, 3}, m);
  body.attach(fixed(body, [](const Vec3& x) { return x.x() < 1e-9; }));
  body.attach(springs(body, onTop, 50.0, 0.5));
  World world = alone(std::move(body));
  world.obstacles.push_back(ground());
  BodyState state = world.body(0).state;
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0.0, 0.1);
  for (const int i : world.body(0).model.free()) {
    for (int k = 0; k < 3; ++k) state.velocities[3 * i + k] = normal(random);
  }
  world.setBody(0, state);
  bool touched = false;
  for (int n = 0; n < 30; ++n) {
    const Vec3 before = momentum(world.body(0));
    const double h = 0.004;
    const StepReport report = world.step({}, h);
    if (report.redone > 0 || report.motion_share < 1) continue;
    Vec3 impulse = h * weightOf(world.body(0));
    for (const AttachmentForce& f : world.body(0).system.attachmentForces()) impulse += h * f.force;
    const ContactSet& set = world.contacts();
    for (std::size_t i = 0; i < set.contacts.size(); ++i) {
      impulse += set.contacts[i].frame().transpose() * set.impulse.segment<3>(static_cast<Eigen::Index>(3 * i));
    }
    touched |= report.active > 0;
    EXPECT_LT((momentum(world.body(0)) - before - impulse).norm(), 1e-12 + 1e-9 * impulse.norm()) << "step " << n;
  }
  EXPECT_TRUE(touched);
}

TEST(Attachment, FixedNodesStayAndEnergyFalls) {
  BodyModel body = bar({4, 3, 2}, material(5e3));
  body.attach(fixed(body, [](const Vec3& x) { return x.x() < 1e-9; }));
  const std::vector<int> held = body.attachments()[0].nodes;
  World world = alone(std::move(body));
  world.gravity.setZero();
  BodyState state = world.body(0).state;
  for (const int i : world.body(0).model.free()) state.velocities[3 * i + 2] = 0.3 * state.positions[3 * i];
  world.setBody(0, state);
  double energy = 1e300;
  for (int n = 0; n < 60; ++n) {
    const StepReport report = world.step({}, 0.033);
    ASSERT_EQ(report.status, StepStatus::ok);
    EXPECT_LE(report.kinetic_energy + report.elastic_energy, energy * (1 + 1e-9));
    energy = report.kinetic_energy + report.elastic_energy;
    for (const int i : held) {
      ASSERT_TRUE(world.body(0).state.positions.segment<3>(3 * i) == world.body(0).model.mesh().mesh.nodes[i]);
    }
  }
}

// A stiff body on springs: it sinks by m g / K, and is down half a period after it is let go.
TEST(Attachment, SpringsHaveTheirStiffnessAndPeriod) {
  Material m = material(1e7);
  m.damping_beta = 0;
  BodyModel body = bar({3, 2, 2}, m);
  const double stiffness = 240;
  body.attach(springs(body, onTop, stiffness));
  World world = alone(std::move(body));
  const double mass = world.body(0).model.totalMass(), h = 2e-4;
  int down = 0;
  for (; down < 1000; ++down) {
    ASSERT_EQ(world.step({}, h).status, StepStatus::ok);
    if (momentum(world.body(0)).z() > 0) break;
  }
  EXPECT_NEAR(down * h, std::acos(-1.0) * std::sqrt(mass / stiffness), 0.02 * down * h);
  world.settle({0}, {});
  const std::vector<int> top = world.body(0).model.attachments()[0].nodes;
  EXPECT_NEAR(-meanHeight(world.body(0), top), mass * kDown / stiffness, 1e-4 * mass * kDown / stiffness);
}

// Fixed nodes that lie in the ground have nothing to solve; the others come to rest beside them.
TEST(Attachment, FixedNodesMayLieInTheGround) {
  BodyModel body = bar({6, 4, 3}, material(2e4));
  body.attach(fixed(body, [](const Vec3& x) { return x.z() < 1e-9 && x.x() < 0.5 * kBarSize.x(); }));
  World world = alone(std::move(body));
  world.obstacles.push_back({PlaneShape{{0, 0, 0.002}, Vec3::UnitZ()}, 0.5, "ground"});
  StepReport report;
  for (int n = 0; n < 60; ++n) {
    report = world.step({}, 0.033);
    ASSERT_EQ(report.status, StepStatus::ok);
  }
  EXPECT_LT(report.kinetic_energy, 1e-9);
}

// Fixed nodes on their path to rounding, momentum as at rest, and energy explained by what the driven end did.
TEST(Attachment, IsDriven) {
  for (const bool by_springs : {false, true}) {
    Material m = material(2e4);
    m.poisson_ratio = 0.4;
    BodyModel body = bar({6, 4, 3}, m);
    const auto end = [](const Vec3& x) { return x.x() < 1e-9; };
    Attachment wall = by_springs ? springs(body, end, 200.0, 0.2) : fixed(body, end);
    wall.motion = [](double t) {
      return Pose{Vec3(0, 0.01 * std::sin(9 * t), 0.01 * (1 - std::cos(6 * t))),
                  expRotation({0.3 * std::sin(5 * t), 0, 0})};
    };
    body.attach(wall);
    World world = alone(std::move(body));
    StepReport report;
    const double h = 0.01;
    for (int n = 0; n < 100; ++n) {
      const Body b = world.body(0);
      const Vec3 before = momentum(b);
      report = world.step({}, h);
      ASSERT_EQ(report.status, StepStatus::ok);
      ASSERT_EQ(report.redone, 0);
      EXPECT_LT(report.energy_made, 1e-9);
      const VecX anchors = b.model.anchors(world.state().time);
      if (!by_springs) {
        for (const int i : b.model.attachments()[0].nodes) {
          ASSERT_TRUE(b.state.positions.segment<3>(3 * i) == anchors.segment<3>(3 * i));
        }
      }
      const Vec3 impulse = h * (weightOf(b) + b.system.attachmentForces()[0].force);
      EXPECT_LT((momentum(b) - before - impulse).norm(), 1e-12 + 1e-9 * impulse.norm()) << "step " << n;
    }
    EXPECT_NEAR(world.state().time, 1.0, 1e-12);
  }
}

// A body that is carried along evenly, by its lower side, comes to move with it as a whole: no drag but that of alpha.
TEST(Attachment, CarriesABodyAlong) {
  BodyModel body = bar({4, 3, 2}, material(2e4));
  Attachment wall = fixed(body, onBottom);
  wall.motion = [](double t) { return Pose{Vec3(0.1 * t, 0, 0), Quat::Identity()}; };
  body.attach(wall);
  World world = alone(std::move(body));
  for (int n = 0; n < 120; ++n) ASSERT_EQ(world.step({}, 0.033).status, StepStatus::ok);
  const Body b = world.body(0);
  for (int i = 0; i < b.model.nodes(); ++i) {
    EXPECT_LT((b.state.velocities.segment<3>(3 * i) - Vec3(0.1, 0, 0)).norm(), 1e-4);
  }
  EXPECT_LT((b.system.attachmentForces()[0].force + weightOf(b)).norm(), 1e-3 * weightOf(b).norm());
}

// A tool that is fixed to the world by its lower end.
World betweenHandAndWorld() {
  BodyModel body = bar({6, 4, 3}, material(2e4));
  body.attach(fixed(body, onBottom));
  holdNodes(body, onTop, kPlainHandle);
  World world = alone(std::move(body));
  world.link = {500, 1, 1, 1e-3};
  return world;
}

TEST(Attachment, AToolMayBeHeldByTheWorldToo) {
  World world = betweenHandAndWorld();
  const Pose start = world.tool().state.handle.pose;
  world.settle({0}, start);
  Pose lifted = start;
  lifted.position.z() += 0.005;
  for (int n = 0; n < 60; ++n) ASSERT_EQ(world.step({lifted, Vec6::Zero()}, 0.033).status, StepStatus::ok);
  const Body tool = world.tool();
  const Vec6 link =
      linkWrenchOnDevice(world.link, tool.state.handle.pose, tool.state.handle.twist, lifted, Vec6::Zero());
  const auto forces = tool.system.attachmentForces();
  EXPECT_LT((forces[0].force - link.head<3>() + weightOf(tool)).norm(), 1e-4);
  EXPECT_LT(forces[0].force.z(), -0.1);  // it pulls down
}

// Static equilibrium is that of the steps: a hand that is far off pulls with the link's limits there, too.
TEST(Attachment, SettlesUnderALinkThatSaturates) {
  World world = betweenHandAndWorld();
  world.link.peak_force = 0.8;
  world.link.peak_torque = 0.01;
  Pose device = world.tool().state.handle.pose;
  device.position += Vec3(0.02, 0, 0.01);
  device.rotation = expRotation({0, 0.2, 0}) * device.rotation;
  world.settle({0}, device);
  const Pose settled = world.tool().state.handle.pose;
  const Vec6 wrench = saturatedWrenchOnDevice(world.link, settled, Vec6::Zero(), device, Vec6::Zero());
  EXPECT_NEAR(wrench.head<3>().norm(), 0.8, 1e-9);
  EXPECT_NEAR(wrench.tail<3>().norm(), 0.01, 1e-9);
  for (int n = 0; n < 30; ++n) ASSERT_EQ(world.step({device, Vec6::Zero()}, 0.033).status, StepStatus::ok);
  const Vec6 moved = poseDifference(world.tool().state.handle.pose, settled);
  EXPECT_LT(moved.head<3>().norm(), 1e-6);
  EXPECT_LT(moved.tail<3>().norm(), 1e-4);
}

TEST(Attachment, RefusesWhatCannotBe) {
  BodyModel body = bar({2, 2, 2}, material(2e4));
  body.attach(fixed(body, onBottom));
  EXPECT_THROW(body.attach(fixed(body, onBottom, "again")), InputError);
  EXPECT_THROW(holdNodes(body, onBottom, kPlainHandle), InputError);
  EXPECT_THROW(body.attach(fixed(
                   body, [](const Vec3& x) { return x.z() > 1e-9; }, "rest")),
               InputError);
}

}  // namespace
}  // namespace palpate
