#include <gtest/gtest.h>

#include <cstring>

#include "palpate/common/error.h"
#include "palpate/mesh/base64.h"
#include "palpate/mesh/mesh_quality.h"
#include "palpate/mesh/shapes.h"
#include "palpate/mesh/surface_io.h"
#include "palpate/mesh/tetrahedral_io.h"
#include "palpate/mesh/vtu_file.h"

// What tests/cli reads from files of other programs is here small, in memory, and damaged in every place.

namespace palpate {
namespace {

template <class Read>
std::string complaintOf(Read read) {
  try {
    read();
  } catch (const InputError& e) {
    const std::string what = e.what();
    EXPECT_EQ(what.find('\n'), std::string::npos);
    return what;
  }
  return "accepted";
}
std::string volumeComplaint(const std::string& data) {
  return complaintOf([&] { readVtk(data, "file"); });
}
std::string gltfComplaint(const std::string& data) {
  return complaintOf([&] { readSurfaceFromMemory(data, SurfaceFormat::gltf, "file"); });
}

template <class T>
void put(std::string& out, T value, bool big = false) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  for (std::size_t i = 0; i < sizeof(T); ++i) out += bytes[big ? sizeof(T) - 1 - i : i];
}

const std::vector<double> kCorners{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};

std::string vtuOfOne() {
  VtuGrid grid;
  grid.points = {"Points", 3, kCorners};
  grid.corners = {0, 1, 2, 3};
  grid.point_data.push_back({"<odd> & \"name\"", 1, std::vector<float>{1, 2, 3, 4}});
  return vtuBytes(grid);
}

std::string legacyBinary(bool newer) {
  std::string out = "# vtk DataFile Version 4.2\n\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n";
  for (const double x : kCorners) put(out, x, true);
  out += newer ? "\nCELLS 2 4\nOFFSETS vtktypeint64\n" : "\nCELLS 1 5\n";
  if (newer) {
    for (const std::int64_t o : {0, 4}) put(out, o, true);
    out += "\nCONNECTIVITY vtktypeint64\n";
    for (const std::int64_t n : {0, 1, 2, 3}) put(out, n, true);
  } else {
    for (const std::int32_t n : {4, 0, 1, 2, 3}) put(out, n, true);
  }
  out += "\nCELL_TYPES 1\n";
  put(out, std::int32_t{10}, true);
  return out;
}

std::string gmshBinary(bool big) {
  std::string out = "$MeshFormat\n2.2 1 8\n";
  put(out, std::int32_t{1}, big);
  out += "\n$EndMeshFormat\n$Comments\nanything $Nodes\n$EndComments\n$Nodes\n4\n";
  for (std::int32_t i = 0; i < 4; ++i) {
    put(out, i + 1, big);
    for (std::size_t d = 0; d < 3; ++d) put(out, kCorners[3 * static_cast<std::size_t>(i) + d], big);
  }
  out += "\n$EndNodes\n$Elements\n2\n";
  for (const std::int32_t n : {2, 1, 1, 7, 5, 1, 2, 3}) put(out, n, big);
  for (const std::int32_t n : {4, 1, 2, 8, 5, 5, 1, 2, 3, 4}) put(out, n, big);
  return out + "\n$EndElements\n";
}

TEST(MeshFormats, BinaryFilesAreRead) {
  const auto check = [](const TetrahedralMesh& mesh) {
    ASSERT_EQ(mesh.tetrahedra.size(), 1u);
    EXPECT_NEAR(tetrahedronVolume(mesh, mesh.tetrahedra[0]), 1.0 / 6, 1e-15);
  };
  check(readVtk(vtuOfOne(), "a"));
  check(readVtk(legacyBinary(false), "b"));
  check(readVtk(legacyBinary(true), "c"));
  check(readGmsh(gmshBinary(false), "d"));
  check(readGmsh(gmshBinary(true), "e"));
}

TEST(MeshFormats, TruncatedFilesAreRefusedWhereverTheyEnd) {
  for (const std::string& data : {legacyBinary(false), legacyBinary(true)}) {
    for (std::size_t n = 0; n < data.size(); ++n) EXPECT_NE(volumeComplaint(data.substr(0, n)), "accepted") << n;
  }
  const std::string vtu = vtuOfOne();
  const std::size_t end = vtu.rfind("\n</AppendedData>");
  for (std::size_t n = 0; n < end; ++n) EXPECT_NE(volumeComplaint(vtu.substr(0, n)), "accepted") << n;
  const std::string gmsh = gmshBinary(false);
  const std::size_t last = gmsh.rfind("\n$EndElements");
  for (std::size_t n = 0; n < last; ++n) {
    EXPECT_NE(complaintOf([&] { readGmsh(gmsh.substr(0, n), "file"); }), "accepted") << n;
  }
}

TEST(MeshFormats, AnyByteMayBeWrong) {
  for (const std::string& data : {legacyBinary(true), vtuOfOne()}) {
    for (std::size_t n = 0; n < data.size(); ++n) {
      for (const char c : {'\0', '9', '\xff'}) {
        std::string damaged = data;
        damaged[n] = c;
        volumeComplaint(damaged);  // no crash, no hang, one line
      }
    }
  }
}

TEST(MeshFormats, SaysWhatAFileHoldsInPlaceOfTetrahedra) {
  const std::string nodes = "$NOD\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$ENDNOD\n";
  const auto gmsh = [&](const std::string& elements) {
    return complaintOf([&] { readGmsh(nodes + "$ELM\n" + elements + "$ENDELM\n", "file"); });
  };
  EXPECT_EQ(gmsh("1\n1 4 1 1 4 1 2 3 4\n"), "accepted");
  EXPECT_EQ(gmsh("1\n1 5 1 1 8 1 2 3 4 1 2 3 4\n"),
            "file: has no tetrahedra but 1 hexahedra: only tetrahedra are simulated");
  EXPECT_NE(gmsh("1\n1 2 1 1 3 1 2 3\n").find("1 faces, lines or points"), std::string::npos);
  EXPECT_EQ(gmsh("0\n"), "file: has no tetrahedra");
  EXPECT_NE(complaintOf([] { readGmsh("hello\n", "file"); }).find("no Gmsh mesh"), std::string::npos);
  EXPECT_NE(complaintOf([] { readGmsh("$MeshFormat\n3 0 8\n", "file"); }).find("versions 1, 2, 4.0"),
            std::string::npos);
  EXPECT_NE(complaintOf([] { readTetrahedra("liver.med"); }).find("MED"), std::string::npos);
  EXPECT_NE(volumeComplaint("<VTKFile type=\"PolyData\"><PolyData/></VTKFile>").find("'PolyData'"), std::string::npos);
  EXPECT_NE(volumeComplaint("# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\n").find("line 4"),
            std::string::npos);
}

TEST(MeshFormats, PromisesAreNotBelieved) {
  const std::string head = "<VTKFile type=\"UnstructuredGrid\" compressor=\"vtkZLibDataCompressor\"><UnstructuredGrid>";
  std::string bytes;
  for (const std::uint32_t n : {1000000U, 4000000000U, 0U}) put(bytes, n);
  for (const char* count : {"4", "4000000000", "99999999999999999999", "-1", "x"}) {
    const std::string piece = std::string("<Piece NumberOfPoints=\"") + count +
                              "\" NumberOfCells=\"1\"><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" "
                              "format=\"binary\">QEIPAAAoa+4AAAAA</DataArray></Points></Piece>";
    EXPECT_NE(volumeComplaint(head + piece + "</UnstructuredGrid></VTKFile>"), "accepted");
  }
  EXPECT_NE(
      volumeComplaint("# vtk DataFile Version 4.2\n\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 9000000000000000000 "
                      "double\n1")
          .find("truncated"),
      std::string::npos);
}

TEST(MeshFormats, Base64MayBePaddedInBetween) {
  std::string out;
  EXPECT_TRUE(Base64Reader(" SGVs\nbG8= IQ== ").takeAll(out));
  EXPECT_EQ(out, "Hello!");
  std::string some;
  Base64Reader reader("SGVsbG8=");
  EXPECT_TRUE(reader.take(2, some) && reader.take(3, some));
  EXPECT_EQ(some, "Hello");
  EXPECT_FALSE(reader.take(1, some));
  std::string bad;
  for (const char* text : {"SGV", "SG=s", "====", "S*Vs"}) EXPECT_FALSE(Base64Reader(text).takeAll(bad)) << text;
}

// A tetrahedron with y up, under a node that moves it and one that makes it larger.
std::string gltfText(const std::string& nodes, const std::string& more = "") {
  std::string bytes;
  for (const double x : kCorners) put(bytes, static_cast<float>(x));
  for (const int i : {0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2}) bytes += static_cast<char>(i);
  static const char* letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string base64;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t three = 0;
    for (std::size_t k = 0; k < 3; ++k) three = three << 8U | static_cast<std::uint8_t>(bytes[i + k]);
    for (int k = 3; k >= 0; --k) base64 += letters[three >> (6U * static_cast<unsigned>(k)) & 63U];
  }
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":)" + nodes + more +
         R"(,"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
  "accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"},
               {"bufferView":1,"componentType":5121,"count":12,"type":"SCALAR"}],
  "bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":12}],
  "buffers":[{"byteLength":60,"uri":"data:application/octet-stream;base64,)" +
         base64 + "\"}]}";
}
const std::string kTwoNodes = R"([{"children":[1],"translation":[0,5,0]},{"mesh":0,"scale":[2,2,2]}])";

TEST(MeshFormats, GltfIsPlacedByItsNodesAndStandsUpright) {
  const Surface s = readSurfaceFromMemory(gltfText(kTwoNodes), SurfaceFormat::gltf);
  EXPECT_EQ(s.triangles.size(), 4u);
  EXPECT_NEAR(measureSurface(s).volume, 8.0 / 6, 1e-12);
  const Bounds box = boundsOf(s.vertices);
  EXPECT_LT((box.low - Vec3(0, -2, 5)).norm(), 1e-12);  // (x, y, z) of the file is (x, -z, y) here
  EXPECT_LT((box.high - Vec3(2, 0, 7)).norm(), 1e-12);
}

TEST(MeshFormats, GltfMirroredByANodeStillFacesOutward) {
  const std::string mirrored = R"([{"mesh":0,"scale":[-1,1,1]}])";
  EXPECT_NEAR(measureSurface(readSurfaceFromMemory(gltfText(mirrored), SurfaceFormat::gltf)).volume, 1.0 / 6, 1e-12);
}

TEST(MeshFormats, GltfThatIsWrongIsRefused) {
  EXPECT_NE(gltfComplaint(gltfText(R"([{"children":[0],"mesh":0}])")).find("two parents"), std::string::npos);
  EXPECT_NE(gltfComplaint(gltfText(R"([{"mesh":7}])")).find("there is no number 7"), std::string::npos);
  EXPECT_NE(gltfComplaint(gltfText(R"([{"mesh":0,"scale":[1e300,1,1]}])")).find("beyond 1e9"), std::string::npos);
  EXPECT_NE(gltfComplaint(gltfText(kTwoNodes, R"(,"extensionsRequired":["KHR_draco_mesh_compression"])")).find("draco"),
            std::string::npos);
  const std::string whole = gltfText(kTwoNodes);
  const auto changed = [&](const std::string& from, const std::string& to) {
    std::string text = whole;
    text.replace(text.find(from), from.size(), to);
    return gltfComplaint(text);
  };
  EXPECT_NE(changed("\"count\":4", "\"count\":5").find("beyond its data"), std::string::npos);
  EXPECT_NE(changed("\"count\":4", "\"count\":3").find("no vertex 3"), std::string::npos);
  EXPECT_NE(changed("\"count\":12", "\"count\":18446744073709551615").find("beyond its data"), std::string::npos);
  EXPECT_NE(changed("data:application/octet-stream;base64,", "../x.bin#").find("no file beside"), std::string::npos);
  EXPECT_NE(changed("data:application/octet-stream;base64,", "x.bin#").find("save as .glb"), std::string::npos);
  EXPECT_NE(changed("\"version\":\"2.0\"", "\"version\":\"1.0\"").find("version 2"), std::string::npos);
  for (std::size_t n = 1; n < whole.size(); n += 7) EXPECT_NE(gltfComplaint(whole.substr(0, n)), "accepted");
  EXPECT_NE(gltfComplaint("glTF\2").find("truncated"), std::string::npos);
}

TEST(MeshFormats, ThreeMfMustBeAnArchive) {
  EXPECT_NE(complaintOf([] { readSurfaceFromMemory("PK\3\4 no", SurfaceFormat::three_mf, "file"); }).find("ZIP"),
            std::string::npos);
}

}  // namespace
}  // namespace palpate
