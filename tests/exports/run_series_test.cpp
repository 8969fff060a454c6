#include "palpate/exports/run_series.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>

#include "palpate/common/error.h"
#include "recording_bytes.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using namespace test;

const std::vector<float>& valuesOf(const std::vector<VtuArray>& arrays, const std::string& name) {
  static const std::vector<float> none;
  for (const VtuArray& a : arrays) {
    if (a.name == name) return std::get<std::vector<float>>(a.values);
  }
  ADD_FAILURE() << "no " << name;
  return none;
}

// Stretched along x by 10 %: sigma = lambda tr(e) 1 + 2 mu e.
TEST(RunSeries, MeshHasDisplacementAndStress) {
  RecordedRun run = runOf(recordingBytes());
  const RecordedFrame frame = run.frame(1);
  const VtuGrid grid = meshGrid(run, {0, 1}, &frame);
  EXPECT_EQ(grid.corners, (std::vector<std::int32_t>{0, 1, 2, 3}));  // the rigid one has none
  EXPECT_EQ(grid.time, 1.0);
  const auto& moved = valuesOf(grid.point_data, "displacement");
  ASSERT_EQ(moved.size(), 12U);
  EXPECT_NEAR(moved[3], 0.1, 1e-6);
  EXPECT_EQ(moved[6], 0);
  const auto& stress = valuesOf(grid.cell_data, "stress");
  ASSERT_EQ(stress.size(), 6U);
  EXPECT_NEAR(stress[0], 0.1 * (kLambda + 2 * kMu), 0.01);
  EXPECT_NEAR(stress[1], 0.1 * kLambda, 0.01);
  EXPECT_NEAR(stress[2], 0.1 * kLambda, 0.01);
  for (const std::size_t k : {3, 4, 5}) EXPECT_NEAR(stress[k], 0, 0.01);
  EXPECT_NEAR(valuesOf(grid.cell_data, "von_mises")[0], 0.2 * kMu, 0.01);
  EXPECT_EQ(valuesOf(grid.point_data, "von_mises"), (std::vector<float>{10, 20, 30, 40}));
  EXPECT_EQ(valuesOf(grid.point_data, "contact_force")[11], 3);
  // twice as stiff by then
  const RecordedFrame last = run.frame(2);
  EXPECT_NEAR(valuesOf(meshGrid(run, {0}, &last).cell_data, "stress")[0], 2 * 0.2 * (kLambda + 2 * kMu), 0.05);
}

// Turned by 90 degrees about z as well: the stress turns along, and nothing else changes.
TEST(RunSeries, StressTurnsWithTheBody) {
  RecordedRun run = runOf(recordingBytes());
  RecordedFrame frame = run.frame(1);
  for (std::size_t i = 0; i < frame.nodes.size(); i += 3) {
    const float x = frame.nodes[i], y = frame.nodes[i + 1];
    frame.nodes[i] = -y;
    frame.nodes[i + 1] = x;
  }
  const VtuGrid grid = meshGrid(run, {0}, &frame);
  const auto& stress = valuesOf(grid.cell_data, "stress");
  EXPECT_NEAR(stress[1], 0.1 * (kLambda + 2 * kMu), 0.01);
  EXPECT_NEAR(stress[0], 0.1 * kLambda, 0.01);
  EXPECT_NEAR(valuesOf(grid.cell_data, "von_mises")[0], 0.2 * kMu, 0.01);
}

TEST(RunSeries, AsBuiltThereIsNoFrame) {
  const RecordedRun run = runOf(recordingBytes());
  const VtuGrid grid = meshGrid(run, {0}, nullptr);
  EXPECT_FALSE(grid.time);
  for (const float v : valuesOf(grid.point_data, "displacement")) EXPECT_EQ(v, 0);
  const Surface surface = surfaceAt(run, {1}, nullptr);
  ASSERT_EQ(surface.vertices.size(), 3U);
  EXPECT_LT((surface.vertices[2] - Vec3(0, 0.5, 0.5)).norm(), 1e-6);
}

TEST(RunSeries, SurfacesOfSeveralBodiesAreOne) {
  RecordedRun run = runOf(recordingBytes());
  const RecordedFrame frame = run.frame(2);
  const Surface surface = surfaceAt(run, {0, 1}, &frame);
  ASSERT_EQ(surface.vertices.size(), 6U);
  EXPECT_LT((surface.vertices[1] - Vec3(1.2, 0, 0)).norm(), 1e-6);
  EXPECT_LT((surface.vertices[3] - Vec3(5, 5, 5)).norm(), 1e-6);
  EXPECT_EQ(surface.triangles[1], (std::array<int, 3>{3, 4, 5}));
}

class SeriesFiles : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("palpate-series-" + std::to_string(::getpid()));
    fs::remove_all(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::set<std::string> files() const {
    std::set<std::string> out;
    for (const auto& entry : fs::directory_iterator(folder_)) out.insert(entry.path().filename().string());
    return out;
  }
  std::string text(const std::string& name) const {
    std::ifstream in(folder_ / name, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  fs::path folder_;
};

TEST_F(SeriesFiles, AreThoseAskedFor) {
  RecordedRun run = runOf(recordingBytes());
  SeriesOptions options;
  options.contacts = false;
  options.every = 2;
  double share = 0;
  EXPECT_EQ(writeSeries(run, options, folder_, [&](double s) { share = s; }), 2U);
  EXPECT_GT(share, 0.5);
  EXPECT_EQ(files(), (std::set<std::string>{"mesh-0-soft_one-00000.vtu", "mesh-0-soft_one-00001.vtu", "mesh.pvd",
                                            "surface-0-soft_one-00000.vtu", "surface-0-soft_one-00001.vtu",
                                            "surface-1-stone-00000.vtu", "surface-1-stone-00001.vtu", "surface.pvd"}));
  const std::string pvd = text("mesh.pvd");
  EXPECT_NE(pvd.find("timestep=\"0.5\""), std::string::npos) << pvd;
  EXPECT_NE(pvd.find("timestep=\"2\""), std::string::npos) << pvd;
  EXPECT_EQ(pvd.find("timestep=\"1\""), std::string::npos) << pvd;
  EXPECT_NE(text("surface-1-stone-00000.vtu").find("VTKFile"), std::string::npos);
}

TEST_F(SeriesFiles, HaveOneBodyAndASpanOfTime) {
  RecordedRun run = runOf(recordingBytes());
  SeriesOptions options;
  options.from = 0.6;
  options.to = 1.5;
  options.bodies = {1};
  EXPECT_EQ(writeSeries(run, options, folder_), 1U);
  EXPECT_EQ(files(), (std::set<std::string>{"contacts-00000.vtu", "contacts.pvd", "surface-1-stone-00000.vtu",
                                            "surface.pvd"}));  // a rigid body has no mesh
}

TEST_F(SeriesFiles, AllOrNone) {
  RecordedRun run = runOf(recordingBytes());
  SeriesOptions options;
  options.from = 3;
  EXPECT_THROW((void)writeSeries(run, options, folder_), InputError);
  EXPECT_FALSE(fs::exists(folder_ / "mesh.pvd"));
  std::string damaged = recordingBytes();
  damaged.resize(damaged.size() - 8);  // within the last extra record: it is left out
  RecordedRun shorter = runOf(damaged);
  EXPECT_FALSE(shorter.complaint().empty());
  EXPECT_EQ(writeSeries(shorter, {}, folder_), 3U);
}

}  // namespace
}  // namespace palpate
