#include "palpate/mesh/surface_io.h"

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <limits>
#include <optional>

#include "palpate/common/error.h"
#include "palpate/mesh/polygon.h"
#include "palpate/mesh/surface_formats.h"
#include "palpate/mesh/surface_repair.h"
#include "palpate/mesh/text_scanner.h"

namespace palpate {

// ---------------------------------------------------------------- reading

void SurfaceBuilder::addVertex(const Vec3& x) {
  if (!x.allFinite() || x.cwiseAbs().maxCoeff() > 1e9)
    throw InputError(name_, "vertex " + std::to_string(surface_.vertices.size() + 1), "a coordinate is beyond 1e9");
  surface_.vertices.push_back(x);
}

void SurfaceBuilder::corner(long long index) {
  if (index < 0 || index >= std::numeric_limits<int>::max())
    throw InputError(name_, "face at " + std::to_string(place_), "vertex index out of range");
  const int v = static_cast<int>(index);
  if (corners_ == 0) first_ = v;
  if (corners_ >= 2) {
    if (surface_.triangles.size() >= static_cast<size_t>(kLargestSurface))
      throw InputError(
          name_, "",
          "has more than " + std::to_string(kLargestSurface) + " triangles, which is the limit: simplify it first");
    surface_.triangles.push_back({first_, last_, v});
  }
  last_ = v;
  ++corners_;
}

void SurfaceBuilder::endPolygon() {
  if (corners_ < 3) throw InputError(name_, "face at " + std::to_string(place_), "has fewer than three corners");
  const auto triangles = static_cast<size_t>(corners_ - 2);
  if (triangles > 1) polygons_.push_back({surface_.triangles.size() - triangles, triangles});
}

void SurfaceBuilder::cutPolygons() {
  long long looks = kPolygonLooks;
  std::vector<int> corners;
  for (const Polygon& polygon : polygons_) {
    std::array<int, 3>* const fan = surface_.triangles.data() + polygon.first;
    corners.assign({fan[0][0], fan[0][1]});
    for (size_t t = 0; t < polygon.triangles; ++t) corners.push_back(fan[t][2]);
    cutPolygon(surface_.vertices, corners, looks, fan);
  }
}

Surface SurfaceBuilder::finish() {
  if (surface_.triangles.empty()) throw InputError(name_, "", "has no triangles");
  const int n = static_cast<int>(surface_.vertices.size());
  for (size_t t = 0; t < surface_.triangles.size(); ++t)
    for (int v : surface_.triangles[t])
      if (v >= n)
        throw InputError(name_, "triangle " + std::to_string(t + 1),
                         "vertex index out of range: there are " + std::to_string(n) + " vertices");
  cutPolygons();
  return std::move(surface_);
}

namespace {

std::optional<SurfaceFormat> knownFormat(const std::string& path) {
  const std::string ending = endingOf(path);
  if (ending == ".obj") return SurfaceFormat::obj;
  if (ending == ".stl") return SurfaceFormat::stl;
  if (ending == ".ply") return SurfaceFormat::ply;
  if (ending == ".off") return SurfaceFormat::off;
  if (ending == ".gltf" || ending == ".glb") return SurfaceFormat::gltf;
  if (ending == ".3mf") return SurfaceFormat::three_mf;
  return std::nullopt;
}

}  // namespace

bool canWriteSurface(const std::string& path) {
  const std::optional<SurfaceFormat> format = knownFormat(path);
  return format && *format != SurfaceFormat::gltf && *format != SurfaceFormat::three_mf;
}

SurfaceFormat surfaceFormatOf(const std::string& path) {
  if (const std::optional<SurfaceFormat> format = knownFormat(path)) return *format;
  throw InputError(path, "",
                   "unknown kind of surface file: the name must end in .obj, .stl, .ply, .off, .glb, .gltf or .3mf");
}

namespace {

Surface readFrom(std::string_view data, SurfaceFormat format, const std::string& name, const std::string& folder) {
  if (data.empty()) throw InputError(name, "", "is empty");
  SurfaceBuilder builder(name);
  switch (format) {
    case SurfaceFormat::obj:
      readObj(data, builder);
      break;
    case SurfaceFormat::stl:
      readStl(data, builder);
      break;
    case SurfaceFormat::ply:
      readPly(data, builder);
      break;
    case SurfaceFormat::off:
      readOff(data, builder);
      break;
    case SurfaceFormat::gltf:
      readGltf(data, builder, folder);
      break;
    case SurfaceFormat::three_mf:
      readThreeMf(data, builder);
      break;
  }
  return builder.finish();
}

}  // namespace

Surface readSurfaceFromMemory(std::string_view data, SurfaceFormat format, const std::string& name) {
  return readFrom(data, format, name, "");
}

Surface readSurface(const std::string& path) {
  const SurfaceFormat format = surfaceFormatOf(path);
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return readFrom(readFile(path), format, path, folder.empty() ? "." : folder);
}

Surface loadSolid(const std::string& path, double size, RepairReport* report) {
  if (!(size >= 0) || !std::isfinite(size)) throw InputError(path, "size", "must be positive, or 0 to keep the file's");
  RepairedSurface repaired = repairSurface(readSurface(path));
  if (report != nullptr) *report = repaired.report;
  Surface surface = std::move(repaired.surface);
  requireSolid(surface, path);
  if (size > 0) {
    const Bounds box = boundsOf(surface.vertices);
    const double scale = size / (box.high - box.low).maxCoeff();
    for (Vec3& x : surface.vertices) x *= scale;
  }
  return surface;
}

// ---------------------------------------------------------------- writing

namespace {

template <class T>
void appendBytes(std::string& out, T value) {
  static_assert(std::endian::native == std::endian::little);
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out.append(bytes, sizeof(T));
}

void appendVertex(std::string& out, const Vec3& x, const char* before) {
  out += before;
  for (int d = 0; d < 3; ++d) {
    if (d > 0) out += ' ';
    appendNumber(out, x[d]);
  }
  out += '\n';
}

std::string objText(const Surface& s) {
  std::string out;
  for (const Vec3& x : s.vertices) appendVertex(out, x, "v ");
  for (const auto& t : s.triangles)
    out += "f " + std::to_string(t[0] + 1) + " " + std::to_string(t[1] + 1) + " " + std::to_string(t[2] + 1) + "\n";
  return out;
}

std::string offText(const Surface& s) {
  std::string out = "OFF\n" + std::to_string(s.vertices.size()) + " " + std::to_string(s.triangles.size()) + " 0\n";
  for (const Vec3& x : s.vertices) appendVertex(out, x, "");
  for (const auto& t : s.triangles)
    out += "3 " + std::to_string(t[0]) + " " + std::to_string(t[1]) + " " + std::to_string(t[2]) + "\n";
  return out;
}

std::string plyBytes(const Surface& s) {
  std::string out = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(s.vertices.size()) +
                    "\nproperty double x\nproperty double y\nproperty double z\nelement face " +
                    std::to_string(s.triangles.size()) + "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const Vec3& x : s.vertices)
    for (int d = 0; d < 3; ++d) appendBytes(out, x[d]);
  for (const auto& t : s.triangles) {
    appendBytes(out, uint8_t{3});
    for (int v : t) appendBytes(out, static_cast<int32_t>(v));
  }
  return out;
}

std::string stlBytes(const Surface& s) {
  std::string out = "binary STL";
  out.resize(80, ' ');
  appendBytes(out, static_cast<uint32_t>(s.triangles.size()));
  for (const auto& t : s.triangles) {
    const Vec3& a = s.vertices[static_cast<size_t>(t[0])];
    const Vec3& b = s.vertices[static_cast<size_t>(t[1])];
    const Vec3& c = s.vertices[static_cast<size_t>(t[2])];
    const Vec3 normal = (b - a).cross(c - a).normalized();
    for (const Vec3& x : {normal, a, b, c})
      for (int d = 0; d < 3; ++d) appendBytes(out, static_cast<float>(x[d]));
    appendBytes(out, uint16_t{0});
  }
  return out;
}

}  // namespace

void writeSurface(const std::string& path, const Surface& surface) {
  switch (surfaceFormatOf(path)) {
    case SurfaceFormat::obj:
      return writeFile(path, objText(surface));
    case SurfaceFormat::off:
      return writeFile(path, offText(surface));
    case SurfaceFormat::ply:
      return writeFile(path, plyBytes(surface));
    case SurfaceFormat::stl:
      return writeFile(path, stlBytes(surface));
    case SurfaceFormat::gltf:
    case SurfaceFormat::three_mf:
      throw InputError(path, "", "glTF and 3MF are read, not written: the name must end in .obj, .stl, .ply or .off");
  }
}

}  // namespace palpate
