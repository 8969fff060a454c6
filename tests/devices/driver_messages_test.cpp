#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "palpate/devices/inverse3_messages.h"
#include "palpate/devices/spacenav_driver.h"

namespace palpate {
namespace {

// As a service of version 3.4.8 was seen to write it.
const std::string kRecord =
    R"({"inverse3":[{"device_id":"04EA","state":{"angular_position":{"a0":-30.93,"a1":53.88,"a2":-6.64},"angular_velocity":{"a0":0},)"
    R"("body_orientation":{"w":0.699,"x":0.0015,"y":0.715,"z":0.0024},"control_domain":"undefined","control_mode":"idle",)"
    R"("current_cursor_force":{"x":0,"y":0,"z":0.1},"cursor_position":{"x":0.1043,"y":-0.0365,"z":-0.0610},)"
    R"("cursor_velocity":{"x":0,"y":0,"z":-1},"mode":"idle","transform":{}},"status":{"calibrated":true}}],)"
    R"("wireless_verse_grip":[{"state":{"orientation":{"w":0,"x":1,"y":0,"z":0},"buttons":{"a":true,"b":false,"c":true}}}]})";

TEST(Inverse3Messages, ReadsARecordWhateverItLeavesOut) {
  Inverse3State state;
  ASSERT_EQ(readInverse3State(kRecord, "04EA", state), Inverse3Answer::state);
  EXPECT_EQ(state.id, "04EA");
  EXPECT_LT((state.position - Vec3(0.1043, -0.0365, -0.0610)).norm(), 1e-12);
  EXPECT_EQ(state.velocity.z(), -1.0);
  EXPECT_EQ(state.force.z(), 0.1);
  EXPECT_EQ(state.buttons, 5u);
  EXPECT_EQ(state.rotation.x(), 1.0);
  EXPECT_TRUE(state.calibrated && state.powered && !state.in_use);
  // what a message leaves out stays as it was
  ASSERT_EQ(
      readInverse3State(R"({"inverse3":[{"device_id":"04EA","state":{"cursor_position":{"y":1}}}]})", "04EA", state),
      Inverse3Answer::state);
  EXPECT_LT((state.position - Vec3(0.1043, 1, -0.0610)).norm(), 1e-12);
}

TEST(Inverse3Messages, TellsWhoIsThere) {
  Inverse3State state;
  EXPECT_EQ(readInverse3State(kRecord, "049D", state), Inverse3Answer::other);
  EXPECT_EQ(readInverse3State(kRecord, "", state), Inverse3Answer::state);
  EXPECT_EQ(readInverse3State(R"({"inverse3":[]})", "", state), Inverse3Answer::nobody);
  EXPECT_EQ(readInverse3State(R"({"verse_grip":[]})", "", state), Inverse3Answer::nobody);
  EXPECT_EQ(readInverse3State(R"({"inverse3":[{"device_id":"04EA","state":{}}]})", "", state), Inverse3Answer::garbage);
}

// Every cut, and every byte changed to another: read or refused, and nothing that is no number comes out.
TEST(Inverse3Messages, NoMessageDoesHarm) {
  for (std::size_t at = 0; at < kRecord.size(); ++at) {
    Inverse3State state;
    EXPECT_EQ(readInverse3State(kRecord.substr(0, at), "04EA", state), Inverse3Answer::garbage);
    for (const char other : {'"', '{', '9', 'e', '\0', '\xff'}) {
      std::string changed = kRecord;
      changed[at] = other;
      readInverse3State(changed, "", state);
      readInverse3Inventory(changed);
      readInverse3Event(changed);
      EXPECT_NEAR(state.rotation.norm(), 1.0, 1e-9);
    }
  }
  Inverse3State state;
  for (const char* odd : {"", "null", "[]", "1", "{\"inverse3\":[1,null,[]]}", "{\"inverse3\":[{\"device_id\":{}}]}",
                          "{\"inverse3\":[{\"state\":{\"cursor_position\":{\"x\":NaN}}}]}"}) {
    EXPECT_NE(readInverse3State(odd, "", state), Inverse3Answer::state) << odd;
  }
}

TEST(Inverse3Messages, TellsTheInventoryAndOlderFormats) {
  const auto inventory = readInverse3Inventory(
      R"({"session_id":7,"inverse3":[{"device_id":"049D","config":{"type":"minverse","gravity_compensation":{"enabled":true,"scaling_factor":1}},)"
      R"("status":{"calibrated":false,"in_use":true}}],"custom_verse_grip":[{}]})");
  ASSERT_TRUE(inventory);
  ASSERT_EQ(inventory->devices.size(), 1u);
  EXPECT_EQ(inventory->devices[0].type, "minverse");
  EXPECT_TRUE(inventory->devices[0].in_use && !inventory->devices[0].calibrated && inventory->devices[0].powered);
  EXPECT_EQ(inventory->grip, "custom_verse_grip");
  EXPECT_TRUE(readInverse3Inventory(R"({"session_id":7})"));
  EXPECT_FALSE(readInverse3Inventory(R"({"devices":[]})"));
}

TEST(Inverse3Messages, SpellsAForceAsTheServiceWantsIt) {
  EXPECT_EQ(inverse3Force("049D", Vec3(0, 0, 1.5), ForceSpelling::vector),
            R"({"inverse3":[{"device_id":"049D","commands":{"set_cursor_force":{"vector":{"x":0,"y":0,"z":1.5}}}}]})");
  EXPECT_NE(inverse3Force("049D", Vec3(1e-9, 0, 0), ForceSpelling::values).find("\"values\":{\"x\":1e-09"),
            std::string::npos);
  EXPECT_EQ(jsonText("a\"\\b"), R"("a\"\\b")");
  EXPECT_EQ(readServiceVersion(R"({"ok":true,"data":{"project_version":"3.5.0"}})"), "3.5.0");
  EXPECT_EQ(readServiceVersion(R"({"project_version":"3.4.8"})"), "3.4.8");
  EXPECT_EQ(readServiceVersion("<html>"), "");
  for (const char* old : {"", "3.4.8", "3.1", "2.9", "x"}) EXPECT_EQ(spellingOf(old), ForceSpelling::values) << old;
  for (const char* recent : {"3.5.0", "3.5", "3.10.1", "4.0"})
    EXPECT_EQ(spellingOf(recent), ForceSpelling::vector) << recent;
}

TEST(Inverse3Messages, ReadsEvents) {
  const auto event = readInverse3Event(
      R"({"name":"device-safety-triggered","level":"error","data":{"device_id":"049D","safety_type":"ebrake_triggered"}})");
  ASSERT_TRUE(event);
  EXPECT_EQ(event->safety, "ebrake_triggered");
  EXPECT_EQ(event->device, "049D");
}

TEST(Spacenav, IsRightHandedInOurAxes) {
  // right, up, away; about right, up, away
  const Vec6 moved = spacenavDeflection({0, 500, 250, -500, 100, 200, 300, 16}, 2);
  EXPECT_LT((moved - (Vec6() << 1, -1, 0.5, 0.2, 0.6, 0.4).finished()).norm(), 1e-12);
  EXPECT_EQ(spacenavDeflection({0, 2, -2, 1, 0, 0, 0, 16}, 2).norm(), 0.0);
  EXPECT_EQ(spacenavDeflection({0, 2000000000, 0, 0, 0, 0, 0, 16}, 2)[0], 1.0);
}

}  // namespace
}  // namespace palpate
