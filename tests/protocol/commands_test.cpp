#include "palpate/protocol/commands.h"

#include <gtest/gtest.h>

#include <string>

#include "palpate/common/error.h"

namespace palpate {
namespace {

TEST(ViewerCommands, ReadsEveryKind) {
  EXPECT_TRUE(std::holds_alternative<TakeMessage>(parseCommand(R"({"type":"take"})")));
  EXPECT_TRUE(std::holds_alternative<ReleaseMessage>(parseCommand(R"({"type":"release"})")));
  EXPECT_TRUE(std::holds_alternative<PlayMessage>(parseCommand(R"({"type":"play"})")));
  EXPECT_TRUE(std::holds_alternative<PauseMessage>(parseCommand(R"({"type":"pause"})")));
  EXPECT_TRUE(std::holds_alternative<ResumeMessage>(parseCommand(R"({"type":"resume"})")));
  EXPECT_TRUE(std::holds_alternative<StepMessage>(parseCommand(R"({"type":"step"})")));
  EXPECT_TRUE(std::holds_alternative<ResetMessage>(parseCommand(R"({"type":"reset"})")));
  EXPECT_EQ(std::get<SceneMessage>(parseCommand(R"({"type":"scene","name":"bunny"})")).name, "bunny");
  EXPECT_TRUE(std::get<RecordMessage>(parseCommand(R"({"type":"record","on":true})")).on);
}

TEST(ViewerCommands, ReadsTheHand) {
  const auto hand =
      std::get<HandMessage>(parseCommand(R"({"type":"hand","seq":12,"position":[0.1,-0.2,0.3],"rotation":[0,2,0,0]})"));
  EXPECT_EQ(hand.sequence, 12u);
  EXPECT_EQ(hand.pose.position, Vec3(0.1, -0.2, 0.3));
  EXPECT_NEAR(hand.pose.rotation.x(), 1.0, 1e-15);
}

TEST(ViewerCommands, ReadsSettings) {
  const auto set = std::get<SetMessage>(parseCommand(
      R"({"type":"set","method":"vc","visual_step":0.02,"friction":0,"stiffness":3,"speed":0.1,"stress":true})"));
  EXPECT_EQ(set.method, "vc");
  EXPECT_EQ(set.visual_step, 0.02);
  EXPECT_EQ(set.friction, 0.0);
  EXPECT_EQ(set.stiffness, 3.0);
  EXPECT_EQ(set.speed, 0.1);
  EXPECT_EQ(set.stress, true);
  EXPECT_FALSE(set.handle);
}

TEST(ViewerCommands, RefusesWhatIsNone) {
  for (const std::string bad : {"",
                                "nonsense",
                                "[]",
                                "3",
                                "{}",
                                R"({"type":3})",
                                R"({"type":"fly"})",
                                R"({"type":"hand"})",
                                R"({"type":"hand","seq":1,"position":[0,0],"rotation":[1,0,0,0]})",
                                R"({"type":"hand","seq":1,"position":[0,0,1e9],"rotation":[1,0,0,0]})",
                                R"({"type":"hand","seq":-1,"position":[0,0,0],"rotation":[1,0,0,0]})",
                                R"({"type":"hand","seq":1,"position":[0,0,0],"rotation":[0,0,0,0]})",
                                R"({"type":"hand","seq":1,"position":[0,0,"a"],"rotation":[1,0,0,0]})",
                                R"({"type":"hand","seq":1,"position":[0,0,1e400],"rotation":[1,0,0,0]})",
                                R"({"type":"set","speed":0})",
                                R"({"type":"set","stiffness":-1})",
                                R"({"type":"set","friction":"much"})",
                                R"({"type":"set","stress":1})",
                                R"({"type":"set","colour":1})",
                                R"({"type":"scene"})",
                                R"({"type":"record","on":"yes"})"}) {
    EXPECT_THROW(parseCommand(bad), InputError) << bad;
  }
  EXPECT_THROW(parseCommand(R"({"type":"scene","name":")" + std::string(300, 'x') + "\"}"), InputError);
  EXPECT_THROW(parseCommand(std::string(2000, '[') + std::string(2000, ']')), InputError);
}

}  // namespace
}  // namespace palpate
