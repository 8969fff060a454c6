#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "palpate/scene/checks.h"
#include "palpate/scene/read_parts.h"

// Shapes and regions.

namespace palpate::reading {
namespace {

/// A package name leads to a folder, so it must not lead anywhere else.
std::string readPackageName(const Value& value) {
  std::string name = value.name();
  if (name.front() == '.') value.fail(fmt::format("{} is not a package name", shownText(name)));
  return name;
}

void checkPackageFile(const Value& value, const FileReference& reference) {
  if (reference.package.empty()) return;
  const std::filesystem::path path(reference.file);
  if (path.is_absolute() || std::find(path.begin(), path.end(), "..") != path.end())
    value.fail("with a package, file is relative to the package's data folder and has no ..");
}

AlienShapeConfig readAlien(const Value& value) {
  AlienShapeConfig shape;
  value.fields({numberField("height", shape.height, Range::within(0.01, 2.0, "m")),
                numberField("resolution", shape.resolution, Range::within(0.005, 0.04, "heights"))});
  return shape;
}

SurfaceShapeConfig readSurface(const Value& value) {
  static const std::vector<std::string> axes{"x", "y", "z"};
  SurfaceShapeConfig shape;
  FileReference& file = shape.file;
  value.fields({required({"file", [&](const Value& v) { file.file = readFileName(v); }}),
                {"package", [&](const Value& v) { file.package = readPackageName(v); }},
                numberField("size", shape.size, kSize),
                numberField("tolerance", shape.tolerance, Range::within(0.0, 1.0, "m")),
                choiceField("up", shape.up, axes)});
  checkPackageFile(value, file);
  return shape;
}

BarShapeConfig readBar(const Value& value) {
  BarShapeConfig shape;
  const auto readCells = [&](const Value& cells) {
    const std::vector<Value> parts = cells.exactly(3, "numbers");
    for (std::size_t i = 0; i < 3; ++i) shape.cells[i] = parts[i].integer(1, 200);
  };
  value.fields({required(vectorField("size", shape.size, kSize)), required({"cells", readCells})});
  return shape;
}

BoxShapeConfig readBox(const Value& value) {
  BoxShapeConfig shape;
  value.fields({required(vectorField("size", shape.size, kSize))});
  return shape;
}

SphereShapeConfig readSphere(const Value& value) {
  SphereShapeConfig shape;
  value.fields({required(numberField("radius", shape.radius, kSize))});
  return shape;
}

CapsuleShapeConfig readCapsule(const Value& value) {
  CapsuleShapeConfig shape;
  value.fields(
      {required(numberField("radius", shape.radius, kSize)), required(numberField("length", shape.length, kSize))});
  if (shape.length < 2.0 * shape.radius) value.fail("length, from tip to tip, must be at least twice the radius");
  return shape;
}

TetrahedraFileShapeConfig readTetrahedraFile(const Value& value) {
  TetrahedraFileShapeConfig shape;
  shape.file.file = readFileName(value);
  return shape;
}

RevolutionShapeConfig readRevolution(const Value& value) {
  RevolutionShapeConfig shape;
  const auto readCorner = [](const Value& corner) -> std::array<double, 2> {
    const std::vector<Value> parts = corner.exactly(2, "numbers", ", r and z");
    return {parts[0].number(Range::within(0.0, 10.0, "m")), parts[1].number(Range::within(-10.0, 10.0, "m"))};
  };
  const auto readProfile = [&](const Value& profile) {
    for (const Value& corner : profile.items(kLargestProfile)) shape.profile.push_back(readCorner(corner));
    if (const auto cause = profileObjection(shape.profile)) profile.fail(*cause);
  };
  value.fields({required({"profile", readProfile}),
                integerField("segments", shape.segments, kLeastRevolutionSegments, kLargestRevolutionSegments)});
  return shape;
}

SphereRegionConfig readSphereRegion(const Value& value) {
  SphereRegionConfig region;
  value.fields({required(vectorField("center", region.center, kCoordinate)),
                required(numberField("radius", region.radius, kSize))});
  return region;
}

BoxRegionConfig readBoxRegion(const Value& value) {
  BoxRegionConfig region;
  value.fields(
      {required(vectorField("min", region.min, kCoordinate)), required(vectorField("max", region.max, kCoordinate))});
  if ((region.min.array() > region.max.array()).any()) value.fail("min must not be above max");
  return region;
}

CapsuleRegionConfig readCapsuleRegion(const Value& value) {
  CapsuleRegionConfig region;
  value.fields({required(vectorField("a", region.a, kCoordinate)), required(vectorField("b", region.b, kCoordinate)),
                required(numberField("radius", region.radius, kSize))});
  return region;
}

HalfspaceRegionConfig readHalfspaceRegion(const Value& value) {
  HalfspaceRegionConfig region;
  value.fields(
      {required(vectorField("point", region.point, kCoordinate)), required(directionField("normal", region.normal))});
  return region;
}

LandmarkRegionConfig readLandmarkRegion(const Value& value) {
  LandmarkRegionConfig region;
  const auto readName = [&](const Value& name) {
    region.landmark = alienLandmarkNames().at(name.choice(alienLandmarkNames()));
  };
  value.fields({required({"name", readName}), required(numberField("radius", region.radius, kSize))});
  return region;
}

SpheresRegionConfig readSpheresRegion(const Value& value) {
  constexpr std::size_t kMaxSpheres = 1000;
  SpheresRegionConfig region;
  const auto readCenters = [&](const Value& list) {
    for (const Value& item : list.items(kMaxSpheres)) region.centers.push_back(item.vector(kCoordinate));
    if (region.centers.empty()) list.fail("is empty; at least one center is needed");
  };
  value.fields({required({"centers", readCenters}), required(numberField("radius", region.radius, kSize))});
  return region;
}

}  // namespace

std::string readFileName(const Value& value) {
  std::string name = value.text(4000);
  if (name.empty()) value.fail("is empty; a file name is needed");
  return name;
}

Field shapeField(ShapeConfig& shape) {
  const auto field = [&shape](const char* key, auto read) {
    return Field{key, [&shape, read](const Value& value) { shape = read(value); }};
  };
  const std::vector<Field> choices{field("alien", readAlien),
                                   field("surface", readSurface),
                                   field("bar", readBar),
                                   field("box", readBox),
                                   field("sphere", readSphere),
                                   field("capsule", readCapsule),
                                   field("revolution", readRevolution),
                                   field("tetrahedra_file", readTetrahedraFile)};
  return required({"shape", [choices](const Value& value) { value.oneOf(choices); }});
}

void requireSurface(const Value& value, const ShapeConfig& shape, const char* owner) {
  if (!isSurface(shape)) value.fail(fmt::format("{} needs a surface, not tetrahedra", owner));
}

Field regionField(RegionConfig& region, const ShapeConfig& shape) {
  const auto field = [&region](const char* key, auto read) {
    return Field{key, [&region, read](const Value& value) { region = read(value); }};
  };
  const auto readLandmark = [&shape](const Value& value) {
    if (!std::holds_alternative<AlienShapeConfig>(shape)) value.fail("only the shape alien has landmarks");
    return readLandmarkRegion(value);
  };
  const std::vector<Field> choices{field("sphere", readSphereRegion),   field("box", readBoxRegion),
                                   field("capsule", readCapsuleRegion), field("halfspace", readHalfspaceRegion),
                                   field("landmark", readLandmark),     field("spheres", readSpheresRegion)};
  return required({"region", [choices](const Value& value) { value.oneOf(choices); }});
}

}  // namespace palpate::reading
