#include "palpate/protocol/server_messages.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

TEST(ServerMessages, ReadsAcknowledgments) {
  EXPECT_EQ(acknowledgedStep(R"({"type":"ack","frame":7})"), 7u);
  EXPECT_EQ(acknowledgedStep(R"( { "frame" : 4294967295, "type" : "ack" } )"), 4294967295u);
  for (const char* text :
       {"", "{}", "\"ack\"", R"(["ack"])", R"({"type":"ack"})", R"({"type":"ack","frame":-1})",
        R"({"type":"ack","frame":4294967296})", R"({"type":"ack","frame":1.5})", R"({"type":"ack","frame":"1"})",
        R"({"type":"hand","frame":1,"x":"ack"})", R"({"type":"ack","frame":1)", R"({"type":["ack"],"frame":1})"})
    EXPECT_FALSE(acknowledgedStep(text)) << text;
}

}  // namespace
}  // namespace palpate
