#pragma once

#include <string>
#include <string_view>

#include "palpate/mesh/surface_repair.h"
#include "palpate/mesh/types.h"

namespace palpate {

enum class SurfaceFormat { obj, stl, ply, off, gltf, three_mf };

/// Most triangles that a surface file may have.
inline constexpr int kLargestSurface = 2'000'000;

/// By the file name's ending (.obj, .stl, .ply, .off, .gltf, .glb, .3mf; any case). Throws InputError for others.
SurfaceFormat surfaceFormatOf(const std::string& path);

/// Whether writeSurface() can write a file of this name: .obj, .stl, .ply or .off.
bool canWriteSurface(const std::string& path);

/// Reads the triangles of an OBJ, STL (text or binary), PLY (text or binary) or OFF file as they stand; lengths as in
/// the file. glTF 2.0 (text or binary): its default scene, turned from y up to z up; 3MF: what is to be built; both in
/// meters, which these formats know. Polygons are cut into triangles (polygon.h). STL vertices come three a triangle:
/// see repairSurface. Throws InputError naming file, place and cause: missing, empty or truncated file, malformed or
/// non-finite number, index out of range, no triangles, more than kLargestSurface triangles, a required extension of
/// glTF that is not read.
Surface readSurface(const std::string& path);
/// The same from memory, where glTF has no other files; `name` is for messages.
Surface readSurfaceFromMemory(std::string_view data, SurfaceFormat format, const std::string& name = "surface");

/// readSurface, then scaled so that the longest side of the bounding box is `size` [m] (0: as it stands), and checked
/// by repairSurface and requireSolid. The result is the repaired surface; `report` says what the repair did.
Surface loadSolid(const std::string& path, double size = 0, RepairReport* report = nullptr);

/// Writes by the file name's ending: OBJ and OFF as text, STL and PLY binary (little endian; STL in single precision).
/// The file appears under its name only when complete. Throws InputError if the folder is not writable,
/// or for a format that is only read.
void writeSurface(const std::string& path, const Surface& surface);

}  // namespace palpate
