// A rigid tool in the hand: it has a handle frame and nothing else.
#include <gtest/gtest.h>

#include "shared/held_scenes.h"

namespace palpate {
namespace {

using namespace test;

World heldBall() {
  World world;
  world.link = {500, 2, 1, 1e-3};
  BodyModel ball = BodyModel::rigid("probe", sphereSurface(0.01), 2000);
  ball.holdRigid("grip", 0.02, Vec3::Zero(), expRotation({0.3, -0.2, 0.1}));
  world.add(std::move(ball));
  return world;
}

TEST(RigidTool, HangsOnTheLink) {
  World world = heldBall();
  const Pose start = world.tool().state.handle.pose;
  EXPECT_NEAR(world.tool().model.totalMass(), 0.02 + 2000 * 4.19e-6, 0.0005);
  world.settle({0}, start);
  const double weight = 9.81 * world.tool().model.totalMass();
  EXPECT_NEAR(start.position.z() - world.tool().state.handle.pose.position.z(), weight / 500, 1e-9);
}

// Pressed on a table: link, weight and contact balance, and the handle is where the device wants it but for the link.
TEST(RigidTool, PressesOnATable) {
  World world = heldBall();
  world.obstacles.push_back({PlaneShape{{0, 0, -0.0101}, Vec3::UnitZ()}, 0.5, "table"});
  Pose device = world.tool().state.handle.pose;
  device.position.z() -= 0.004;
  for (int n = 0; n < 60; ++n) ASSERT_EQ(world.step({device, Vec6::Zero()}, 0.033).status, StepStatus::ok);
  const Body tool = world.tool();
  const ContactSet& set = world.contacts();
  Vec3 contact = Vec3::Zero();
  for (std::size_t i = 0; i < set.contacts.size(); ++i) {
    contact += set.contacts[i].frame().transpose() * set.impulse.segment<3>(static_cast<Eigen::Index>(3 * i)) / 0.033;
  }
  const Vec6 on_device =
      linkWrenchOnDevice(world.link, tool.state.handle.pose, tool.state.handle.twist, device, Vec6::Zero());
  const double weight = 9.81 * tool.model.totalMass();
  EXPECT_NEAR(contact.z(), on_device[2] + weight, 1e-6);
  EXPECT_GT(contact.z(), 1.5);
  EXPECT_NEAR(tool.state.handle.pose.position.z(), 0, 0.0005);
}

}  // namespace
}  // namespace palpate
