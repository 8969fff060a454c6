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
  EXPECT_TRUE(std::holds_alternative<CancelMessage>(parseCommand(R"({"type":"cancel"})")));
  EXPECT_TRUE(std::holds_alternative<SaveMessage>(parseCommand(R"({"type":"save"})")));
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

TEST(ViewerCommands, ReadsWhereASurfaceGoes) {
  const std::string common = R"({"type":"place","size":0.2,"rotation":[0,0,2,0],"tetrahedra":50,"handle":)";
  const auto read = [&](const std::string& rest) { return std::get<PlaceMessage>(parseCommand(common + rest)); };
  const PlaceMessage top = read(R"("top"})");
  EXPECT_EQ(top.size, 0.2);
  EXPECT_EQ(top.tetrahedra, 50);
  EXPECT_NEAR(top.rotation.y(), 1.0, 1e-15);
  EXPECT_EQ(top.handle, PlaceMessage::Handle::top);
  const PlaceMessage box = read(R"("box","min":[0,0,0.1],"max":[1,2,3]})");
  EXPECT_EQ(box.min, Vec3(0, 0, 0.1));
  EXPECT_EQ(box.max, Vec3(1, 2, 3));
  const PlaceMessage painted = read(R"("painted","centers":[1,2,3,4,5,6],"radius":0.01})");
  EXPECT_EQ(painted.centers, (std::vector<Vec3>{{1, 2, 3}, {4, 5, 6}}));
  EXPECT_EQ(painted.radius, 0.01);
  std::string many = "0";
  for (int i = 1; i < 363; ++i) many += ",0";
  for (const std::string& bad :
       {std::string(R"("all"})"), std::string(R"("box"})"), std::string(R"("box","min":[0,0,1],"max":[0,0,0]})"),
        std::string(R"("box","min":[0,0,"a"],"max":[0,0,0]})"), std::string(R"("painted","centers":[],"radius":0.01})"),
        std::string(R"("painted","centers":[1,2],"radius":0.01})"),
        std::string(R"("painted","centers":[1,2,1e300],"radius":0.01})"),
        std::string(R"("painted","centers":[[1,2,3]],"radius":0.01})"),
        std::string(R"("painted","centers":[1,2,3],"radius":0})"), std::string(R"("painted","centers":[1,2,3]})"),
        R"("painted","centers":[)" + many + R"(],"radius":0.01})", std::string(R"("top","file":"/etc/passwd"})")})
    EXPECT_THROW(read(bad), InputError) << bad;
  for (const char* bad : {R"({"type":"place"})", R"({"type":"place","size":0.2,"rotation":[1,0,0,0],"tetrahedra":50})",
                          R"({"type":"place","size":0,"rotation":[1,0,0,0],"tetrahedra":50,"handle":"top"})",
                          R"({"type":"place","size":1e3,"rotation":[1,0,0,0],"tetrahedra":50,"handle":"top"})",
                          R"({"type":"place","size":0.1,"rotation":[0,0,0,0],"tetrahedra":50,"handle":"top"})",
                          R"({"type":"place","size":0.1,"rotation":[1,0,0,0],"tetrahedra":1e9,"handle":"top"})",
                          R"({"type":"place","size":0.1,"rotation":[1,0,0,0],"tetrahedra":50.5,"handle":"top"})"})
    EXPECT_THROW(parseCommand(bad), InputError) << bad;
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
