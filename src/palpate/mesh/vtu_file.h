#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace palpate {

/// Named numbers of a VTU file.
struct VtuArray {
  std::string name;
  int components = 1;
  std::variant<std::vector<float>, std::vector<double>, std::vector<std::int32_t>> values;
};

/// An unstructured grid with cells of one kind.
struct VtuGrid {
  enum class Cell { vertex = 1, triangle = 5, tetrahedron = 10 };  ///< VTK's numbers
  VtuArray points;                                                 ///< of three components [m]
  Cell cell = Cell::tetrahedron;
  std::vector<std::int32_t> corners;  ///< of all cells, 1, 3 or 4 each
  std::vector<VtuArray> point_data, cell_data;
  std::optional<double> time;  ///< [s]
};

/// A VTU file: VTK XML, its arrays appended raw, little-endian, not compressed.
std::string vtuBytes(const VtuGrid& grid);

/// A file of a time series.
struct PvdEntry {
  double time;  ///< [s]
  int part;
  std::string name;  ///< of the part
  std::string file;  ///< beside the PVD file
};

/// A PVD file, by which ParaView opens a time series.
std::string pvdText(const std::vector<PvdEntry>& entries);

}  // namespace palpate
