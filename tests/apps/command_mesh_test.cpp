#include "command_mesh.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>

#include "palpate/common/error.h"
#include "palpate/mesh/tetrahedral_io.h"

namespace palpate {
namespace {

std::string scratch(const std::string& name) {
  const auto folder =
      std::filesystem::path(testing::TempDir()) / ("palpate_command_mesh_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  return (folder / name).string();
}

TEST(MeshCommand, MakeInfoAndEmbedOneAfterTheOther) {
  const std::string ball = scratch("made.ply");
  EXPECT_EQ(runMeshMake({"sphere", ball, 0.1, {1, 1, 1}}).triangles, 8192);
  const InfoSummary info = runMeshInfo(ball);
  EXPECT_TRUE(info.repair.topology.closed());
  EXPECT_NE(formatReport(info).find("Euler characteristic 2"), std::string::npos);
  const std::string out = scratch("made.vtk");
  const EmbedSummary embedded = runMeshEmbed({ball, 100, 0.05, out});
  EXPECT_NEAR(embedded.embed.tetrahedra, 100, 20);
  EXPECT_EQ(readTetrahedra(out).tetrahedra.size(), static_cast<size_t>(embedded.embed.tetrahedra));
  EXPECT_NE(formatReport(embedded).find("worst element"), std::string::npos);
  EXPECT_EQ(runMeshMake({"bar", scratch("bar2.vtk"), 0, {4, 3, 4}}).tetrahedra, 288);
  EXPECT_THROW(runMeshMake({"teapot", scratch("teapot.obj"), 0, {1, 1, 1}}), InputError);
  EXPECT_THROW(runMeshEmbed({ball, 100, 0, "mesh.txt"}), InputError);
  EXPECT_THROW(runMeshEmbed({ball, -1, 0, ""}), InputError);
}

}  // namespace
}  // namespace palpate
