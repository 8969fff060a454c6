#include "palpate/reduction/reduce.h"

#include <gtest/gtest.h>

#include "palpate/live/live_tick.h"
#include "palpate/math/decompositions.h"
#include "palpate/math/rotation.h"
#include "palpate/mesh/shapes.h"
#include "palpate/reduction/contact_clusters.h"
#include "palpate/reduction/partner_reduction.h"
#include "shared/held_scenes.h"
#include "shared/pair_scenes.h"

namespace palpate {
namespace {

using namespace test;

// A bar held by its top, pressed a little onto the ground, or something else there, and shifted.
struct Pressed {
  World world;
  Material material;
  explicit Pressed(const Quat& turn = Quat::Identity(), const std::optional<Obstacle>& other = {}) {
    material.youngs_modulus = 2e4;
    material.damping_beta = 0.002;
    BodyModel body = bar({4, 3, 3}, material);
    if (!turn.isApprox(Quat::Identity())) {
      body = BodyModel("bar", moved(barMesh(kBarSize, {4, 3, 3}), {Vec3::Zero(), turn}), material);
    }
    const auto held = [&](const Vec3& p) { return onTop(turn.conjugate() * p); };
    HandleOptions options = kPlainHandle;
    options.rotation = turn;
    options.inertia = Vec3(1e-5, 2e-5, 3e-5);
    holdNodes(body, held, options);
    world.link = {700, 5, 1.0, 0.005};
    world.gravity = turn * Vec3(0, 0, -9.81);
    Obstacle plane = ground();
    std::get<PlaneShape>(plane.shape).normal = turn * Vec3::UnitZ();
    world.obstacles = {other.value_or(plane)};
    world.contact.cone.exact = true;  // a polyhedral one has directions of its own
    world.add(std::move(body));
    DeviceTarget target{world.tool().state.handle.pose};
    for (int k = 1; k <= 60; ++k) {
      const double share = std::min(1.0, k / 40.0);
      Vec6 way = Vec6::Zero();
      way.head<3>() = turn * (share * Vec3(0.002, 0.001, -0.004));
      const DeviceTarget now{advance(target.pose, way), Vec6::Zero()};
      if (world.step(now, 0.033).failed()) ADD_FAILURE();
    }
  }
  LiveModel reduced(const LiveSettings& settings, LiveBasis& basis) {
    ToolReduction reduction;
    DampedForces damped;
    dampForces(world, 1e3, damped);
    const ToolShape shape = toolShape(world);
    return reduction.reduce(world, settings, {shape, damped, MatX(), 0.033, {}, {}}, basis);
  }
};

// K of the free nodes, dense, world frame.
MatX stiffness(const World& world) {
  const BodyModel& tool = world.tool().model;
  SymmetricBlockMatrix a = tool.pattern();
  ElasticState elastic = world.tool().state.elastic;
  tool.elasticity().updateRotations(world.tool().state.positions, elastic);
  tool.elasticity().assemble(0.0, 1.0, elastic, a);
  return a.multiplyColumns(MatX::Identity(3 * a.size, 3 * a.size));
}

TEST(Reduction, ModesAreThoseOfTheDenseProblem) {
  Pressed scene;
  LiveSettings settings;
  settings.modes = 8;
  LiveBasis basis;
  const LiveModel model = scene.reduced(settings, basis);
  ASSERT_TRUE(isFinite(model));
  const BodyModel& tool = scene.world.tool().model;
  const VecX mass = freeMasses(tool);
  const MatX m = mass.asDiagonal();
  const SymmetricEigen exact = symmetricEigen(stiffness(scene.world), m);
  for (int k = 0; k < settings.modes; ++k) {
    EXPECT_NEAR(model.squared_frequency[k] / exact.values[k], 1.0, 0.02) << k;
  }
  EXPECT_LT((basis.modes.transpose() * mass.asDiagonal() * basis.modes - MatX::Identity(8, 8)).norm(), 1e-9);
}

// What the model says of momentum and of forces of rotation, against sums over the nodes.
TEST(Reduction, InertiaIsThatOfThePoints) {
  Pressed scene(Quat(Eigen::AngleAxisd(0.7, Vec3(1, 2, -1).normalized())));
  LiveBasis basis;
  const LiveModel model = scene.reduced({}, basis);
  const Body tool = scene.world.tool();
  const VecX mass = freeMasses(tool.model);
  const Eigen::Index r = basis.modes.cols();
  ASSERT_GT(r, 4);
  const Vec3 v(0.3, -0.2, 0.5), w(2, -3, 1);
  VecX rate(r);
  for (Eigen::Index k = 0; k < r; ++k) rate[k] = 0.1 / (1.0 + static_cast<double>(k)) - 0.03;
  const VecX swing = basis.modes * rate;

  const Handle& handle = tool.model.handle();
  Vec3 p = handle.mass * v, l = handle.inertia * w;
  Vec3 coriolis_torque = Vec3::Zero();
  double whole = handle.mass;
  VecX centrifugal = VecX::Zero(mass.size()), coriolis = VecX::Zero(mass.size());
  for (int i = 0; i < tool.model.freeNodes(); ++i) {
    const double m = mass[3 * i];
    const Vec3 y = basis.places.segment<3>(3 * i), s = swing.segment<3>(3 * i);
    const Vec3 moving = m * (v + w.cross(y) + s);
    whole += m;
    p += moving;
    l += y.cross(moving);
    centrifugal.segment<3>(3 * i) = m * w.cross(w.cross(y));
    coriolis.segment<3>(3 * i) = m * w.cross(s);
    coriolis_torque += y.cross(m * w.cross(s));
  }
  Vec6 momentum, twist, expected;
  twist << v, w;
  momentum = model.inertia * twist + model.coupling * rate;
  expected << p, l;
  EXPECT_NEAR(model.mass, whole, 1e-14 * whole);
  EXPECT_LT((momentum - expected).norm(), 1e-12 * expected.norm());
  Vec6 squares;
  squares << w[0] * w[0], w[1] * w[1], w[2] * w[2], w[0] * w[1], w[0] * w[2], w[1] * w[2];
  VecX seen = model.centrifugal * squares, sums = basis.modes.transpose() * centrifugal;
  EXPECT_LT((seen - sums).norm(), 1e-12 * sums.norm());
  seen = VecX::Zero(r);
  Vec3 torque = Vec3::Zero();
  for (int k = 0; k < 3; ++k) {
    seen += w[k] * (model.coriolis[k] * rate);
    torque += w[k] * (model.coriolis_torque[k] * rate);
  }
  sums = basis.modes.transpose() * coriolis;
  EXPECT_LT((seen - sums).norm(), 1e-12 * sums.norm());
  EXPECT_LT((torque - coriolis_torque).norm(), 1e-12 * coriolis_torque.norm());
}

// A long horizon: what modes and W give together is the static compliance, for any number of modes.
TEST(Reduction, GivesTheWholeStaticCompliance) {
  Pressed scene;
  const MatX k = stiffness(scene.world);
  const Mat3 rotation = scene.world.tool().state.handle.pose.matrix();
  for (const int modes : {0, 3, 8}) {
    LiveSettings settings;
    settings.modes = modes;
    settings.horizon = 100.0;
    LiveBasis basis;
    const LiveModel model = scene.reduced(settings, basis);
    ASSERT_GT(model.contacts, 4);
    MatX whole = model.tool_compliance;
    whole += model.shape * model.squared_frequency.cwiseInverse().asDiagonal() * model.shape.transpose();
    // its quadratic form on random loads at the contacts, against the dense solution
    const Body tool = scene.world.tool();
    double seen = 0;
    for (int i = 0; i < model.contacts; ++i) {
      // the contact's nodes again, from its place: the bottom's vertices are nodes
      const Vec3 place = tool.state.handle.pose.apply(model.arm.segment<3>(3 * i));
      for (int r = 0; r < tool.model.freeNodes(); ++r) {
        const Vec3 x = tool.state.positions.segment<3>(3 * tool.model.free()[r]);
        if ((x - place).norm() > 1e-9) continue;
        VecX load = VecX::Zero(k.rows());
        load.segment<3>(3 * r) = Vec3::UnitZ();
        const Vec3 expected = solveSymmetric(k, load).middleRows<3>(3 * r);
        const Vec3 given = rotation * whole.block<3, 3>(3 * i, 3 * i) * rotation.transpose() * Vec3::UnitZ();
        EXPECT_LT((given - expected).norm(), 1e-3 * expected.norm()) << modes;
        ++seen;
      }
    }
    EXPECT_GT(seen, 0);
  }
}

// The modes' stiffness under the stress that presses the bar, against differences of the elastic forces; with a second
// order too, whose contacts' forces work on the way that it gives their places: that is in it once.
TEST(Reduction, ModesKnowTheStressThatTheyAreUnder) {
  for (const int second : {0, 3}) {
    Pressed scene;
    LiveSettings settings;
    settings.modes = 6;
    settings.second_order = second;
    LiveBasis basis;
    const LiveModel model = scene.reduced(settings, basis);
    ASSERT_GT(model.contact_force.norm(), 0.5);
    const Body tool = scene.world.tool();
    const ElasticMesh& fem = tool.model.elasticity();
    const Mat3 turn = tool.state.handle.pose.matrix();
    const auto forcesAt = [&](const VecX& way) {
      VecX x = tool.state.positions, f, own(way.size());
      for (int r = 0; r < tool.model.freeNodes(); ++r) {
        x.segment<3>(3 * tool.model.free()[r]) += turn * way.segment<3>(3 * r);
      }
      fem.forces(x, fem.stateAt(x), f);
      for (int r = 0; r < tool.model.freeNodes(); ++r) {
        own.segment<3>(3 * r) = turn.transpose() * f.segment<3>(3 * tool.model.free()[r]);
      }
      return own;
    };
    MatX exact(6, 6);
    for (int k = 0; k < 6; ++k) {
      const double amplitude = 1e-6 / basis.modes.col(k).cwiseAbs().maxCoeff();
      const VecX way = amplitude * basis.modes.col(k);
      exact.col(k) = basis.modes.transpose() * (forcesAt(-way) - forcesAt(way)) / (2 * amplitude);
    }
    MatX given = model.turning;
    given.diagonal() += model.squared_frequency;
    EXPECT_GE(symmetricEigen(given).values[0], -1e-6);
    for (int i = 0, c = 0; i < second; ++i) {
      for (int j = i; j < second; ++j, ++c) {
        const double work = model.contact_force.dot(model.curvature.col(c));
        given(i, j) -= work;
        if (i != j) given(j, i) -= work;
      }
    }
    EXPECT_LT((given - exact).norm(), 1e-3 * exact.norm()) << second;
    EXPECT_GT(model.turning.norm(), 0.02 * model.squared_frequency.norm()) << "what the test is for";
  }
}

TEST(Reduction, ComplianceIsSymmetricAndPositive) {
  Pressed scene;
  LiveBasis basis;
  const LiveModel model = scene.reduced({}, basis);
  const MatX w = model.compliance;
  EXPECT_LT((w - w.transpose()).norm(), 1e-12 * w.norm());
  EXPECT_GE(symmetricEigen(w).values.minCoeff(), 0.99e-7);
}

// What hangs 3 cm above the ground, at rest, is ready for a hand that starts at once: up to as many contacts as a model
// has, the nearest. 10 cm above it nothing is.
TEST(Reduction, AGroundThatASuddenHandWouldMeetIsKnown) {
  for (const double height : {0.03, 0.1}) {
    Material material;
    material.youngs_modulus = 2e4;
    BodyModel body = bar({4, 3, 3}, material);
    holdNodes(body, onTop, kPlainHandle);
    World world;
    Obstacle plane = ground();
    std::get<PlaneShape>(plane.shape).point = Vec3(0, 0, -height);
    world.obstacles = {plane};
    world.gravity.setZero();
    world.add(std::move(body));
    ASSERT_EQ(world.step({world.tool().state.handle.pose, Vec6::Zero()}, 0.033).status, StepStatus::ok);
    ToolReduction reduction;
    for (const int contacts : {4, 16}) {
      LiveSettings settings;
      settings.contacts = contacts;
      LiveBasis basis;
      const LiveModel m = reduction.reduce(world, settings, {toolShape(world), {}, MatX(), 0.033, {}, {}}, basis);
      ASSERT_TRUE(isFinite(m));
      EXPECT_EQ(m.contacts, height < 0.05 ? contacts : 0);
      for (int i = 0; i < m.contacts; ++i) {
        EXPECT_NEAR(m.pose.apply(m.arm.segment<3>(3 * i)).z() - m.surface[i].a.z(), height, 1e-3);
      }
    }
  }
}

// The path of a long step can come to a place from an odd side, and the tool slides off what it was on. What it carried
// there is against the plane that is there now.
TEST(TouchPoints, AreAgainstWhatIsThereNow) {
  Pressed scene(Quat::Identity(),
                Obstacle{MeshShape{placed(boxSurface({0.3, 0.3, 0.02}), at({0, 0, -0.01}))}, 0.5, "slab"});
  World& world = scene.world;
  const VecX positions = world.tool().state.positions;
  const WorldState pressed = world.state();
  ASSERT_FALSE(pressed.contacts.loaded.empty());
  constexpr std::uint64_t kOdd = 12345;
  NearContacts scratch;
  for (const double upright : {1.0, 0.97, 0.5, 0.1, -0.8}) {
    WorldState state = pressed;
    Contact odd = state.contacts.loaded.front();
    ASSERT_GT(odd.normal.z(), 0.99);
    odd.key = odd.track = kOdd;
    odd.normal = Vec3(std::sqrt(1 - upright * upright), 0, upright);
    setTangents(odd);
    state.contacts.loaded.push_back(odd);
    const VecX force = state.contacts.loaded_force;
    state.contacts.loaded_force.resize(force.size() + 3);
    state.contacts.loaded_force << force, force.head<3>();
    world.restore(state);
    const auto points = findTouchPoints(world, {positions, VecX::Zero(positions.size())}, {0.005, 0.066, 0}, scratch);
    const auto isOdd = [](const TouchPoint& p) { return p.contact.key == kOdd; };
    ASSERT_EQ(std::count_if(points.begin(), points.end(), isOdd), 1) << upright;
    const TouchPoint& p = *std::find_if(points.begin(), points.end(), isOdd);
    EXPECT_NEAR(p.contact.normal.z(), upright > 0.95 ? upright : 1.0, 1e-6) << upright;
    EXPECT_LT(p.gap, 1e-4) << upright;
    EXPECT_NEAR(p.force.norm(), force.head<3>().norm(), 1e-12) << upright;
  }
}

// Most of what is near is never sorted, and looked at only as far as there is room for it.
TEST(TouchPoints, AreTheNearestAndAllThatCarryForce) {
  Pressed scene;
  World& world = scene.world;
  const VecX& positions = world.tool().state.positions;
  Vec3 force = Vec3::Zero();
  const ContactMemory& memory = world.state().contacts;
  for (std::size_t k = 0; k < memory.loaded.size(); ++k) force += memory.loadedForce(k);
  ASSERT_GT(force.z(), 0.1);
  NearContacts scratch;
  for (const Vec3& v : {Vec3(0, 0, 0), Vec3(0.1, 0, -0.1), Vec3(0, 0, 0.3)}) {
    const VecX speeds = v.replicate(positions.size() / 3, 1);
    const auto found = [&](int most) {
      return findTouchPoints(world, {positions, speeds}, {0.005, 0.066, most}, scratch);
    };
    const std::vector<TouchPoint> now = found(0), all = found(1000);
    const int room = static_cast<int>(now.size()) + 5;
    const std::vector<TouchPoint> few = found(room);
    ASSERT_GT(all.size(), few.size());
    EXPECT_EQ(few.size(), static_cast<std::size_t>(room));
    Vec3 sum = Vec3::Zero();
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (i < now.size()) EXPECT_EQ(now[i].contact.key, all[i].contact.key);
      if (i < few.size()) EXPECT_EQ(few[i].contact.key, all[i].contact.key);
      if (i < now.size()) {
        sum += now[i].force;
        EXPECT_TRUE(!now[i].force.isZero(0.0) || now[i].gap + 0.066 * std::min(0.0, v.z()) < 0.005);
      } else {
        EXPECT_TRUE(all[i].force.isZero(0.0));
        EXPECT_TRUE(i == now.size() || all[i].gap >= all[i - 1].gap) << i;
      }
    }
    EXPECT_LT((sum - force).norm(), 1e-12);
  }
}

// All weight and press arrive: the merged contacts carry the force and the torque of the world's.
TEST(Reduction, MergedContactsCarryTheWholeForce) {
  Pressed scene;
  LiveSettings settings;
  settings.contacts = 4;
  LiveBasis basis;
  const LiveModel model = scene.reduced(settings, basis);
  ASSERT_EQ(model.contacts, 4);
  const Vec3 expected = contactForce(scene.world, 0).total;
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < 4; ++i) sum += model.contact_force.segment<3>(3 * i);
  EXPECT_GT(expected.norm(), 0.3);
  const Pose& pose = scene.world.tool().state.handle.pose;
  EXPECT_LT((pose.rotation * sum - expected).norm(), 1e-9);
  // and about the handle
  Vec3 torque = Vec3::Zero(), given = model.torque;
  const ContactMemory& memory = scene.world.state().contacts;
  for (std::size_t k = 0; k < memory.loaded.size(); ++k) {
    const Vec3 force =
        memory.loaded[k].frame().transpose() * memory.loaded_force.segment<3>(static_cast<Eigen::Index>(3 * k));
    torque += (memory.loaded[k].first.at(scene.world.tool().state.positions) - pose.position).cross(force);
  }
  for (int i = 0; i < 4; ++i)
    given += Vec3(model.arm.segment<3>(3 * i)).cross(Vec3(model.contact_force.segment<3>(3 * i)));
  EXPECT_LT((pose.rotation * given - torque).norm(), 1e-3 * torque.norm());
}

// On a ball of triangles: planes that bend as it does, and normals through its middle though facets have others.
TEST(Reduction, PlanesBendAsTheObstacleDoes) {
  constexpr double kRadius = 0.05;
  const Vec3 middle(0.03, 0.02, -kRadius);
  const MeshShape ball{placed(sphereSurface(kRadius, 5), at(middle))};
  Pressed scene(Quat::Identity(), Obstacle{ball, 0.5, "ball"});
  LiveBasis basis;
  const LiveModel model = scene.reduced({}, basis);
  ASSERT_TRUE(isFinite(model));
  ASSERT_GT(model.contacts, 0);
  for (int g = 0; g < model.contacts; ++g) {
    const LiveSurface& s = model.surface[static_cast<std::size_t>(g)];
    const Vec3 out = (s.a - middle).normalized();
    EXPECT_GT(s.normal.dot(out), std::cos(0.1)) << g;  // some are those of the bar's faces
    EXPECT_LT((s.bend * s.normal).norm(), 1e-9) << g;
    const Mat3 flat = Mat3::Identity() - s.normal * s.normal.transpose();
    EXPECT_LT((s.bend - flat / kRadius).norm(), 0.2 / kRadius) << g;
  }
  Pressed flat;
  const LiveModel plane = flat.reduced({}, basis);
  for (int g = 0; g < plane.contacts; ++g) EXPECT_TRUE(plane.surface[static_cast<std::size_t>(g)].bend.isZero(0.0));
}

TEST(Reduction, TurnsWithTheScene) {
  const Quat turn = expRotation(Vec3(0.5, -0.3, 0.9));
  Pressed plain, turned(turn);
  LiveBasis a, b;
  const LiveModel m = plain.reduced({}, a), n = turned.reduced({}, b);
  ASSERT_EQ(m.contacts, n.contacts);
  EXPECT_LT((m.squared_frequency - n.squared_frequency).norm(), 1e-6 * m.squared_frequency.norm());
  EXPECT_LT((Mat6(m.inertia) - Mat6(n.inertia)).norm(), 1e-6 * m.inertia.norm());
  EXPECT_NEAR(m.compliance.trace(), n.compliance.trace(), 1e-3 * m.compliance.trace());
}

// A joint's points are merged without losing any of its force or of its nodes' weight, beside contact.
TEST(Reduction, AJointIsTied) {
  Material material;
  material.youngs_modulus = 2e4;
  material.damping_beta = 0.002;
  BodyModel tool = bar({4, 3, 3}, material);
  holdNodes(tool, onTop, kPlainHandle);
  const Vec3 foot(0, 0, -0.02);
  BodyModel block("block", moved(barMesh({kBarSize.x(), kBarSize.y(), 0.02}, {3, 3, 2}), {foot, Quat::Identity()}),
                  material);
  const auto at = [](const BodyModel& body, double z, bool glued) {
    Attachment out;
    out.name = glued ? "joint" : "floor";
    out.glued = glued;
    out.nodes = nodesWhere(body.mesh().mesh.nodes, [&](const Vec3& p) { return std::abs(p.z() - z) < 1e-9; });
    return out;
  };
  tool.attach(at(tool, 0, true));
  block.attach(at(block, -0.02, false));
  World world;
  world.add(std::move(tool));
  world.add(std::move(block));
  world.glue(0, 0, 1);
  world.link = {700, 5, 1.0, 0.005};
  DeviceTarget target{world.tool().state.handle.pose, Vec6::Zero()};
  target.pose.position += Vec3(0.002, 0, 0.003);
  for (int n = 0; n < 40; ++n) ASSERT_EQ(world.step(target, 0.033).status, StepStatus::ok);

  ToolReduction reduction;
  DampedForces damped;
  dampForces(world, 1e3, damped);
  LiveBasis basis;
  const LiveModel m = reduction.reduce(world, {}, {toolShape(world), damped, MatX(), 0.033, {}, {}}, basis);
  ASSERT_TRUE(isFinite(m));
  ASSERT_EQ(m.contacts, kTiedClusters);
  EXPECT_TRUE(m.partners_yield);
  Vec3 sum = Vec3::Zero(), damped_sum = Vec3::Zero();
  for (int i = 0; i < m.contacts; ++i) {
    EXPECT_EQ(m.surface[i].kind, LiveSurface::Kind::tied);
    EXPECT_LT((m.pose.apply(m.arm.segment<3>(3 * i)) - m.surface[i].a).norm(), 1e-9);
    sum += m.contact_force.segment<3>(3 * i);
    damped_sum += m.damped_force.segment<3>(3 * i);
  }
  const Vec3 joint = world.tool().system.attachmentForces()[0].force;
  EXPECT_GT(joint.norm(), 0.5);
  EXPECT_LT((world.tool().state.handle.pose.rotation * sum - joint).norm(), 1e-6 * joint.norm());
  EXPECT_LT((damped_sum - sum).norm(), 1e-3 * joint.norm());

  // held where it is, it stays at rest
  LiveTick tick;
  LiveState state = startState(m);
  for (int k = 0; k < 100; ++k) {
    tick.replay(m, 0.001, world.gravity, {k, m.pose, Vec6::Zero()}, {k + 1, m.pose, Vec6::Zero()}, state);
  }
  Vec3 after = Vec3::Zero();
  for (int i = 0; i < m.contacts; ++i) after += state.contact_force.segment<3>(3 * i);
  EXPECT_LT((after - sum).norm(), 1e-3 * sum.norm());
}

Vec3 sumOf(const RowVector& forces) {
  Vec3 sum = Vec3::Zero();
  for (Eigen::Index i = 0; i + 2 < forces.size(); i += 3) sum += forces.segment<3>(i);
  return sum;
}

// A soft bar that is pressed on a soft block with a mesh of its own and held there: a model of what is at rest stays at
// rest, whatever of its contacts the step left out, and however they are merged.
TEST(Reduction, WhatIsAtRestOnASoftBodyStaysAtRest) {
  Material material;
  material.youngs_modulus = 2e4;
  material.damping_beta = 0.002;
  World world;
  world.link = {700, 5, 1.0, 0.005};
  BodyModel tool = bar({4, 3, 3}, material);
  holdNodes(tool, onTop, kPlainHandle);
  const Quat turn(Eigen::AngleAxisd(0.35, Vec3::UnitZ()));
  SimulationMesh below = moved(barMesh({0.08, 0.07, 0.03}, {5, 4, 2}), {Vec3(-0.01, -0.02, -0.0305), turn});
  BodyModel block("block", below, material);
  Attachment floor;
  floor.name = "floor";
  floor.nodes = nodesWhere(block.mesh().mesh.nodes, [](const Vec3& p) { return p.z() < -0.03; });
  block.attach(floor);
  world.add(std::move(tool));
  world.add(std::move(block));
  const Pose start = world.tool().state.handle.pose;
  for (int k = 1; k <= 100; ++k) {
    Vec6 way = Vec6::Zero();
    way.head<3>() = std::min(1.0, k / 40.0) * Vec3(0.003, -0.001, -0.006);
    way[4] = std::min(1.0, k / 40.0) * 0.05;
    ASSERT_FALSE(world.step({advance(start, way), Vec6::Zero()}, 0.033).failed());
  }
  for (const int contacts : {16, 5}) {
    for (const int modes : {0, 6}) {
      LiveSettings settings;
      settings.contacts = contacts;
      settings.partner_modes = modes;
      ToolReduction reduction;
      DampedForces damped;
      dampForces(world, 1e3, damped);
      LiveBasis basis;
      const LiveModel m = reduction.reduce(world, settings, {toolShape(world), damped, MatX(), 0.033, {}, {}}, basis);
      ASSERT_TRUE(isFinite(m));
      EXPECT_EQ(m.partner_modes, modes);
      const Vec3 before = sumOf(m.contact_force);
      ASSERT_GT(before.norm(), 0.3);
      LiveTick tick;
      LiveState state = startState(m);
      for (int k = 0; k < 200; ++k) {
        tick.replay(m, 0.001, world.gravity, {k, m.pose, Vec6::Zero()}, {k + 1, m.pose, Vec6::Zero()}, state);
      }
      EXPECT_LT((sumOf(state.contact_force) - before).norm(), 0.005 * before.norm())
          << contacts << " contacts, " << modes << " modes";
    }
  }
}

// A small tool that is held so far above all else that it has no part in what happens there.
void addFarTool(World& world, const Material& material, double height) {
  BodyModel tool("tool", moved(barMesh({0.01, 0.01, 0.01}, {1, 1, 1}), {Vec3(0, 0, height), Quat::Identity()}),
                 material);
  holdNodes(
      tool, [&](const Vec3& p) { return p.z() > height + 0.005; }, kPlainHandle);
  world.add(std::move(tool));
}

// A block of two glued parts yields like one, also where it stands on the ground.
TEST(PartnerCompliance, GluedBodiesYieldTogether) {
  Material material;
  material.youngs_modulus = 2e4;
  const auto block = [&](const std::string& name, double low, double high, int cells) {
    return BodyModel(name, moved(barMesh({0.04, 0.04, high - low}, {3, 3, cells}), {Vec3(0, 0, low), Quat::Identity()}),
                     material);
  };
  const auto at = [](const BodyModel& body, double z) {
    Attachment out;
    out.name = "joint";
    out.nodes = nodesWhere(body.mesh().mesh.nodes, [&](const Vec3& p) { return std::abs(p.z() - z) < 1e-9; });
    return out;
  };
  std::vector<MatX> found;
  for (const int parts : {1, 2}) {
    World world;
    addFarTool(world, material, 1);
    BodyModel top = parts == 1 ? block("whole", 0, 0.04, 4) : block("top", 0.02, 0.04, 2);
    if (parts == 2) {
      BodyModel bottom = block("bottom", 0, 0.02, 2);
      bottom.attach(at(bottom, 0));
      Attachment joint = at(top, 0.02);
      joint.glued = true;
      top.attach(joint);
      world.add(std::move(top));
      world.add(std::move(bottom));
      world.glue(1, 0, 2);
    } else {
      top.attach(at(top, 0));
      world.add(std::move(top));
    }
    ASSERT_EQ(world.step({world.tool().state.handle.pose, Vec6::Zero()}, 0.033).status, StepStatus::ok);
    std::vector<NodeSum> sums;
    const auto nodes = nodesWhere(world.body(1).model.mesh().mesh.nodes,
                                  [](const Vec3& p) { return p.z() > 0.04 - 1e-9 && p.x() < 0.03; });
    for (std::size_t k = 0; k < 3; ++k)
      sums.push_back({static_cast<int>(3 * k), {{nodes[4 * k], 0.7}, {nodes[4 * k + 1], 0.3}}});
    found.push_back(MatX::Zero(9, 9));
    reducePartner(world, 1, {sums, {}, nullptr, nullptr, 0}, found.back());
  }
  EXPECT_GT(found[0].norm(), 1e-3);
  EXPECT_LT((found[1] - found[0]).norm(), 1e-3 * found[0].norm());
}

// A soft block that stands on the ground by friction, or slides on it: what holds it has rows in the step, which are
// taken as they are; the same comes out when they are built anew.
TEST(PartnerCompliance, RowsOfTheStepAreThoseThatHold) {
  for (const double speed : {0.0, 0.5}) {
    Material material;
    material.youngs_modulus = 2e4;
    material.damping_beta = 0.002;
    World world;
    world.obstacles = {ground()};
    addFarTool(world, material, 1);
    world.add(BodyModel("block", barMesh({0.04, 0.04, 0.04}, {3, 3, 3}), material));
    WorldState state = world.state();
    for (int k = 0; k < world.body(1).model.nodes(); ++k) state.bodies[1].velocities[3 * k] = speed;
    world.restore(state);
    for (int k = 0; k < 5; ++k) {
      ASSERT_EQ(world.step({world.tool().state.handle.pose, Vec6::Zero()}, 0.01).status, StepStatus::ok);
    }
    ASSERT_GT(world.contacts().active(), 8);
    const auto nodes =
        nodesWhere(world.body(1).model.mesh().mesh.nodes, [](const Vec3& p) { return p.z() > 0.04 - 1e-9; });
    const std::vector<NodeSum> sums{{0, {{nodes[0], 0.7}, {nodes[1], 0.3}}}, {3, {{nodes[5], 1.0}}}};
    MatX taken = MatX::Zero(6, 6), anew = MatX::Zero(6, 6);
    reducePartner(world, 1, {sums, {}, nullptr, nullptr, 0}, taken);

    // what is begun before it is known where it is touched is the same, with another number of modes as well
    const PartnerInput input{sums, {}, nullptr, nullptr, 4};
    MatX whole = MatX::Zero(6, 6);
    const PartnerModes modes = reducePartner(world, 1, input, whole);
    ASSERT_TRUE(PartnerReduction::worthBeginning(world, 1));
    for (const int begun_modes : {4, 3}) {
      for (const bool touched : {false, true}) {
        PartnerReduction begun(world, 1, false);
        begun.hold(nullptr, begun_modes);
        if (touched) begun.touch(sums);
        MatX w = MatX::Zero(6, 6);
        const PartnerModes same = reducePartner(world, 1, input, w, &begun);
        EXPECT_EQ(w, whole) << speed << ' ' << begun_modes << ' ' << touched;
        EXPECT_EQ(same.squared_frequency, modes.squared_frequency);
        EXPECT_EQ(same.shape, modes.shape);
        EXPECT_EQ(same.force, modes.force);
      }
    }
    world.takeContacts();
    ASSERT_EQ(world.bodyRows(1), nullptr);
    reducePartner(world, 1, {sums, {}, nullptr, nullptr, 0}, anew);
    EXPECT_GT(anew.norm(), 1e-3);
    EXPECT_LT((taken - anew).norm(), 1e-9 * anew.norm()) << speed;
  }
}

// A block on the floor that the world holds, after a step: its modes are those of the dense problem, and what they and
// the rest give is what it gives without.
TEST(PartnerModes, TheyAndTheRestAreTheWholeCompliance) {
  Material material;
  material.youngs_modulus = 2e4;
  material.damping_beta = 0.002;
  World world;
  addFarTool(world, material, 1);
  BodyModel block("block", barMesh({0.04, 0.04, 0.04}, {3, 3, 3}), material);
  Attachment floor;
  floor.name = "floor";
  floor.nodes = nodesWhere(block.mesh().mesh.nodes, [](const Vec3& p) { return p.z() < 1e-9; });
  block.attach(floor);
  world.add(std::move(block));
  ASSERT_EQ(world.step({world.tool().state.handle.pose, Vec6::Zero()}, 0.033).status, StepStatus::ok);
  const Body body = world.body(1);
  std::vector<NodeSum> sums;
  const auto nodes = nodesWhere(body.model.mesh().mesh.nodes, [](const Vec3& p) { return p.z() > 0.04 - 1e-9; });
  for (std::size_t k = 0; k < 4; ++k) {
    sums.push_back({static_cast<int>(3 * k), {{nodes[3 * k], 0.7}, {nodes[3 * k + 1], 0.3}}});
  }
  MatX whole = MatX::Zero(12, 12), rest = MatX::Zero(12, 12);
  reducePartner(world, 1, {sums, {}, nullptr, nullptr, 0}, whole);
  const PartnerModes modes = reducePartner(world, 1, {sums, {}, nullptr, nullptr, 6}, rest);
  ASSERT_EQ(modes.squared_frequency.size(), 6);
  const double s = material.massScale(0.033), e = body.system.stiffnessScale();
  for (int k = 0; k < 6; ++k) {
    rest += modes.shape.col(k) * modes.shape.col(k).transpose() / (modes.squared_frequency[k] + s / e);
  }
  EXPECT_LT((rest - whole).norm(), 1e-9 * whole.norm());

  const VecX mass = freeMasses(body.model);
  MatX k = body.system.matrix().multiplyColumns(MatX::Identity(mass.size(), mass.size()));
  k = (k - s * MatX(mass.asDiagonal())) / e;
  const SymmetricEigen exact = symmetricEigen(k, MatX(mass.asDiagonal()));
  for (int i = 0; i < 6; ++i) EXPECT_NEAR(modes.squared_frequency[i] / exact.values[i], 1.0, 0.02) << i;
  // nothing but its weight moves it, which its stiffness has not taken up yet
  const VecX pulled =
      modes.basis.modes.transpose() * mass.asDiagonal() * Vec3(world.gravity).replicate(mass.size() / 3, 1);
  EXPECT_GT(modes.force.norm(), 0.01 * pulled.norm());
  EXPECT_LT(modes.force.norm(), 2.0 * pulled.norm());
}

// A rigid box: in the air it has all six motions, lying still none, sliding three and the friction that slows it down;
// one more where two corners carry it.
TEST(PartnerModes, ARigidBodyHasTheMotionsThatNothingHolds) {
  for (const double speed : {0.0, 2.0}) {
    for (const double height : {0.0, 2.0}) {
      Material material;
      World world;
      world.obstacles = {ground()};
      addFarTool(world, material, 3);
      Vec6 velocity = Vec6::Zero();
      velocity[0] = speed;
      const Vec3 lift(0, 0, 0.0101 + height);
      world.add(BodyModel::rigid("box", placed(boxSurface({0.04, 0.04, 0.02}), {lift, Quat::Identity()}), 1000, 0.3,
                                 velocity));
      for (int k = 0; k < 40; ++k) {
        ASSERT_EQ(world.step({world.tool().state.handle.pose, Vec6::Zero()}, 0.01).status, StepStatus::ok);
      }
      const std::vector<NodeSum> sums{{0, {{0, 1.0}}}};
      MatX w = MatX::Zero(3, 3);
      const PartnerModes modes = reducePartner(world, 1, {sums, {}, nullptr, nullptr, 6}, w);
      const Eigen::Index found = modes.squared_frequency.size();
      if (height > 0) {
        ASSERT_EQ(found, 6);
      } else if (speed > 0) {
        ASSERT_GE(found, 3);
        ASSERT_LE(found, 4);
      } else {
        ASSERT_LE(found, 1);
        continue;
      }
      EXPECT_LT(modes.squared_frequency.maxCoeff(), 1.0);
      const VecX acceleration = modes.basis.modes * modes.force, motion = modes.basis.modes * modes.speed;
      EXPECT_NEAR(motion[0], world.body(1).state.handle.twist[0], 1e-6);
      EXPECT_NEAR(acceleration[0], height > 0 ? 0.0 : -0.5 * 9.81, 0.03);
      EXPECT_NEAR(acceleration[2], height > 0 ? -9.81 : 0.0, 0.03);
    }
  }
}

// A box that pushes another one along the ground, whose friction is greater: mass that moves along, and no wall.
TEST(PartnerModes, WhatALooseBoxPushesMovesAlong) {
  constexpr double kStep = 0.005;
  Material material;
  World world;
  world.obstacles = {ground()};
  addFarTool(world, material, 3);
  Vec6 velocity = Vec6::Zero();
  velocity[0] = 2.0;
  const auto box = [&](double x) {
    return BodyModel::rigid("box", placed(boxSurface({0.04, 0.04, 0.02}), {Vec3(x, 0, 0.0001), Quat::Identity()}), 1000,
                            0.3, velocity);
  };
  world.add(box(0.0));
  world.add(box(0.0402));
  world.setFriction(1, FrictionTable::obstacle(0), 0.2);
  world.setFriction(2, FrictionTable::obstacle(0), 0.6);
  world.setFriction(1, 2, 0.0);
  for (int k = 0; k < 30; ++k) {
    ASSERT_EQ(world.step({world.tool().state.handle.pose, Vec6::Zero()}, kStep).status, StepStatus::ok);
  }
  const std::vector<NodeSum> sums{{0, {{0, 1.0}}}};
  MatX w = MatX::Zero(3, 3);
  const PartnerModes modes = reducePartner(world, 1, {sums, {}, nullptr, nullptr, 6}, w);
  const double own = world.body(1).model.totalMass();
  EXPECT_NEAR(modes.basis.mass(0, 0), 2 * own, 1e-3 * own);
  const MatX q = modes.basis.modes;
  EXPECT_NEAR((q.transpose() * modes.basis.mass * q - MatX::Identity(q.cols(), q.cols())).norm(), 0.0, 1e-6);
  ASSERT_GT(q.row(0).norm(), 0);
  EXPECT_LT(modes.squared_frequency[0], 1.0);
  const VecX acceleration = q * modes.force, motion = q * modes.speed;
  EXPECT_NEAR(motion[0], world.body(1).state.handle.twist[0], 1e-3);
  EXPECT_NEAR(acceleration[0], -0.4 * 9.81, 0.02 * 9.81);
}

// A soft block that stands on a loose rigid box: the model has the box's motions in the plane, and what holds it is the
// friction of the ground, as far as what lies on it bears that.
struct OnALooseBox {
  static constexpr double kGroundFriction = 0.2, kStep = 0.033;
  World world;
  LiveBasis basis;
  OnALooseBox() {
    Material material;
    material.youngs_modulus = 4e4;
    material.damping_beta = 0.002;
    BodyModel tool("tool", moved(barMesh({0.02, 0.02, 0.03}, {2, 2, 3}), {Vec3(0, 0, 0.0305), Quat::Identity()}),
                   material);
    holdNodes(
        tool, [](const Vec3& p) { return p.z() > 0.0604; }, kPlainHandle);
    world.link = {700, 5, 1.0, 0.005};
    world.obstacles = {ground()};
    world.obstacles[0].friction = kGroundFriction;
    world.add(std::move(tool));
    world.add(BodyModel::rigid("box", placed(boxSurface({0.05, 0.04, 0.03}), {Vec3(0, 0, 1e-4), Quat::Identity()}), 800,
                               0.9));
    Pose down = world.tool().state.handle.pose;
    for (int k = 0; k < 30; ++k) {
      down.position.z() -= k < 10 ? 2e-4 : 0.0;
      if (world.step({down, Vec6::Zero()}, kStep).failed()) ADD_FAILURE();
    }
  }
  LiveModel reduced() {
    ToolReduction reduction;
    DampedForces damped;
    dampForces(world, 1e3, damped);
    return reduction.reduce(world, {}, {toolShape(world), damped, MatX(), kStep, {}, {}}, basis);
  }
  double weight() const { return world.gravity.norm() * world.body(1).model.totalMass(); }
};

TEST(PartnerModes, ALooseBoxIsHeldByFrictionAlone) {
  OnALooseBox scene;
  const LiveModel model = scene.reduced();
  ASSERT_TRUE(isFinite(model));
  ASSERT_GE(model.partner_modes, 3);
  ASSERT_GE(model.supports, 2);
  const int first = model.contacts - model.supports;
  double load = 0, pressed = 0;
  for (int i = 0; i < model.contacts; ++i) {
    if (i < first) {
      EXPECT_NE(model.surface[i].kind, LiveSurface::Kind::support);
      pressed += (model.pose.rotation * model.contact_force.segment<3>(3 * i)).z();
      continue;
    }
    EXPECT_EQ(model.surface[i].kind, LiveSurface::Kind::support);
    EXPECT_NEAR(model.friction[i], OnALooseBox::kGroundFriction, 1e-12);
    load += model.surface[i].load;
  }
  ASSERT_GT(pressed, 0.1);
  EXPECT_NEAR(load, pressed + scene.weight(), 0.01 * load);
  // what presses on the box is borne by the ground, whatever the place
  for (int i = 0; i < first; ++i) {
    const Vec3 borne = model.bearing.middleCols<3>(3 * i).colwise().sum() * model.pose.matrix().transpose();
    if (model.contact_force.segment<3>(3 * i).norm() > 0) {
      EXPECT_NEAR(borne.z(), 1.0, 0.01);
    }
  }
}

// Led aside, the tool of the model takes the box along against the ground's friction, as the tool of the world does.
TEST(PartnerModes, ALooseBoxSlidesInTheModel) {
  OnALooseBox scene;
  const LiveModel model = scene.reduced();
  LiveTick tick;
  LiveState state = startState(model);
  Pose pose = model.pose;
  Vec6 twist = model.twist, aside = Vec6::Zero();
  const Vec3 from = scene.world.body(1).state.handle.pose.position;
  Pose device = pose;
  LiveTickInput input;
  input.link = scene.world.link;
  input.gravity = scene.world.gravity;
  aside[0] = 0.2;
  for (int k = 0; k < 120; ++k) {
    device = advance(device, 1e-3 * aside);
    input.device = device;
    input.device_twist = aside;
    const Vec6 next = tick.step(model, input, pose, twist, state);
    pose = advance(pose, 1e-3 * next);
    twist = next;
  }
  ASSERT_TRUE(isFinite(state));
  Vec3 tool = Vec3::Zero(), support = Vec3::Zero();
  for (int i = 0; i < model.contacts; ++i) {
    (i < model.contacts - model.supports ? tool : support) += state.contact_force.segment<3>(3 * i);
  }
  const double most = OnALooseBox::kGroundFriction * (tool.z() + scene.weight());
  EXPECT_NEAR(support.x(), -most, 0.03 * most);
  // the same in the world, in its own fine steps
  device = scene.world.tool().state.handle.pose;
  for (int k = 0; k < 120; ++k) {
    device = advance(device, 1e-3 * aside);
    ASSERT_FALSE(scene.world.step({device, aside}, 1e-3).failed());
  }
  const double way = scene.world.body(1).state.handle.pose.position.x() - from.x();
  VecX moved = scene.basis.partners[0].modes * state.z.tail(model.partner_modes);
  EXPECT_GT(way, 5e-3);
  EXPECT_NEAR(moved[0], way, 0.15 * way);
}

}  // namespace
}  // namespace palpate
