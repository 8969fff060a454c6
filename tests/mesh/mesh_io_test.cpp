#include <gtest/gtest.h>

#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>

#include "palpate/common/error.h"
#include "palpate/mesh/mesh_quality.h"
#include "palpate/mesh/shapes.h"
#include "palpate/mesh/surface_io.h"
#include "palpate/mesh/surface_repair.h"
#include "palpate/mesh/tetrahedral_io.h"

namespace palpate {
namespace {

std::string scratch(const std::string& name) {
  const auto folder = std::filesystem::path(testing::TempDir()) / ("palpate_mesh_io_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  return (folder / name).string();
}

std::string complaint(std::string_view data, SurfaceFormat format) {
  try {
    readSurfaceFromMemory(data, format, "file");
  } catch (const InputError& e) {
    const std::string what = e.what();
    EXPECT_EQ(what.find('\n'), std::string::npos);
    return what;
  }
  return "accepted";
}

const std::string kCubeOff =
    "OFF\n# a cube of quads\n8 6 12\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n"
    "4 0 3 2 1\n4 4 5 6 7 255 0 0\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";

TEST(SurfaceIo, EveryFormatGivesBackWhatWasWritten) {
  const Surface s = sphereSurface(0.1, 3);
  for (const char* name : {"ball.obj", "ball.off", "ball.ply", "ball.STL"}) {
    const std::string path = scratch(name);
    writeSurface(path, s);
    const Surface back = repairSurface(readSurface(path)).surface;
    ASSERT_EQ(back.vertices.size(), s.vertices.size()) << name;
    ASSERT_EQ(back.triangles.size(), s.triangles.size()) << name;
    EXPECT_NEAR(measureSurface(back).volume, measureSurface(s).volume, 1e-9) << name;
    EXPECT_FALSE(std::filesystem::exists(path + ".part"));
    if (std::string(name) == "ball.STL") continue;
    EXPECT_EQ(back.triangles, s.triangles) << name;
    EXPECT_EQ(back.vertices, s.vertices) << name;
  }
}

TEST(SurfaceIo, ReadsPolygonsOfEveryFormat) {
  const Surface off = readSurfaceFromMemory(kCubeOff, SurfaceFormat::off);
  EXPECT_EQ(off.triangles.size(), 12u);
  EXPECT_NEAR(measureSurface(off).volume, 1, 1e-12);

  const Surface obj = readSurfaceFromMemory(
      "# comment\r\nmtllib x.mtl\r\nv 0 0 0\r\nv +1 0 0\r\nv 1 1 0\r\nv 0 1 0\r\nv 0.5 .5 1e0\r\nvn 0 0 1\r\n"
      "f 4//1 3//1 2//1 1//1\r\nf 1/1 2/2 5/3\r\nf 2/1/1 3/1/1 \\\r\n 5/1/1\r\nf -3 -2 -1\r\nf 4 1 5\r\n",
      SurfaceFormat::obj);
  EXPECT_EQ(obj.triangles.size(), 6u);
  EXPECT_NEAR(measureSurface(obj).volume, 1.0 / 3, 1e-12);

  const Surface ply = readSurfaceFromMemory(
      "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty float y\n"
      "property float z\nproperty uchar red\nelement face 4\nproperty list uchar int vertex_index\nelement edge 1\n"
      "property int a\nend_header\n0 0 0 9\n1 0 0 9\n0 1 0 9\n0 0 1 9\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n7\n",
      SurfaceFormat::ply);
  EXPECT_NEAR(measureSurface(ply).volume, 1.0 / 6, 1e-12);

  const Surface stl = readSurfaceFromMemory(
      "solid a\nfacet normal 0 0 -1\nouter loop\nvertex 0 0 0\nvertex 0 1 0\nvertex 1 0 0\nendloop\nendfacet\nendsolid "
      "a\n",
      SurfaceFormat::stl);
  EXPECT_EQ(stl.triangles.size(), 1u);
}

TEST(SurfaceIo, ReadsBigEndianPly) {
  std::string data =
      "ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar ushort vertex_indices\nend_header\n";
  const auto put = [&](float value) {
    char bytes[4];
    std::memcpy(bytes, &value, 4);
    for (int i = 3; i >= 0; --i) data += bytes[i];
  };
  for (float value : {0.f, 0.f, 0.f, 1.5f, 0.f, 0.f, 0.f, 2.f, 0.f}) put(value);
  data += '\3';
  for (int v : {0, 1, 2}) data += std::string("\0", 1) + static_cast<char>(v);
  const Surface s = readSurfaceFromMemory(data, SurfaceFormat::ply);
  EXPECT_EQ(s.vertices[1], Vec3(1.5, 0, 0));
  EXPECT_EQ(s.triangles[0], (std::array<int, 3>{0, 1, 2}));
  for (size_t cut = data.size() - 40; cut < data.size(); ++cut)
    EXPECT_NE(complaint(data.substr(0, cut), SurfaceFormat::ply).find("truncated"), std::string::npos);
}

TEST(SurfaceIo, RefusesBadFilesInOneLine) {
  using enum SurfaceFormat;
  EXPECT_EQ(complaint("", obj), "file: is empty");
  EXPECT_EQ(complaint("v 0 0 0\n", obj), "file: has no triangles");
  EXPECT_EQ(complaint("v 0 0\n", obj), "file: line 1: the line ends where z should follow");
  EXPECT_EQ(complaint("v 0 0 nan\n", obj), "file: line 1: z is not finite: 'nan'");
  EXPECT_EQ(complaint("v 0 1e999 0\n", obj), "file: line 1: y is not finite: '1e999'");
  EXPECT_EQ(complaint("v 0 x 0\n", obj), "file: line 1: y should be a number, not 'x'");
  EXPECT_NE(complaint("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", obj).find("out of range"), std::string::npos);
  EXPECT_NE(complaint("v 0 0 0\nf 1 1 -9\n", obj).find("out of range"), std::string::npos);
  EXPECT_NE(complaint("v 0 0 0\nf 1 0 1\n", obj).find("start at 1"), std::string::npos);
  EXPECT_NE(complaint("v 0 0 0\nf 1 1\n", obj).find("fewer than three"), std::string::npos);
  EXPECT_NE(complaint("v 0 0 0\nf 1 2 99999999999999999999\n", obj).find("whole number"), std::string::npos);
  EXPECT_NE(complaint("OFF\n2000000000 2000000000 0\n", off).find("ends where"), std::string::npos);
  EXPECT_NE(complaint(kCubeOff.substr(0, kCubeOff.size() - 12), off).find("ends"), std::string::npos);
  EXPECT_NE(complaint("solid x\nfacet\nvertex 0 0 0\n", stl).find("truncated"), std::string::npos);
  EXPECT_NE(complaint("solid x\nhello\n", stl).find("neither"), std::string::npos);
  std::string binary(84, '\0');
  binary[80] = 5;
  EXPECT_NE(complaint(binary, stl).find("promises 5 triangles"), std::string::npos);
  EXPECT_NE(complaint("solid" + binary.substr(5), stl).find("promises 5 triangles"), std::string::npos);
  EXPECT_NE(complaint("solid" + binary.substr(5, 60), stl).find("at least 84 bytes"), std::string::npos);
  EXPECT_NE(
      complaint("ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n", ply).find("ends"),
      std::string::npos);
  EXPECT_NE(complaint("ply\nelement vertex 1\n", ply).find("header"), std::string::npos);
}

TEST(SurfaceIo, StatesItsLimit) {
  // One polygon with more corners than triangles are allowed.
  std::string data = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2";
  for (int i = 0; i < kLargestSurface + 2; ++i) data += " 3";
  EXPECT_NE(complaint(data, SurfaceFormat::obj).find("more than 2000000 triangles"), std::string::npos);
}

TEST(SurfaceIo, FilesThatAreNotThere) {
  EXPECT_THROW(readSurface(scratch("missing.obj")), InputError);
  EXPECT_THROW(readSurface(scratch("thing.xyz")), InputError);
  EXPECT_THROW(writeSurface(scratch("no/such/folder/ball.obj"), sphereSurface(1, 1)), InputError);
  const std::string empty = scratch("empty.ply");
  std::ofstream(empty).close();
  EXPECT_THROW(readSurface(empty), InputError);
  std::filesystem::create_directories(scratch("folder.off"));
  EXPECT_THROW(readSurface(scratch("folder.off")), InputError);
}

TEST(LoadSolid, ScalesAndRefusesWhatIsNotSolid) {
  const std::string path = scratch("ball2.obj");
  writeSurface(path, sphereSurface(3, 2));
  const Bounds box = boundsOf(loadSolid(path, 0.12).vertices);
  EXPECT_NEAR((box.high - box.low).maxCoeff(), 0.12, 1e-12);
  EXPECT_THROW(loadSolid(path, -1), InputError);
  const std::string flat = scratch("flat.obj");
  std::ofstream(flat) << "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  EXPECT_THROW(loadSolid(flat), InputError);
}

TEST(TetrahedralIo, VtkGivesBackWhatWasWritten) {
  const SimulationMesh bar = barMesh(Vec3(0.3, 0.2, 0.1), {2, 2, 1});
  const std::string path = scratch("bar.vtk");
  writeSimulationMesh(path, bar);
  const TetrahedralMesh back = readTetrahedra(path);
  ASSERT_EQ(back.tetrahedra.size(), bar.mesh.tetrahedra.size());
  for (size_t t = 0; t < back.tetrahedra.size(); ++t)
    for (size_t k = 0; k < 4; ++k)
      EXPECT_EQ(back.nodes[static_cast<size_t>(back.tetrahedra[t][k])],
                bar.mesh.nodes[static_cast<size_t>(bar.mesh.tetrahedra[t][k])]);
}

TEST(TetrahedralIo, ReadsGmshAndTetGenAndTurnsInvertedOnes) {
  const TetrahedralMesh two = readGmsh(
      "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n9 5 5 5\n$EndNodes\n"
      "$Elements\n2\n1 2 2 0 0 1 2 3\n2 4 2 0 0 1 3 2 4\n$EndElements\n",
      "a.msh");
  const TetrahedralMesh four = readGmsh(
      "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
      "$EndNodes\n$Elements\n2 2 1 2\n2 1 2 1\n1 1 2 3\n3 1 4 1\n2 1 2 3 4\n$EndElements\n",
      "b.msh");
  const TetrahedralMesh tetgen =
      readTetGen("4 3 0 0\n0 0 0 0\n1 1 0 0\n2 0 1 0\n3 0 0 1\n", "# made by hand\n1 4 0\n0 0 1 2 3\n", "c");
  for (const TetrahedralMesh& mesh : {two, four, tetgen}) {
    ASSERT_EQ(mesh.tetrahedra.size(), 1u);
    EXPECT_EQ(mesh.nodes.size(), 4u);
    EXPECT_NEAR(tetrahedronVolume(mesh, mesh.tetrahedra[0]), 1.0 / 6, 1e-15);
  }
  EXPECT_THROW(readTetGen("1 3\n0 0 0 0\n", "1 4\n0 0 0 0 7\n", "d"), InputError);
  EXPECT_THROW(readGmsh("$MeshFormat\n2.2 1 8\n", "e"), InputError);
  EXPECT_THROW(readVtk("# vtk\nx\nBINARY\n", "f"), InputError);
}

}  // namespace
}  // namespace palpate
