#include "palpate/haptics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "shared/count_allocations.h"

// What include/palpate/haptics.h promises, through the shared library. The method itself is tested in tests/haptics.

namespace {

using palpate::HandleModel;
using palpate::HapticLoop;
using palpate::HapticSettings;
using palpate::Pose;
using palpate::Tick;
using palpate::TickFlag;
using palpate::Vector6;

constexpr double kStep = 0.001;

Pose at(double z) { return {{0, 0, z}, {1, 0, 0, 0}}; }

HapticSettings weightless() {
  HapticSettings settings;
  settings.proxy.gravity = {0, 0, 0};
  return settings;
}

/// A spring of 300 N/m that is at rest where z is 0.
HandleModel spring(double time) {
  HandleModel model;
  model.kx[2 * 6 + 2] = -300;
  model.kv[2 * 6 + 2] = -3;
  model.time = time;
  return model;
}

TEST(LibraryHaptics, HasTheVersionOfItsHeaders) { EXPECT_STREQ(palpate::version(), PALPATE_VERSION_STRING); }

TEST(LibraryHaptics, ErrorsHaveFileKeyAndCauseApart) {
  const palpate::InputError error("a.yaml", "tool.shape (line 7)", "is none");
  EXPECT_STREQ(error.what(), "a.yaml: tool.shape (line 7): is none");
  EXPECT_EQ(error.file(), "a.yaml");
  EXPECT_EQ(error.key(), "tool.shape");
  EXPECT_EQ(error.cause(), "is none");
}

TEST(LibraryHaptics, MovedAndDifferenceAreInverse) {
  const Pose from{{0.1, -0.2, 0.3}, {std::cos(0.4), 0, std::sin(0.4), 0}};
  const Vector6 change{0.01, 0.02, -0.03, 0.2, -0.5, 0.7};
  const Vector6 back = palpate::difference(palpate::moved(from, change), from);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(back[i], change[i], 1e-14) << i;
}

TEST(LibraryHaptics, AModelIsAffineWithMatricesByRows) {
  HandleModel model;
  model.pose = at(0.1);
  model.twist[3] = 1;
  model.force[2] = 5;
  model.kx[2 * 6 + 0] = -100;  // force along z from motion along x
  model.kv[4 * 6 + 3] = -2;    // torque about y from turning about x
  const Vector6 force = model.at(palpate::moved(at(0.1), {0.01, 0, 0, 0, 0, 0}), {0, 0, 0, 1.5, 0, 0});
  const Vector6 expected{0, 0, 4, 0, -1, 0};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(force[i], expected[i], 1e-12) << i;
}

TEST(LibraryHaptics, ALinkPullsTheDeviceToTheHandleWithinItsPeak) {
  palpate::Link link;
  link.stiffness = 500;
  palpate::DeviceState device{at(0)};
  EXPECT_NEAR(link.wrenchOnDevice(at(0.002), {}, device)[2], 1.0, 1e-12);
  link.peak_force = 0.5;
  EXPECT_NEAR(link.wrenchOnDevice(at(0.002), {}, device)[2], 0.5, 1e-12);
}

TEST(LibraryHaptics, ThePressedSpringIsFeltInSeriesWithTheLink) {
  HapticSettings settings = weightless();
  settings.link.stiffness = 600;
  HapticLoop loop(settings);
  loop.start(at(0), at(0), 0);
  Tick tick;
  for (int k = 0; k < 3000; ++k) {
    const double t = k * kStep;
    const HandleModel model = spring(t);
    tick = loop.tick({at(-0.01 * std::min(1.0, t))}, &model, t);
  }
  EXPECT_NEAR(tick.sent[2], 0.01 * 300 * 600 / 900, 1e-3);
  EXPECT_NEAR(tick.proxy.position[2], -0.01 * 600 / 900, 1e-5);
  EXPECT_EQ(tick.flags, 0u);
}

TEST(LibraryHaptics, WithVirtualCouplingTheLinkPullsTowardsTheHandle) {
  HapticSettings settings = weightless();
  settings.rendering = palpate::Rendering::virtual_coupling;
  HapticLoop loop(settings);
  loop.start(at(0), at(0), 0);
  HandleModel model;
  Tick tick;
  for (int k = 0; k < 100; ++k) {
    model.time = k * kStep;
    model.handle_pose = at(0.001);
    tick = loop.tick({at(0)}, &model, k * kStep);
  }
  EXPECT_NEAR(tick.sent[2], 0.7, 1e-12);
}

TEST(LibraryHaptics, SaysWhatWasOutOfTheOrdinary) {
  HapticLoop loop(weightless());
  loop.start(at(0), at(0), 0);
  EXPECT_TRUE(palpate::has(loop.tick({at(0)}, nullptr, 0).flags, TickFlag::model_missing));
  palpate::DeviceState broken{at(std::nan(""))};
  const HandleModel model = spring(0);
  const Tick tick = loop.tick(broken, &model, kStep);
  EXPECT_TRUE(palpate::has(tick.flags, TickFlag::device_rejected));
  EXPECT_FALSE(palpate::has(tick.flags, TickFlag::model_missing));
  EXPECT_TRUE(std::isfinite(tick.sent[2]));
  EXPECT_EQ(loop.count(TickFlag::device_rejected), 1u);
  EXPECT_STREQ(palpate::toString(TickFlag::device_rejected), "device_rejected");
  EXPECT_STREQ(palpate::toString(TickFlag::device_limited), "device_limited");
  EXPECT_STREQ(palpate::toString(TickFlag::count), "");
}

TEST(LibraryHaptics, AStateGivenBackMakesTheLoopGoOnToTheBit) {
  const HandleModel model = spring(0);
  const auto run = [&](HapticLoop& loop, int from) {
    Tick tick;
    for (int k = from; k < from + 50; ++k) tick = loop.tick({at(-1e-4 * k)}, &model, k * kStep);
    return tick.sent;
  };
  HapticLoop loop(weightless());
  loop.start(at(0), at(0), 0);
  run(loop, 0);
  const palpate::HapticState state = loop.state();
  const Vector6 expected = run(loop, 50);
  loop.restore(state);
  EXPECT_EQ(run(loop, 50), expected);
  HapticLoop other(weightless());
  other.restore(state);
  EXPECT_EQ(run(other, 50), expected);
  EXPECT_THROW(other.restore({}), palpate::InputError);
}

TEST(LibraryHaptics, SettingsOutOfRangeAreErrorsOfTheLibrary) {
  HapticSettings settings;
  settings.safety.peak_force = -1;
  EXPECT_THROW(HapticLoop{settings}, palpate::InputError);
  EXPECT_THROW(palpate::SafetyChain{settings.safety}, palpate::InputError);
  EXPECT_THROW(palpate::prescribedDevice({{{1.0}, {0.5}}}, {}), palpate::InputError);
}

TEST(LibraryHaptics, TheForceLeavesAndComesBack) {
  HapticLoop loop(weightless());
  loop.start(at(0), at(0), 0);
  const HandleModel model = spring(0);
  int k = 0;
  const auto tick = [&] { return loop.tick({at(-0.002)}, &model, kStep * k++).sent[2]; };
  for (int i = 0; i < 100; ++i) tick();
  EXPECT_GT(tick(), 0.1);
  loop.leave();
  for (int i = 0; i < 150; ++i) tick();
  EXPECT_TRUE(loop.gone());
  EXPECT_EQ(tick(), 0.0);
  loop.comeBack();
  EXPECT_FALSE(loop.gone());
}

TEST(LibraryHaptics, TheSafetyStageAloneCutsAndCountsEnergy) {
  palpate::Safety settings;
  settings.peak_force = 2;
  settings.max_slew = palpate::kUnlimited;
  palpate::SafetyChain chain(settings);
  chain.start({}, {at(0)});
  const auto first = chain.process({0, 0, 5, 0, 0, 0}, {at(0)}, 0, kStep);
  EXPECT_NEAR(first.wrench[2], 2, 1e-12);
  EXPECT_TRUE(palpate::has(first.flags, TickFlag::force_clamped));
  chain.process({0, 0, 5, 0, 0, 0}, {at(0.001)}, 0, 2 * kStep);
  EXPECT_NEAR(chain.deliveredEnergy(), 0.002, 1e-12);
  const auto broken = chain.process({0, 0, std::nan(""), 0, 0, 0}, {at(0.001)}, 0, 3 * kStep);
  EXPECT_EQ(broken.wrench, Vector6{});
  chain.leave();
  for (int k = 4; k < 200; ++k) chain.process({0, 0, 1, 0, 0, 0}, {at(0.001)}, 0, k * kStep);
  EXPECT_TRUE(chain.gone());
}

TEST(LibraryHaptics, TheNewestModelCrosses) {
  palpate::ModelExchange models;
  EXPECT_EQ(models.newest(), nullptr);
  models.publish(spring(1));
  models.publish(spring(2));
  ASSERT_NE(models.newest(), nullptr);
  EXPECT_EQ(models.newest()->time, 2);
}

TEST(LibraryHaptics, ASimulatedHandGivesWayAndRemembers) {
  const auto make = [] { return palpate::simulatedDevice({{{0}, {0.1, {0, 0, 0.01}}}}, at(0)); };
  const auto device = make();
  device->begin(at(0), {});
  const auto run = [](palpate::Device& of, int from, double force) {
    for (int k = from; k < from + 100; ++k) of.apply({0, 0, force, 0, 0, 0}, k * kStep, kStep);
    return of.sample(kStep * (from + 100)).pose.position[2];
  };
  EXPECT_NEAR(run(*device, 0, 0), 0.01, 2e-3);
  const std::vector<double> memory = device->save();
  const double yielded = run(*device, 100, -1);
  EXPECT_LT(yielded, 0.009);  // 1 N on 500 N/m
  const auto other = make();
  other->restore(memory);
  EXPECT_EQ(run(*other, 100, -1), yielded);
  EXPECT_THROW(other->restore({1, 2, 3}), palpate::InputError);
}

TEST(LibraryHaptics, DevicesOnADeskAreFoundByName) {
  const auto kinds = palpate::deviceKinds();
  ASSERT_FALSE(kinds.empty());
  EXPECT_THROW(palpate::openDevice("lever", "", at(0)), palpate::InputError);
  try {
    palpate::openDevice(kinds.front().first, "colour=red", at(0));
    FAIL();
  } catch (const palpate::InputError& e) {
    EXPECT_EQ(e.key(), "colour");
  }
}

TEST(LibraryHaptics, ALoopInRealTimeEndsWithoutForce) {
  HapticLoop loop(weightless());
  loop.start(at(0), at(0), 0);
  const auto device = palpate::prescribedDevice({{{0}, {0.02, {0, 0, -0.005}}}}, at(0));
  palpate::ModelExchange models;
  models.publish(spring(0));
  std::atomic<bool> stop{false};
  double peak = 0, last = 1;
  const palpate::LoopReport report = palpate::runHapticLoop(loop, *device, models, 0.1, stop, [&](const Tick& tick) {
    peak = std::max(peak, tick.sent[2]);
    last = tick.sent[2];
  });
  EXPECT_GT(peak, 0.0);
  EXPECT_EQ(last, 0.0);
  EXPECT_TRUE(loop.gone());
  EXPECT_GT(report.ticks, 0u);
  EXPECT_LE(report.work_us[0], report.work_us[3]);
}

#if PALPATE_COUNTS_MALLOC
TEST(LibraryHaptics, ATickAllocatesNothing) {
  HapticLoop loop(weightless());
  loop.start(at(0), at(0), 0);
  palpate::ModelExchange models;
  palpate::SafetyChain chain({});
  const auto device = palpate::simulatedDevice({}, at(0));
  palpate::test::allocations = 0;
  palpate::test::counting = true;
  for (int k = 0; k < 100; ++k) {
    const double t = (k + 1) * kStep;
    models.publish(spring(t));
    const Tick tick = loop.tick(device->sample(t), models.newest(), t);
    chain.process(tick.raw, tick.device, 0, t);
    device->apply(tick.sent, t, kStep);
  }
  palpate::test::counting = false;
  EXPECT_EQ(palpate::test::allocations, 0);
}
#endif

}  // namespace
