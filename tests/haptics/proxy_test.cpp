#include "palpate/haptics/proxy.h"

#include <gtest/gtest.h>

#include "palpate/common/error.h"
#include "shared/haptic_models.h"
#include "shared/tick.h"

namespace palpate {
namespace {

using test::deviceAt;
using test::randomMatrix;
using test::randomPose;
using test::randomVec6;

const LinkParameters kLink{700.0, 5.0, 1.0, 0.005};

ProxySettings lopsidedProxy() {
  ProxySettings settings;
  settings.mass = 0.08;
  settings.inertia = Vec3(1e-5, 3e-5, 6e-5).asDiagonal();
  settings.inertia(0, 1) = settings.inertia(1, 0) = 4e-6;
  return settings;
}

/// The nonlinear equation of a tick, written out on its own: M (u' - u) - dt * forces(u').
Vec6 residual(const HandleProxy& proxy, const HandleModel* model, const LinkParameters& link, const DeviceState& device,
              const Vec6& next) {
  const Mat3 rotation = proxy.pose().matrix();
  const Mat3 inertia = rotation * proxy.settings().inertia * rotation.transpose();
  const Pose pose = advance(proxy.pose(), kDt * next);
  Vec6 force = -couplingWrench(link, pose, next, device);
  force.head<3>() += proxy.settings().mass * proxy.settings().gravity;
  force.tail<3>() -= next.tail<3>().cross(inertia * next.tail<3>());
  if (model) force += model->force + model->kx * poseDifference(pose, model->pose) + model->kv * (next - model->twist);
  const Vec6 change = next - proxy.twist();
  Vec6 momentum;
  momentum << proxy.settings().mass * change.head<3>(), inertia * change.tail<3>();
  return momentum - kDt * force;
}

TEST(HandleProxy, SystemIsTheDerivativeOfTheTick) {
  std::mt19937 random(1);
  for (int trial = 0; trial < 20; ++trial) {
    HandleProxy proxy(lopsidedProxy());
    proxy.reset(randomPose(random, 0.1, 1.0), randomVec6(random, 0.5, 20.0));
    HandleModel model;
    model.pose = advance(proxy.pose(), randomVec6(random, 0.02, 0.8));
    model.twist = randomVec6(random, 0.5, 5.0);
    model.force = randomVec6(random, 5.0, 0.1);
    model.kx = randomMatrix(random, 3000.0, 0.03);
    model.kv = randomMatrix(random, 30.0, 0.03);
    const DeviceState device = deviceAt(advance(proxy.pose(), randomVec6(random, 0.02, 1.0)), randomVec6(random, 1, 5));

    const ProxySystem system = proxy.assemble(&model, kLink, device, kDt);
    const Vec6 rhs = -residual(proxy, &model, kLink, device, proxy.twist());
    EXPECT_LT((system.rhs - rhs).norm(), 1e-12 * rhs.norm());

    const double step = 1e-2;  // dt makes it small; the equation is nearly linear
    Mat6 numeric;
    for (int i = 0; i < 6; ++i) {
      const Vec6 delta = step * Vec6::Unit(i);
      numeric.col(i) = (residual(proxy, &model, kLink, device, proxy.twist() + delta) -
                        residual(proxy, &model, kLink, device, proxy.twist() - delta)) /
                       (2.0 * step);
    }
    for (int row = 0; row < 6; row += 3)
      for (int col = 0; col < 6; col += 3) {
        const Mat3 exact = numeric.block<3, 3>(row, col);
        EXPECT_LT((system.matrix.block<3, 3>(row, col) - exact).norm(), 1e-7 * exact.norm()) << row << " " << col;
      }
  }
}

TEST(HandleProxy, TickSolvesTheNonlinearEquation) {
  // Translation exactly; rotation by one Newton step, whose error falls with the square of the distance.
  const auto rest = [](double scale) {
    std::mt19937 random(2);
    HandleProxy proxy(lopsidedProxy());
    proxy.reset(randomPose(random, 0.1, 1.0), randomVec6(random, 0.3, 3.0));
    HandleModel model;
    model.pose = advance(proxy.pose(), scale * randomVec6(random, 0.01, 0.3));
    model.kx = -Mat6(Vec6(300, 300, 300, 0.5, 0.5, 0.5).asDiagonal());
    const DeviceState device = deviceAt(advance(proxy.pose(), scale * randomVec6(random, 0.01, 0.3)), proxy.twist());
    const HandleProxy before = proxy;
    const Vec6 start = residual(before, &model, kLink, device, before.twist());
    proxy.step(&model, kLink, device, kDt);
    const Vec6 left = residual(before, &model, kLink, device, proxy.twist());
    EXPECT_LT(left.head<3>().norm(), 1e-12 * start.head<3>().norm());
    EXPECT_LT(left.tail<3>().norm(), 0.02 * start.tail<3>().norm());
    return left.tail<3>().norm();
  };
  EXPECT_LT(rest(0.1), 0.03 * rest(1.0));
}

TEST(HandleProxy, MatchesTheScalarTickOfTheOneDimensionalExperiment) {
  ProxySettings settings;
  settings.mass = 0.05;
  settings.gravity.setZero();
  settings.max_stretch = 10.0;
  HandleProxy proxy(settings);
  const LinkParameters link{1000.0, 5.0, 1.0, 0.0};
  HandleModel model;
  model.force.x() = 0.7;
  model.pose.position.x() = 0.01;
  model.twist[0] = -0.2;
  model.kx(0, 0) = -150.0;
  model.kv(0, 0) = -0.4;
  double x = 0.0, v = 0.0;
  for (int i = 0; i < 500; ++i) {
    const double t = i * kDt;
    const double xd = 0.05 * std::sin(9.0 * t), vd = 0.45 * std::cos(9.0 * t);
    DeviceState device;
    device.pose.position.x() = xd;
    device.twist[0] = vd;
    proxy.step(&model, link, device, kDt);
    // m (v' - v)/dt = F + kx (x + dt v' - x0) + kv (v' - v0) - kd (x + dt v' - xd) - bd (v' - vd)
    const double a = settings.mass - kDt * (-0.4 - 5.0) - kDt * kDt * (-150.0 - 1000.0);
    v = (settings.mass * v + kDt * (0.7 - 150.0 * (x - 0.01) - 0.4 * 0.2 - 1000.0 * (x - xd) + 5.0 * vd)) / a;
    x += kDt * v;
    ASSERT_NEAR(proxy.pose().position.x(), x, 1e-14);
    ASSERT_NEAR(proxy.twist()[0], v, 1e-12);
  }
  EXPECT_GT(std::abs(x), 1e-3);
}

TEST(HandleProxy, SettlesWhereSpringsAndWeightBalance) {
  ProxySettings settings = lopsidedProxy();
  HandleProxy proxy(settings);
  HandleModel model;
  model.kx = -Mat6(Vec6(300, 300, 300, 0.5, 0.5, 0.5).asDiagonal());
  model.force << 1.0, 0.0, 0.0, 0.0, 0.05, 0.0;
  for (int i = 0; i < 20000; ++i) proxy.step(&model, kLink, DeviceState{}, kDt);
  EXPECT_NEAR(proxy.pose().position.x(), 1.0 / 1000.0, 1e-9);
  EXPECT_NEAR(proxy.pose().position.z(), -0.08 * 9.81 / 1000.0, 1e-9);
  EXPECT_NEAR(logRotation(proxy.pose().rotation).y(), 0.05 / 1.5, 1e-8);
}

TEST(HandleProxy, FreeSpinKeepsItsMomentumAndGainsNoEnergy) {
  const LinkParameters none{0, 0, 0, 0};
  const auto drift = [&](double dt) {
    ProxySettings settings = lopsidedProxy();
    settings.gravity.setZero();
    settings.max_turn = 3.2;
    HandleProxy proxy(settings);
    Vec6 twist = Vec6::Zero();
    twist.tail<3>() << 1.0, 20.0, 3.0;  // near the middle axis: it tumbles
    proxy.reset(Pose{}, twist);
    const auto momentum = [&] {
      const Mat3 r = proxy.pose().matrix();
      return Vec3(r * settings.inertia * r.transpose() * proxy.twist().tail<3>());
    };
    const Vec3 first = momentum();
    const double energy = 0.5 * first.dot(proxy.twist().tail<3>());
    for (int i = 0; i < static_cast<int>(std::lround(1.0 / dt)); ++i) {
      proxy.step(nullptr, none, DeviceState{}, dt);
      EXPECT_LT(0.5 * momentum().dot(proxy.twist().tail<3>()), 1.001 * energy);
    }
    return (momentum() - first).norm() / first.norm();
  };
  const double coarse = drift(1e-3);
  const double fine = drift(2.5e-4);
  EXPECT_LT(coarse, 0.3);
  EXPECT_LT(fine, 0.4 * coarse);  // first order
}

TEST(HandleProxy, ActiveModelStaysSolvable) {
  // dt Kv alone cancels the mass: the plain system is singular along x.
  ProxySettings settings;
  HandleProxy proxy(settings);
  HandleModel model;
  model.kv(0, 0) = settings.mass / kDt + kLink.damping + kDt * kLink.stiffness;
  model.force.x() = 1.0;
  EXPECT_LT(std::abs(proxy.assemble(&model, kLink, DeviceState{}, kDt).matrix(0, 0)), 1e-15);
  const TickFlags flags = proxy.step(&model, kLink, DeviceState{}, kDt);
  EXPECT_TRUE(flags.has(TickFlag::stiffness_projected));
  // What is left of A along x is the mass and the link.
  EXPECT_NEAR(proxy.twist()[0], kDt / (settings.mass + kDt * (kLink.damping + kDt * kLink.stiffness)), 1e-12);
}

TEST(HandleProxy, DampingModelIsNotTouchedByTheProjection) {
  std::mt19937 random(3);
  HandleProxy proxy(lopsidedProxy());
  HandleModel model;
  const Mat6 root = randomMatrix(random, 30.0, 0.03);
  model.kx = -root * root.transpose();
  Mat6 swirl = randomMatrix(random, 1e4, 0.03);
  model.kx += swirl - swirl.transpose();  // not symmetric, as under sliding friction
  for (int i = 0; i < 100; ++i)
    EXPECT_FALSE(proxy.step(&model, kLink, DeviceState{}, kDt).has(TickFlag::stiffness_projected));
}

TEST(HandleProxy, RandomModelsNeitherBreakNorLoseTheProxy) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> exponent(0.0, 9.0);
  HandleProxy proxy(lopsidedProxy());
  const ProxySettings& settings = proxy.settings();
  int projected = 0;
  for (int trial = 0; trial < 300; ++trial) {
    HandleModel model;
    model.pose = randomPose(random, 0.3, 3.0);
    model.twist = randomVec6(random, 1.0, 10.0);
    model.force = randomVec6(random, 10.0, 1.0);
    model.kx = randomMatrix(random, std::pow(10.0, exponent(random)), 0.03);
    model.kv = randomMatrix(random, std::pow(10.0, exponent(random) - 2.0), 0.03);
    for (int i = 0; i < 33; ++i) {
      const DeviceState device = deviceAt(randomPose(random, 0.05, 3.0), randomVec6(random, 5.0, 20.0));
      projected += proxy.step(&model, kLink, device, kDt).has(TickFlag::stiffness_projected);
      ASSERT_TRUE(proxy.twist().allFinite());
      ASSERT_TRUE(proxy.pose().rotation.coeffs().allFinite());
      const Vec6 stretch = poseDifference(proxy.pose(), device.pose);
      ASSERT_LE(stretch.head<3>().norm(), settings.max_stretch * (1 + 1e-9));
      ASSERT_LE(stretch.tail<3>().norm(), settings.max_turn * (1 + 1e-9));
      ASSERT_LE(proxy.twist().head<3>().norm(), settings.max_speed + 10.0);
    }
  }
  EXPECT_GT(projected, 1000);
}

TEST(HandleProxy, RecoversFromAnActiveModel) {
  HandleProxy proxy(lopsidedProxy());
  HandleModel active;
  active.kx = 1e5 * Mat6::Identity();
  active.force.x() = 1.0;
  for (int i = 0; i < 200; ++i) proxy.step(&active, kLink, DeviceState{}, kDt);
  EXPECT_GT(proxy.pose().position.norm(), 0.2);
  const HandleModel calm;
  for (int i = 0; i < 1000; ++i) proxy.step(&calm, kLink, DeviceState{}, kDt);
  EXPECT_LT(poseDifference(proxy.pose(), Pose{}).head<3>().norm(), 0.01);
}

TEST(HandleProxy, FarTurnFromTheModelIsClamped) {
  ProxySettings settings = lopsidedProxy();
  HandleProxy proxy(settings);
  HandleModel model;
  model.kx.bottomRightCorner<3, 3>() = -0.1 * Mat3::Identity();
  const auto torque = [&](double angle) {
    Vec6 turn = Vec6::Zero();
    turn[3] = angle;
    proxy.reset(advance(Pose{}, turn), Vec6::Zero());
    return proxy.assemble(&model, LinkParameters{0, 0, 0, 0}, DeviceState{}, kDt).rhs[3] / kDt;
  };
  EXPECT_NEAR(torque(1.9), -0.19, 1e-12);
  EXPECT_NEAR(torque(2.5), -0.1 * settings.max_model_rotation, 1e-12);
  EXPECT_NEAR(torque(3.1), -0.1 * settings.max_model_rotation, 1e-12);
}

TEST(HandleProxy, RejectsBadSettings) {
  const auto with = [](auto change) {
    ProxySettings settings;
    change(settings);
    return settings;
  };
  EXPECT_THROW(HandleProxy(with([](auto& s) { s.mass = -1.0; })), InputError);
  EXPECT_THROW(HandleProxy(with([](auto& s) { s.mass = std::nan(""); })), InputError);
  EXPECT_THROW(HandleProxy(with([](auto& s) { s.inertia(2, 2) = 0.0; })), InputError);
  EXPECT_THROW(HandleProxy(with([](auto& s) { s.inertia(0, 1) = 1e-6; })), InputError);
  EXPECT_THROW(HandleProxy(with([](auto& s) { s.gravity.x() = INFINITY; })), InputError);
  EXPECT_THROW(HandleProxy(with([](auto& s) { s.max_turn = 0.0; })), InputError);
}

}  // namespace
}  // namespace palpate
