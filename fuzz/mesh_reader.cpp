// Any bytes as a surface or tetrahedral mesh file; the first byte chooses the format. What is accepted and small goes
// through repair, capping, measures and the solid check as well.
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "palpate/common/error.h"
#include "palpate/mesh/surface_io.h"
#include "palpate/mesh/surface_repair.h"
#include "palpate/mesh/tetrahedral_io.h"

namespace {

void tryTetrahedra(int kind, std::string_view rest) {
  if (kind == 4) palpate::readGmsh(rest, "fuzz");
  if (kind == 5) palpate::readVtk(rest, "fuzz");  // VTU too
  if (kind == 6) palpate::readTetGen(rest.substr(0, rest.size() / 2), rest.substr(rest.size() / 2), "fuzz");
}

void trySurface(int kind, std::string_view rest) {
  using enum palpate::SurfaceFormat;
  constexpr std::array formats{obj, stl, ply, off, obj, obj, obj, gltf, three_mf};
  const palpate::Surface surface = palpate::readSurfaceFromMemory(rest, formats.at(static_cast<std::size_t>(kind)));
  if (surface.triangles.size() > 500) return;
  const palpate::Surface repaired = palpate::repairSurface(surface).surface;
  palpate::measureSurface(palpate::capHoles(repaired));
  palpate::requireSolid(repaired, "fuzz");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size == 0) return 0;
  const int kind = data[0] % 9;
  const std::string_view rest(reinterpret_cast<const char*>(data) + 1, size - 1);
  try {
    kind<4 || kind> 6 ? trySurface(kind, rest) : tryTetrahedra(kind, rest);
  } catch (const palpate::InputError&) {
    // The one way in which bad input may end.
  }
  return 0;
}
