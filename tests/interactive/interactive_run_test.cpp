#include "palpate/interactive/interactive_run.h"

#include <gtest/gtest.h>

#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "palpate/interactive/surface_scene.h"
#include "palpate/mesh/surface_measures.h"
#include "palpate/scene/reader.h"
#include "shared/soft_cube.h"

namespace palpate {
namespace {

using test::softCube;
using Json = nlohmann::json;

/// Keeps the newest of everything, and counts.
class Listener final : public Audience {
 public:
  void greet(std::vector<Message> messages) override {
    const std::lock_guard lock(mutex_);
    scene_ = Json::parse(*messages.at(0).bytes);
    EXPECT_FALSE(messages.at(0).binary);
    EXPECT_TRUE(messages.at(1).binary);
    ++greetings;
    changed_.notify_all();
  }
  void state(Bytes json) override {
    const std::lock_guard lock(mutex_);
    state_ = Json::parse(*json);
    changed_.notify_all();
  }
  void text(Bytes json) override {
    const std::lock_guard lock(mutex_);
    const Json j = Json::parse(*json);
    (j["type"] == "notice" ? notices_ : j["type"] == "saved" ? saved_ : stats_).push_back(j);
    changed_.notify_all();
  }
  void textTo(int, Bytes json) override { text(std::move(json)); }
  void frame(std::uint32_t step, Bytes full, Bytes) override {
    const std::lock_guard lock(mutex_);
    step_ = step;
    std::memcpy(&hand_sequence_, full->data() + 12, 4);
    float p[3];
    std::memcpy(p, full->data() + 24, sizeof p);
    device_ = Vec3(p[0], p[1], p[2]);
    changed_.notify_all();
  }
  void samples(Bytes, std::uint32_t ticks) override {
    const std::lock_guard lock(mutex_);
    ticks_ += ticks;
    changed_.notify_all();
  }
  double cpuSeconds() const override { return 0; }

  /// Waits for something to become true.
  template <typename Condition>
  bool wait(Condition condition) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(120), [&] { return condition(*this); });
  }

  /// A copy of something, as it is now.
  template <typename Value>
  Value now(Value Listener::*member) {
    const std::lock_guard lock(mutex_);
    return this->*member;
  }

  Json scene_, state_;
  std::vector<Json> notices_, stats_, saved_;
  std::uint32_t step_ = 0, hand_sequence_ = 0;
  std::uint64_t ticks_ = 0;
  int greetings = 0;
  Vec3 device_ = Vec3::Zero();

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
};

/// Rows of a table below its header.
int rowsOf(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string line;
  int rows = -1;
  while (std::getline(in, line)) ++rows;
  return rows;
}

class InteractiveRunTest : public testing::Test {
 protected:
  InteractiveRunTest()
      : folder_(std::filesystem::path(testing::TempDir()) / ("interactive-" + std::to_string(::getpid()))) {
    options_.scenes = {{"cube", "", "cube.yaml"}};
    options_.open = [](const SceneEntry&) { return softCube(); };
    options_.record_folder = folder_ / "recorded";
    options_.surface_folder = folder_ / "surfaces";
  }
  ~InteractiveRunTest() override {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }

  std::filesystem::path folder_;
  InteractiveOptions options_;
  Listener listener_;
};

TEST_F(InteractiveRunTest, RunsPausesAndSteps) {
  InteractiveRun run(softCube(), options_, listener_);
  run.start();
  run.joined(1);
  EXPECT_TRUE(listener_.wait([](Listener& l) { return l.ticks_ > 100 && l.step_ > 4 && !l.stats_.empty(); }));
  run.message(1, R"({"type":"pause"})");
  ASSERT_TRUE(listener_.wait([](Listener& l) { return l.state_["paused"] == true; }));
  const auto step = listener_.now(&Listener::step_);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(listener_.now(&Listener::step_), step);
  run.message(1, R"({"type":"step"})");
  EXPECT_TRUE(listener_.wait([step](Listener& l) { return l.step_ == step + 1; }));
  run.message(1, R"({"type":"resume"})");
  EXPECT_TRUE(listener_.wait([step](Listener& l) { return l.step_ > step + 3; }));
}

TEST_F(InteractiveRunTest, OneViewerHoldsTheHand) {
  InteractiveRun run(softCube(), options_, listener_);
  run.start();
  run.joined(1);
  run.joined(2);
  run.message(1, R"({"type":"take"})");
  ASSERT_TRUE(listener_.wait([](Listener& l) { return l.state_["hand"] == 1 && l.state_["driver"] == "hand"; }));
  run.message(2, R"({"type":"take"})");
  ASSERT_TRUE(listener_.wait([](Listener& l) { return !l.notices_.empty(); }));
  const Json start = listener_.now(&Listener::scene_)["start"]["position"];
  const Vec3 goal(start[0].get<double>() + 0.02, start[1].get<double>(), start[2].get<double>() + 0.01);
  const auto move = [&](int viewer, int sequence, const Vec3& p) {
    run.message(
        viewer,
        Json{{"type", "hand"}, {"seq", sequence}, {"position", {p.x(), p.y(), p.z()}}, {"rotation", {1, 0, 0, 0}}}
            .dump());
  };
  move(2, 99, Vec3(1, 1, 1));
  move(1, 5, goal);
  EXPECT_TRUE(listener_.wait([&](Listener& l) { return (l.device_ - goal).norm() < 0.004; }));
  EXPECT_EQ(listener_.now(&Listener::hand_sequence_), 5u);
  run.left(1);
  EXPECT_TRUE(listener_.wait([](Listener& l) { return l.state_["hand"].is_null() && l.state_["viewers"] == 1; }));
  run.message(2, R"({"type":"play"})");
  EXPECT_TRUE(listener_.wait([](Listener& l) { return l.state_["driver"] == "path"; }));
}

TEST_F(InteractiveRunTest, ChangesWhatItIsAskedTo) {
  InteractiveRun run(softCube(), options_, listener_);
  run.start();
  run.message(1, R"({"type":"set","method":"vc","visual_step":0.0101,"friction":2,"stiffness":3,"speed":0.5})");
  EXPECT_TRUE(listener_.wait([](Listener& l) {
    return l.state_["method"] == "vc" && std::abs(l.state_["visual_step"].get<double>() - 0.01) < 1e-12 &&
           l.state_["friction"] == 2.0 && l.state_["stiffness"] == 3.0 && l.state_["speed"] == 0.5;
  }));
  EXPECT_EQ(listener_.now(&Listener::greetings), 1);  // all of that goes on with the same bodies
  run.message(1, R"({"type":"set","handle":"side"})");
  EXPECT_TRUE(listener_.wait([](Listener& l) { return l.greetings == 2 && l.state_["handle"] == "side"; }));
  EXPECT_EQ(listener_.now(&Listener::state_)["method"], "vc");
  run.message(1, R"({"type":"reset"})");
  EXPECT_TRUE(listener_.wait([](Listener& l) { return l.greetings == 3; }));
  EXPECT_TRUE(listener_.now(&Listener::notices_).empty());
  for (const char* bad : {R"({"type":"set","method":"magic"})", R"({"type":"set","handle":"tail"})",
                          R"({"type":"scene","name":"none"})", "nonsense"}) {
    const auto before = listener_.now(&Listener::notices_).size();
    run.message(1, bad);
    EXPECT_TRUE(listener_.wait([&](Listener& l) { return l.notices_.size() == before + 1; })) << bad;
    EXPECT_EQ(listener_.now(&Listener::notices_).back()["level"], "error");
  }
  const auto step = listener_.now(&Listener::step_);
  EXPECT_TRUE(listener_.wait([step](Listener& l) { return l.step_ > step + 2; }));
}

// Of many equal wishes for a new scene the last one counts, and the end waits for none of them.
TEST_F(InteractiveRunTest, AFloodOfResets) {
  InteractiveRun run(softCube(), options_, listener_);
  run.start();
  for (int i = 0; i < 400; ++i) run.message(1, R"({"type":"reset"})");
  run.message(2, R"({"type":"set","friction":4})");
  EXPECT_TRUE(listener_.wait([](Listener& l) { return l.state_["friction"] == 4.0; }));
  EXPECT_LT(listener_.now(&Listener::greetings), 100);
  for (int i = 0; i < 200; ++i) {
    run.message(1, R"({"type":"reset"})");
    run.message(1, R"({"type":"scene","name":"cube"})");
    run.message(1, R"({"type":"set","handle":"side"})");
    run.message(1, R"({"type":"set","handle":"top"})");
  }
  EXPECT_TRUE(listener_.wait([](Listener& l) { return !l.notices_.empty(); }));  // too many
  const auto begin = std::chrono::steady_clock::now();
  run.stop();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(5));
  EXPECT_EQ(run.failure(), "");
}

TEST_F(InteractiveRunTest, RecordsARunThatCanBeShownAgain) {
  InteractiveRun run(softCube(), options_, listener_);
  run.start();
  run.message(1, R"({"type":"record","on":true})");
  ASSERT_TRUE(listener_.wait([](Listener& l) { return l.state_["recording"].is_string(); }));
  const std::filesystem::path folder = listener_.now(&Listener::state_)["recording"].get<std::string>();
  const auto step = listener_.now(&Listener::step_);
  ASSERT_TRUE(listener_.wait([step](Listener& l) { return l.step_ > step + 10; }));
  run.message(1, R"({"type":"record","on":false})");
  ASSERT_TRUE(listener_.wait([](Listener& l) { return l.state_["recording"].is_null() && !l.notices_.empty(); }));
  for (const char* name : {"haptic.csv", "visual.csv", "motion.csv", "summary.json", "report.html"}) {
    EXPECT_TRUE(std::filesystem::exists(folder / name)) << name;
  }
  std::ifstream in(folder / "recording.palpate", std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), {});
  ASSERT_EQ(bytes.substr(0, 8), "PALPATE1");
  int frames = 0, ticks = 0;
  std::size_t at = 8;
  for (int record = 0; at < bytes.size(); ++record) {
    std::uint32_t head[2];
    ASSERT_LE(at + 8, bytes.size());
    std::memcpy(head, bytes.data() + at, 8);
    ASSERT_LE(at + 8 + head[1], bytes.size());
    const std::string payload = bytes.substr(at + 8, head[1]);
    if (record == 0) {
      EXPECT_EQ(Json::parse(payload)["type"], "scene");
    }
    if (record == 2) {
      EXPECT_EQ(Json::parse(payload)["type"], "state");
    }
    if (head[0] == 1) {
      std::uint32_t kind, count;
      std::memcpy(&kind, payload.data(), 4);
      std::memcpy(&count, payload.data() + 8, 4);
      if (kind == 2) ++frames;
      if (kind == 3) ticks += static_cast<int>(count);
    }
    at += 8 + (head[1] + 7) / 8 * 8;
  }
  EXPECT_EQ(at, bytes.size());
  // every step and every tick that the loops had time for, in the recording as in the tables
  EXPECT_GE(frames, 10);
  EXPECT_EQ(frames, rowsOf(folder / "visual.csv"));
  EXPECT_GT(ticks, 0);
  EXPECT_EQ(ticks, rowsOf(folder / "haptic.csv"));
}

/// 2 by 1 by 1.
std::string block() {
  return "OFF\n8 6 0\n0 0 0\n2 0 0\n2 1 0\n0 1 0\n0 0 1\n2 0 1\n2 1 1\n0 1 1\n"
         "4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";
}

TEST_F(InteractiveRunTest, HoldsASurfaceThatIsDropped) {
  InteractiveRun run(softCube(), options_, listener_);
  run.start();
  EXPECT_FALSE(run.surface("block.off", block()));
  EXPECT_TRUE(listener_.wait([](Listener& l) { return l.greetings == 2 && l.scene_["name"] == "block"; }));
  const auto step = listener_.now(&Listener::step_);
  EXPECT_FALSE(run.surface("bad.obj", "v 0 0\n"));
  EXPECT_TRUE(listener_.wait([](Listener& l) { return !l.notices_.empty() && l.notices_.back()["level"] == "error"; }));
  const std::string text = listener_.now(&Listener::notices_).back()["text"];
  EXPECT_NE(text.find("bad.obj"), std::string::npos) << text;
  EXPECT_EQ(text.find(folder_.string()), std::string::npos) << text;
  EXPECT_TRUE(listener_.wait([step](Listener& l) { return l.step_ > step + 3; }));  // the block goes on
}

TEST_F(InteractiveRunTest, PlacesASurfaceBeforeItRuns) {
  InteractiveRun run(softCube(), options_, listener_);
  run.start();
  const auto refused = [&](const std::string& message, const std::string& words) {
    const auto before = listener_.now(&Listener::notices_).size();
    run.message(1, message);
    ASSERT_TRUE(listener_.wait([&](Listener& l) { return l.notices_.size() > before; })) << message;
    const Json last = listener_.now(&Listener::notices_).back();
    EXPECT_EQ(last["level"], "error") << message;
    EXPECT_NE(last["text"].get<std::string>().find(words), std::string::npos) << last;
    EXPECT_EQ(last["text"].get<std::string>().find(folder_.string()), std::string::npos) << last;
  };
  const std::string placement = R"({"type":"place","size":0.1,"rotation":[0.5,0.5,0.5,0.5],"tetrahedra":200,"handle":)";
  refused(placement + R"("top"})", "no surface waits");
  refused(R"({"type":"cancel"})", "no surface waits");
  EXPECT_FALSE(run.surface("my block!.off", block(), true));
  ASSERT_TRUE(listener_.wait([](Listener& l) { return l.greetings == 2 && l.state_["placing"].is_object(); }));
  const Json placing = listener_.now(&Listener::state_)["placing"];
  EXPECT_EQ(placing["name"], "my block!.off");
  EXPECT_EQ(placing["extent"], Json({2.0, 1.0, 1.0}));
  EXPECT_EQ(placing["size"], 0.15);
  for (const char* early : {"pause", "resume", "step", "reset", "take", "play", "save"})
    refused(std::string(R"({"type":")") + early + "\"}", "waits to be placed");
  refused(R"({"type":"set","method":"vc"})", "waits to be placed");
  refused(R"({"type":"record","on":true})", "waits to be placed");
  refused(placement + R"("painted","centers":[9,9,9],"radius":0.01})", "larger box or brush");  // it still waits
  refused(R"({"type":"place","size":0.1})", "rotation");
  const auto ticks = listener_.now(&Listener::ticks_);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(listener_.now(&Listener::ticks_), ticks);
  run.message(1, R"({"type":"cancel"})");
  ASSERT_TRUE(
      listener_.wait([](Listener& l) { return l.state_["placing"].is_null() && l.scene_["name"] != "my-block-"; }));
  EXPECT_TRUE(listener_.wait([&](Listener& l) { return l.ticks_ > ticks + 20; }));

  EXPECT_FALSE(run.surface("my block!.off", block(), true));
  ASSERT_TRUE(listener_.wait([](Listener& l) { return l.state_["placing"].is_object(); }));
  const auto notices = listener_.now(&Listener::notices_).size();
  run.message(1, placement + R"("box","min":[-1,-1,0.025],"max":[1,1,1]})");
  ASSERT_TRUE(
      listener_.wait([](Listener& l) { return l.state_["placing"].is_null() && l.scene_["name"] == "my-block-"; }));
  ASSERT_TRUE(listener_.wait([&](Listener& l) { return l.notices_.size() > notices; }));
  const std::string said = listener_.now(&Listener::notices_)[notices]["text"];
  EXPECT_NE(said.find("tetrahedra, "), std::string::npos) << said;
  EXPECT_NE(said.find("50 x 100 x 50 mm"), std::string::npos) << said;  // x has become y, y z and z x
  const auto after = listener_.now(&Listener::ticks_);
  EXPECT_TRUE(listener_.wait([&](Listener& l) { return l.ticks_ > after + 20; }));
  // nobody holds a block of 5 m
  EXPECT_FALSE(run.surface("large.off", block(), true));
  ASSERT_TRUE(listener_.wait([](Listener& l) { return l.state_["placing"].is_object(); }));
  run.message(1, R"({"type":"place","size":5,"rotation":[1,0,0,0],"tetrahedra":100,"handle":"top"})");
  EXPECT_TRUE(listener_.wait(
      [](Listener& l) { return l.notices_.back()["text"].get<std::string>().starts_with("it weighs "); }));
}

TEST_F(InteractiveRunTest, SavesASceneThatIsTheSame) {
  InteractiveRun run(softCube(), options_, listener_);
  run.start();
  run.message(1, R"({"type":"set","stiffness":2})");
  run.message(1, R"({"type":"save"})");
  ASSERT_TRUE(listener_.wait([](Listener& l) { return l.saved_.size() == 1; }));
  const std::string cube = listener_.now(&Listener::saved_).back()["text"];
  EXPECT_EQ(readSceneFromString(cube, "cube.yaml").tool.material.youngs_modulus, 4e4);
  run.message(1, R"({"type":"set","stiffness":1})");
  EXPECT_FALSE(run.surface("block.off", block(), true));
  ASSERT_TRUE(listener_.wait([](Listener& l) { return l.state_["placing"].is_object(); }));
  run.message(1, R"({"type":"place","size":0.1,"rotation":[0.8,0.6,0,0],"tetrahedra":200,"handle":"painted",)"
                 R"("centers":[0.05,0,0.05,0,0,0.05],"radius":0.03})");
  ASSERT_TRUE(listener_.wait([](Listener& l) { return l.state_["placing"].is_null() && l.scene_["name"] == "block"; }));
  run.message(1, R"({"type":"set","method":"hsl","visual_step":0.02,"friction":1.5})");
  run.message(1, R"({"type":"save"})");
  ASSERT_TRUE(listener_.wait([](Listener& l) { return l.saved_.size() == 2; }));
  const Json saved = listener_.now(&Listener::saved_).back();
  run.stop();
  EXPECT_EQ(saved["name"], "block.yaml");
  const std::string text = saved["text"];
  EXPECT_EQ(text.find(folder_.string()), std::string::npos) << text;

  const auto folder = folder_ / "mine";
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "block.off") << block();
  std::ofstream(folder / "block.yaml") << text;
  const SceneConfig again = readScene(folder / "block.yaml");
  EXPECT_EQ(again.method, MethodName::hsl);
  EXPECT_EQ(again.visual_step, 0.02);
  EXPECT_EQ(again.obstacles.at(0).friction, 0.75);
  PlaceMessage placement;
  placement.size = 0.1;
  placement.rotation = Quat(0.8, 0.6, 0, 0);
  placement.tetrahedra = 200;
  placement.handle = PlaceMessage::Handle::painted;
  placement.centers = {{0.05, 0, 0.05}, {0, 0, 0.05}};
  placement.radius = 0.03;
  const BuiltScene one = buildScene(sceneOfSurface(folder / "block.off", "block.off", placement));
  const BuiltScene two = buildScene(again);
  EXPECT_GT(two.world.tool().model.handle().nodes.size(), 3u);
  EXPECT_EQ(one.world.tool().model.handle().nodes, two.world.tool().model.handle().nodes);
  EXPECT_EQ(one.world.tool().model.totalMass(), two.world.tool().model.totalMass());
  EXPECT_EQ(one.start.position, two.start.position);
  EXPECT_EQ(one.start.rotation.coeffs(), two.start.rotation.coeffs());
  EXPECT_NEAR(boundsOf(two.world.tool().model.mesh().surface.vertices).low.z(), 0.0, 1e-9);
}

TEST_F(InteractiveRunTest, MotionComesToItsEndAndCanBeBegunAgain) {
  SceneConfig config = softCube();
  config.tool.chosenHandle().hand.keyframes = {{0.0, Vec3::Zero(), Vec3::Zero()},
                                               {0.2, Vec3(0, 0, 0.01), Vec3::Zero()}};
  InteractiveRun run(config, options_, listener_);
  run.start();
  EXPECT_TRUE(listener_.wait([](Listener& l) { return l.state_["motion"] == "over"; }));
  run.joined(2);  // too late to see it
  run.message(2, R"({"type":"play"})");
  EXPECT_TRUE(listener_.wait([](Listener& l) { return l.state_["motion"] == "playing"; }));
  EXPECT_TRUE(listener_.wait([](Listener& l) { return l.state_["motion"] == "over"; }));
  config.tool.chosenHandle().hand.keyframes.clear();
  InteractiveRun still(config, options_, listener_);
  still.start();
  EXPECT_TRUE(listener_.wait([](Listener& l) { return l.state_["motion"] == "none"; }));
}

}  // namespace
}  // namespace palpate
