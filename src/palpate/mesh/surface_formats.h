#pragma once

#include <string>
#include <string_view>

#include "palpate/mesh/surface_io.h"
#include "palpate/mesh/types.h"

// One reader a format, used by surface_io.cpp only. They throw InputError; the caller checks indices with
// SurfaceBuilder.

namespace palpate {

/// Collects vertices and polygons while a file is read, and checks what all formats have to.
class SurfaceBuilder {
 public:
  explicit SurfaceBuilder(const std::string& name) : name_(name) {}

  /// Throws InputError for coordinates beyond 1e9, whose squares and cubes would overflow further on.
  void addVertex(const Vec3& x);
  size_t vertices() const { return surface_.vertices.size(); }
  /// Starts, continues and ends a polygon; place is the line or element number for messages.
  void beginPolygon(long long place) {
    place_ = place;
    corners_ = 0;
  }
  void corner(long long index);
  void endPolygon();
  /// Checks the number of triangles and every index that came before its vertex; cuts polygons up (cutPolygon).
  Surface finish();
  const std::string& name() const { return name_; }

 private:
  std::string name_;
  Surface surface_;
  long long place_ = 0;
  int corners_ = 0;
  int first_ = 0;
  int last_ = 0;
  // Of polygons with more than three corners, whose triangles are the fan until all vertices are known.
  struct Polygon {
    size_t first;  // triangle
    size_t triangles;
  };
  std::vector<Polygon> polygons_;

  void cutPolygons();
};

void readObj(std::string_view data, SurfaceBuilder& builder);
void readStl(std::string_view data, SurfaceBuilder& builder);
void readPly(std::string_view data, SurfaceBuilder& builder);
void readOff(std::string_view data, SurfaceBuilder& builder);
/// @param folder  of the files that it refers to; empty: there are none
void readGltf(std::string_view data, SurfaceBuilder& builder, const std::string& folder);
void readThreeMf(std::string_view data, SurfaceBuilder& builder);

}  // namespace palpate
