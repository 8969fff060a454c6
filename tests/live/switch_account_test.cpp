#include "palpate/live/switch_account.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "palpate/live/live_tick.h"
#include "shared/live_examples.h"

namespace palpate {
namespace {

using namespace test;
using Verdict = SwitchAccount::Verdict;

struct Switch {
  LiveModel model = softTool(6, 4, 2, 5);
  LiveState state = startState(model);
  Pose pose;
  Vec6 twist = Vec6::Zero();
  Vec3 gravity = Vec3(0, 0, -9.81);
  double energy() const { return liveEnergy(model, state, pose, twist, gravity); }
  /// Gives the modes a kinetic energy [J]; the handle stands still.
  void swing(double kinetic) {
    state.speed.setOnes();
    state.speed *= std::sqrt(2 * kinetic / state.speed.squaredNorm());
  }
  Verdict into(SwitchAccount& account, double before) {
    return account.change(before, model, pose, twist, gravity, state);
  }
};

TEST(SwitchAccount, ModelOfTheSameEnergyIsTakenAsItIs) {
  Switch s;
  s.swing(0.01);
  const ModalVector speed = s.state.speed;
  SwitchAccount account;
  EXPECT_EQ(s.into(account, s.energy()), Verdict::taken);
  EXPECT_EQ(s.state.speed, speed);
  EXPECT_EQ(account.rises(), 0.0);
}

TEST(SwitchAccount, RisesArePaidFromWhatIsSaved) {
  Switch s;
  SwitchAccount account;
  const double before = s.energy();
  s.swing(0.6 * SwitchAccount::kCap);
  EXPECT_EQ(s.into(account, before), Verdict::taken);
  EXPECT_NEAR(account.saved(), 0.4 * SwitchAccount::kCap, 1e-12);
  s.swing(0.6 * SwitchAccount::kCap);  // once more: a third of it is not paid for
  EXPECT_EQ(s.into(account, before), Verdict::damped);
  EXPECT_NEAR(s.energy() - before, 0.4 * SwitchAccount::kCap, 1e-9);
  EXPECT_NEAR(account.saved(), 0.0, 1e-9);
  account.earn(0.3 * SwitchAccount::kCap);
  EXPECT_NEAR(account.saved(), 0.3 * SwitchAccount::kCap, 1e-9);
  account.earn(1.0);
  EXPECT_EQ(account.saved(), SwitchAccount::kCap);
  account.earn(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(account.saved(), SwitchAccount::kCap);
}

// Elastic energy cannot be scaled away: the modes come to rest, and the model counts from then on.
TEST(SwitchAccount, StrainThatIsThereIsTakenAtRest) {
  Switch s;
  SwitchAccount account;
  s.swing(0.001);
  EXPECT_EQ(s.into(account, s.energy() - 0.001 - 1.2 * SwitchAccount::kCap), Verdict::damped);
  EXPECT_EQ(s.state.speed.norm(), 0.0);
  EXPECT_NEAR(account.rises(), 1.2 * SwitchAccount::kCap, 1e-9);
}

TEST(SwitchAccount, ModelThatBringsFarTooMuchIsRefusedButNotForever) {
  Switch s;
  SwitchAccount account;
  for (int k = 0; k < SwitchAccount::kMostRefused; ++k) {
    s.swing(0.01);
    EXPECT_EQ(s.into(account, s.energy() - 100.0), Verdict::refused);
    EXPECT_GT(s.state.speed.norm(), 0.0) << "a refused model stays as it was";
  }
  s.state.z.setConstant(0.1);
  EXPECT_EQ(s.into(account, s.energy() - 100.0), Verdict::damped);
  EXPECT_EQ(s.state.speed.norm(), 0.0);
  EXPECT_EQ(s.state.z.norm(), 0.0);
}

}  // namespace
}  // namespace palpate
