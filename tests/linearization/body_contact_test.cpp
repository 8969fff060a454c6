// The linearization where the tool touches bodies that give way, itself, and fixed meshes: against central differences
// of the slow step, and against springs in series.
#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "palpate/linearization/active_contacts.h"
#include "palpate/linearization/linearize.h"
#include "palpate/math/rotation.h"
#include "palpate/study/check.h"
#include "shared/pair_scenes.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kStep = 0.01;  // [s]

Vec6 sixVector(double a, double b, double c, double d = 0, double e = 0, double f = 0) {
  Vec6 v;
  v << a, b, c, d, e, f;
  return v;
}

Material soft(double youngs_modulus = 2e4) {
  Material material;
  material.youngs_modulus = youngs_modulus;
  material.damping_alpha = 0.3;  // exercised, though off by default
  return material;
}

// A handle of the given mass whose three inertias differ.
HandleOptions lopsided(double own_mass = 0.02) {
  HandleOptions options;
  options.mass = own_mass;
  options.inertia = 1e-3 * own_mass * Vec3(1, 2, 3);
  return options;
}

// Soft 4 cm cube held at its top, its bottom at the given height.
BodyModel heldCubeBody(double height) {
  BodyModel body("tool", moved(barMesh({0.04, 0.04, 0.04}, {2, 2, 2}), at({0.011, 0.008, height})), soft());
  holdNodes(
      body, [&](const Vec3& p) { return p.z() > height + 0.04 - 1e-9; }, lopsided());
  return body;
}

struct Situation {
  World world;
  Vec6 motion = Vec6::Zero();  // of the device while it approaches [m, rad]
  int steps = 12;
  bool until_contact = false;  // at most `steps`: contact is brief
};

World emptyWorld(double ground_friction = 0.9) {
  World world;
  world.link = {700, 2, 1.0, 0.01};
  world.obstacles.push_back({PlaneShape{}, ground_friction, "ground"});
  return world;
}

const Vec6 kPress = sixVector(0.0005, 0.0002, -0.006, 0.02, 0.01, 0.01);
const Vec6 kRub = sixVector(0.014, 0.006, -0.006, 0.02, 0.01, 0.05);

Situation onSoftBlock(bool slide) {
  Situation s{emptyWorld(), slide ? kRub : kPress};
  s.world.add(heldCubeBody(0.0305));
  s.world.add(BodyModel("block", barMesh({0.06, 0.06, 0.03}, {3, 3, 2}), soft(3e4)));
  // one that the tool's motion does not reach
  s.world.add(BodyModel("bystander", moved(barMesh({0.02, 0.02, 0.02}, {1, 1, 1}), at({0.2, 0, 0})), soft()));
  return s;
}

Situation onRigidBox(bool slide) {
  Situation s{emptyWorld(), slide ? kRub : kPress};
  s.world.add(heldCubeBody(0.0305));
  const Pose pose{Vec3(0.03, 0.03, 0.015), Quat::Identity()};
  s.world.add(BodyModel::rigid("box", placed(boxSurface({0.06, 0.06, 0.03}, {2, 2, 1}), pose), 800));
  // it sticks with room to spare: how friction is shared out under its corners is anybody's choice
  s.world.setFriction(1, FrictionTable::obstacle(0), 10.0);
  return s;
}

// Rigid on soft: the tool's contacts reach the ground through two bodies.
Situation onStack(bool slide) {
  Situation s{emptyWorld(), slide ? kRub : kPress};
  s.world.add(heldCubeBody(0.0427));
  s.world.add(BodyModel("block", barMesh({0.06, 0.06, 0.03}, {2, 2, 1}), soft(3e4), 2.0));
  const Pose pose{Vec3(0.03, 0.03, 0.0362), Quat::Identity()};
  s.world.add(BodyModel::rigid("plate", placed(boxSurface({0.06, 0.06, 0.012}), pose), 800, 2.0));
  return s;
}

// A hook that lies on the ground: the held end of its upper arm comes down on the lower arm.
Situation onItself(bool slide) {
  SimulationMesh bar = barMesh({0.06, 0.02, 0.03}, {5, 2, 3});
  TetrahedralMesh hook;
  std::vector<int> number(bar.mesh.nodes.size(), -1);
  for (auto t : bar.mesh.tetrahedra) {
    Vec3 center = Vec3::Zero();
    for (const int n : t) center += 0.25 * bar.mesh.nodes[n];
    if (center.x() > 0.012 && center.z() > 0.01 && center.z() < 0.02) continue;
    for (int& n : t) {
      if (number[n] < 0) {
        number[n] = static_cast<int>(hook.nodes.size());
        Vec3 p = bar.mesh.nodes[n];
        if (p.z() > 0.015) p.z() -= 0.008;  // the arms are 2 mm apart
        hook.nodes.push_back(p);
      }
      n = number[n];
    }
    hook.tetrahedra.push_back(t);
  }
  BodyModel body("tool", simulationMeshOf(hook), soft());
  holdNodes(
      body, [](const Vec3& p) { return p.x() > 0.059 && p.z() > 0.011; }, lopsided());
  Situation s{emptyWorld(2.0),
              slide ? sixVector(0.008, 0.005, -0.008, 0, 0, 0.1) : sixVector(0, 0, -0.008, 0, 0.05, 0)};
  s.world.add(std::move(body), true);
  return s;
}

Situation onMesh(bool slide) {
  Situation s{emptyWorld(), slide ? kRub : kPress};
  const Pose pose{Vec3(0.03, 0.03, 0.03), expRotation({0.05, 0.1, 0.3})};
  s.world.obstacles.push_back({MeshShape{placed(sphereSurface(0.03, 2), pose)}, std::nullopt, "knob"});
  s.world.add(heldCubeBody(0.0605));
  return s;
}

// In the air: a soft bar comes along at 1.5 m/s, straight at the tool or grazing its side.
Situation flyby(bool slide) {
  Situation s{emptyWorld(), Vec6::Zero()};
  s.world.gravity.setZero();
  s.world.add(heldCubeBody(0.1));
  const Vec6 velocity = slide ? sixVector(-0.3, 1.5, 0.1, 0, 0, 2) : sixVector(-1.5, 0.02, 0.01, 0, 0, 0.5);
  const Vec3 corner = slide ? Vec3(0.0535, -0.03, 0.105) : Vec3(0.085, 0.012, 0.105);
  s.world.add(BodyModel("ball", moved(barMesh({0.03, 0.03, 0.03}, {2, 2, 2}), at(corner)), soft(), 0.5, velocity));
  s.steps = 16;
  s.until_contact = true;
  return s;
}

// Starts in the block, deeper than what a step may undo: those gaps do not follow the handle.
Situation insideBlock(bool slide) {
  Situation s{emptyWorld(), slide ? sixVector(0.01, 0.004, 0) : Vec6(Vec6::Zero())};
  s.world.contact.max_recovery_speed = 0.05;
  s.world.add(heldCubeBody(0.024));
  s.world.add(BodyModel("block", barMesh({0.06, 0.06, 0.03}, {3, 3, 2}), soft(3e4)));
  s.steps = 3;
  return s;
}

Attachment gluedAt(const BodyModel& body, double height) {
  Attachment out;
  out.name = "joint";
  out.nodes = nodesWhere(body.mesh().mesh.nodes, [&](const Vec3& p) { return std::abs(p.z() - height) < 1e-9; });
  out.glued = true;
  return out;
}

// A soft block that is glued to another one, whose mesh is coarser, and this to a rigid plate, upon a foot on the
// ground.
Situation onGluedBlocks(bool slide) {
  Situation s{emptyWorld(), slide ? kRub : kPress};
  s.world.add(heldCubeBody(0.0405));
  BodyModel upper("upper", moved(barMesh({0.06, 0.06, 0.015}, {3, 3, 1}), at({0, 0, 0.025})), soft(3e4));
  upper.attach(gluedAt(upper, 0.025));
  BodyModel lower("lower", moved(barMesh({0.06, 0.06, 0.015}, {2, 2, 1}), at({0, 0, 0.01})), soft(2e4));
  lower.attach(gluedAt(lower, 0.01));
  s.world.add(std::move(upper));
  s.world.add(std::move(lower));
  // not on the ground: how the friction under its corners is shared out is anybody's choice, and has no derivative
  BodyModel foot("foot", moved(barMesh({0.06, 0.06, 0.005}, {2, 2, 1}), at({0, 0, 0.001})), soft(1e5));
  Attachment floor = gluedAt(foot, 0.001);
  floor.name = "floor";
  floor.glued = false;
  foot.attach(std::move(floor));
  foot.attach(gluedAt(foot, 0.006));
  const Pose pose{Vec3(0.03, 0.03, 0.008), Quat::Identity()};
  s.world.add(BodyModel::rigid("plate", placed(boxSurface({0.07, 0.07, 0.004}), pose), 800));
  s.world.add(std::move(foot));
  s.world.glue(1, 0, 2);
  s.world.glue(2, 0, 3);
  s.world.glue(4, 1, 3);
  return s;
}

struct Case {
  const char* name;
  std::function<Situation(bool)> make;
  double sticking, sliding;  // friction of the tool that makes it stick, slide
  bool capped = false;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

// of the tool with anything but the plane
int count(const ContactSet& set, bool stick) {
  int n = 0;
  for (std::size_t i = 0; i < set.contacts.size(); ++i) {
    const Contact& c = set.contacts[i];
    const bool plane = c.second.body < 0 && c.partner == 0;
    if (plane || (c.first.body != 0 && c.second.body != 0) || set.status[i].state == ContactState::open) continue;
    n += (set.status[i].state == ContactState::stick) == stick ? 1 : 0;
  }
  return n;
}

class BodyContact : public ::testing::TestWithParam<std::tuple<Case, bool, bool>> {};

TEST_P(BodyContact, AgreesWithCentralDifferences) {
  const auto& [test, slide, exact] = GetParam();
  Situation s = test.make(slide);
  World& world = s.world;
  world.contact.cone.exact = exact;
  const double friction = slide ? test.sliding : test.sticking;
  for (int i = 0; i < world.bodies(); ++i) world.setFriction(0, i, friction);
  world.setFriction(0, FrictionTable::obstacle(1), friction);
  const Pose start = world.tool().state.handle.pose;
  DeviceTarget target{start, s.motion / (s.steps * kStep)};
  for (int i = 1; i <= s.steps; ++i) {
    target.pose = advance(start, s.motion * (static_cast<double>(i) / s.steps));
    if (s.until_contact) {
      ASSERT_NE(world.evaluate(target, kStep).status, StepStatus::restored);
      if (count(world.contacts(), !slide) > 0) break;
    }
    ASSERT_NE(world.step(target, kStep).status, StepStatus::restored);
  }
  for (const Derivative derivative : {Derivative::frozen, Derivative::full}) {
    const LinearizationCheck check = checkLinearization(world, target, kStep, {DelassusModel::exact, derivative});
    const ContactSet& set = world.contacts();
    EXPECT_GE(count(set, !slide), 1) << count(set, slide) << " others, of " << set.active();
    if (test.capped) {
      EXPECT_TRUE(
          std::any_of(set.contacts.begin(), set.contacts.end(), [](const Contact& c) { return c.follows == 0; }));
    }
    EXPECT_LT(check.force_error, 1e-8);
    if (derivative == Derivative::frozen) {
      EXPECT_LT(check.kx_frozen.worst(), 1e-6);
      EXPECT_LT(check.kv_frozen.worst(), 1e-6);
      EXPECT_GT(check.kx_full.worst(), 1e-4);
    } else {
      EXPECT_LT(check.kx_full.worst(), 1e-5);
      EXPECT_LT(check.kv_full.worst(), 1e-5);
      EXPECT_GT(check.kx_frozen.worst(), 1e-4);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Situations, BodyContact,
    ::testing::Combine(::testing::Values(Case{"soft_block", onSoftBlock, 2.0, 0.2},
                                         Case{"rigid_box", onRigidBox, 2.0, 0.2}, Case{"stack", onStack, 2.0, 0.2},
                                         Case{"itself", onItself, 2.0, 0.1}, Case{"mesh", onMesh, 2.0, 0.2},
                                         Case{"flyby", flyby, 2.0, 0.1},
                                         Case{"inside_block", insideBlock, 2.0, 0.05, true},
                                         Case{"glued_blocks", onGluedBlocks, 2.0, 0.2}),
                       ::testing::Bool(), ::testing::Bool()),
    [](const auto& test) {
      return std::string(std::get<0>(test.param).name) + (std::get<1>(test.param) ? "_sliding" : "_sticking") +
             (std::get<2>(test.param) ? "_exact" : "_polyhedral");
    });

// --- a tool that is glued

enum class Glued { on_soft, on_rigid, below, on_handle };

// The tool's lower side is glued to a block; a block to the tool's lower side, or upon its handle.
World gluedTool(Glued glued) {
  World world = emptyWorld();
  BodyModel tool = heldCubeBody(0.03);
  const bool tool_has_joint = glued == Glued::on_soft || glued == Glued::on_rigid;
  if (tool_has_joint) tool.attach(gluedAt(tool, 0.03));
  world.add(std::move(tool));
  if (glued == Glued::on_rigid) {
    const Pose pose{Vec3(0.031, 0.028, 0.02), Quat::Identity()};
    world.add(BodyModel::rigid("block", placed(boxSurface({0.05, 0.05, 0.02}, {2, 2, 1}), pose), 800));
  } else {
    const double height = glued == Glued::on_handle ? 0.07 : 0.01;
    BodyModel block("block", moved(barMesh({0.05, 0.05, 0.02}, {3, 3, 2}), at({0.006, 0.003, height})), soft(3e4));
    if (!tool_has_joint) block.attach(gluedAt(block, glued == Glued::on_handle ? 0.07 : 0.03));
    world.add(std::move(block));
  }
  world.glue(tool_has_joint ? 0 : 1, 0, tool_has_joint ? 1 : 0);
  return world;
}

TEST(GluedTool, AgreesWithCentralDifferences) {
  for (const Glued glued : {Glued::on_soft, Glued::on_rigid, Glued::below, Glued::on_handle}) {
    World world = gluedTool(glued);
    const Pose start = world.tool().state.handle.pose;
    const Vec6 motion = sixVector(0.003, 0.002, -0.002, 0.1, -0.05, 0.2);
    DeviceTarget target{start, motion / (10 * kStep)};
    for (int i = 1; i <= 10; ++i) {
      target.pose = advance(start, motion * (i / 10.0));
      ASSERT_NE(world.step(target, kStep).status, StepStatus::restored);
    }
    for (const DelassusModel model : {DelassusModel::exact, DelassusModel::diagonal}) {
      LinearizationCheck check = checkLinearization(world, target, kStep, {model, Derivative::frozen});
      EXPECT_GT(world.contacts().glued, 4);
      EXPECT_LT(check.force_error, 1e-8);
      EXPECT_LT(check.kx_frozen.worst(), 1e-6) << static_cast<int>(glued);
      EXPECT_LT(check.kv_frozen.worst(), 1e-6) << static_cast<int>(glued);
      check = checkLinearization(world, target, kStep, {model, Derivative::full});
      EXPECT_LT(check.kx_full.worst(), 1e-5) << static_cast<int>(glued);
      EXPECT_LT(check.kv_full.worst(), 1e-5) << static_cast<int>(glued);
    }
  }
}

// --- what gives way feels soft

enum class Base { soft, rigid };

// Normal stiffness -dF_z/dz of a tool pressed face to face on a block on the ground, sticking. The handle is so heavy
// that it keeps its velocity, and the step so long that all else is at rest at its end: then Kx is that of the
// statics.
double pressedStiffness(Base base, bool reduce, DelassusModel delassus = DelassusModel::exact) {
  constexpr double kLong = 1.0;  // [s]; inertia counts for m / (h^2 k) < 1e-4
  World world = emptyWorld(1.0);
  world.gravity.setZero();

  world.link = {1e-9, 1e-9, 1e-9, 1e-9};
  world.contact.reduction = reduce;
  const double thickness = world.contact.thickness;
  Material material;
  material.youngs_modulus = 2e4;
  material.poisson_ratio = 0;
  material.damping_beta = 0;
  BodyModel tool("tool", moved(barMesh({0.04, 0.04, 0.04}, {2, 2, 2}), at({0, 0, 0.03 + thickness})), material, 1.0);
  holdNodes(
      tool, [](const Vec3& p) { return p.z() > 0.07; }, lopsided(1e8));
  world.add(std::move(tool));
  if (base == Base::soft) {
    material.youngs_modulus = 3e4;
    world.add(BodyModel("block", barMesh({0.04, 0.04, 0.03}, {2, 2, 2}), material, 1.0));
  } else {
    const Pose pose{Vec3(0.02, 0.02, 0.015), Quat::Identity()};
    world.add(BodyModel::rigid("block", placed(boxSurface({0.04, 0.04, 0.03}, {2, 2, 2}), pose), 500, 1.0));
  }
  Pose pose = world.tool().state.handle.pose;
  for (int i = 0; i < 80; ++i) {
    if (i < 20) pose.position.z() -= 5e-5;
    world.setHandle(world.toolIndex(), {pose, Vec6::Zero()});
    EXPECT_NE(world.step({pose, Vec6::Zero()}, kStep).status, StepStatus::restored);
  }
  EXPECT_NE(world.evaluate({pose, Vec6::Zero()}, kLong).status, StepStatus::restored);
  return -linearize(world, {delassus, Derivative::frozen}, 0).kx(2, 2);
}

TEST(GivingWay, StiffnessIsThatOfSpringsInSeries) {
  const double area = 0.04 * 0.04;
  const double tool = 2e4 * area / 0.04;  // E A / L [N/m]
  const double block = 3e4 * area / 0.03;
  const double series = 1 / (1 / tool + 1 / block);
  // Uniform stress makes the springs' law exact; it is uniform as far as contacts hold the faces everywhere: to 1 %,
  // from below.
  for (const bool reduce : {false, true}) {
    const double rigid = pressedStiffness(Base::rigid, reduce);
    const double soft_block = pressedStiffness(Base::soft, reduce);
    EXPECT_NEAR(rigid, tool, 0.01 * tool);
    EXPECT_NEAR(soft_block, series, 0.01 * series);
    EXPECT_LT(rigid, 1.001 * tool);
    EXPECT_LT(soft_block, 1.001 * series);
  }
}

// `hsl` leaves other bodies out, as the paper does: the block gives no way, and does not float away either. Giving way
// it would take a third off, as of springs in series; what is left, less than half of that, is which contacts are
// chosen.
TEST(GivingWay, DiagonalModelFeelsTheToolAlone) {
  const double rigid = pressedStiffness(Base::rigid, true, DelassusModel::diagonal);
  const double soft_block = pressedStiffness(Base::soft, true, DelassusModel::diagonal);
  const double tool = 2e4 * 0.04 * 0.04 / 0.04, block = 3e4 * 0.04 * 0.04 / 0.03;
  const double given_way = tool / (tool + block);
  EXPECT_NEAR(soft_block, rigid, 0.5 * given_way * rigid);
  EXPECT_GT(rigid, 0.5 * tool);
}

// Two contacts so near each other that W of both is singular but for a part in 10^10: their impulses are still those
// that W says.
TEST(ActiveContacts, NearlyRedundantOnesAreSolvedExactly) {
  constexpr double kApart = 0x1p-33;
  MatX w = MatX::Identity(6, 6);
  w(0, 3) = w(3, 0) = 1.0;
  w(3, 3) = 1.0 + kApart;
  ActiveContacts active;
  active.delassus = &w;
  active.model = DelassusModel::exact;
  active.law.contact = {0, 1};
  active.law.b = active.law.c = Vec3::UnitX().replicate(1, 2);
  active.law.d = VecX::Zero(2);
  MatX given = MatX::Zero(6, 12);
  given.row(3).setConstant(-kApart);  // of the impulses 1 and -1
  const MatX found = active.impulseResponse(MatX::Zero(6, 12), given);
  EXPECT_LT((found.row(0).array() - 1.0).abs().maxCoeff(), 0.01);
  EXPECT_LT((found.row(3).array() + 1.0).abs().maxCoeff(), 0.01);
}

// It has no derivatives but rounding, which is no error.
TEST(LinearizationCheck, TakesARigidToolInFreeMotion) {
  World world;
  world.link = {500, 2, 1, 1e-3};
  BodyModel ball = BodyModel::rigid("probe", sphereSurface(0.01), 2000);
  ball.holdRigid("grip", 0.02, Vec3::Zero(), expRotation({0.3, -0.2, 0.1}));
  world.add(std::move(ball));
  Pose device = world.tool().state.handle.pose;
  device.position += Vec3(0.01, -0.02, 0.005);
  LinearizationSettings settings;
  settings.delassus = DelassusModel::exact;
  const LinearizationCheck check = checkLinearization(world, {device, Vec6::Zero()}, kStep, settings);
  EXPECT_LT(check.kx_frozen.worst(), 1e-6);
  EXPECT_LT(check.kv_frozen.worst(), 1e-6);
}

}  // namespace
}  // namespace palpate
