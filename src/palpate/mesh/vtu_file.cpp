#include "palpate/mesh/vtu_file.h"

#include <bit>

#include "palpate/mesh/text_scanner.h"

namespace palpate {
namespace {

static_assert(std::endian::native == std::endian::little);

const char* typeName(const std::vector<float>&) { return "Float32"; }
const char* typeName(const std::vector<double>&) { return "Float64"; }
const char* typeName(const std::vector<std::int32_t>&) { return "Int32"; }
const char* typeName(const std::vector<std::uint8_t>&) { return "UInt8"; }

int cornersOf(VtuGrid::Cell cell) {
  return cell == VtuGrid::Cell::vertex ? 1 : cell == VtuGrid::Cell::triangle ? 3 : 4;
}

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '&') {
      out += "&amp;";
    } else if (c == '<') {
      out += "&lt;";
    } else if (c == '"') {
      out += "&quot;";
    } else {
      out += static_cast<unsigned char>(c) < ' ' ? '?' : c;
    }
  }
  return out;
}

std::string numberText(double value) {
  std::string out;
  appendNumber(out, value);
  return out;
}

// The XML, and what it refers to behind it.
class VtuWriter {
 public:
  std::string write(const VtuGrid& grid) {
    const std::size_t points = std::visit([](const auto& v) { return v.size() / 3; }, grid.points.values);
    const auto corners = static_cast<std::size_t>(cornersOf(grid.cell));
    const std::size_t cells = grid.corners.size() / corners;
    xml_ =
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" "
        "header_type=\"UInt64\">\n<UnstructuredGrid>\n";
    if (grid.time)
      xml_ += "<FieldData><DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">" +
              numberText(*grid.time) + "</DataArray></FieldData>\n";
    xml_ +=
        "<Piece NumberOfPoints=\"" + std::to_string(points) + "\" NumberOfCells=\"" + std::to_string(cells) + "\">\n";
    xml_ += "<PointData>\n";
    for (const VtuArray& a : grid.point_data) array(a);
    xml_ += "</PointData>\n<CellData>\n";
    for (const VtuArray& a : grid.cell_data) array(a);
    xml_ += "</CellData>\n<Points>\n";
    array(grid.points);
    xml_ += "</Points>\n<Cells>\n";
    array("connectivity", 1, grid.corners);
    std::vector<std::int32_t> ends(cells);
    for (std::size_t i = 0; i < cells; ++i) ends[i] = static_cast<std::int32_t>((i + 1) * corners);
    array("offsets", 1, ends);
    array("types", 1, std::vector<std::uint8_t>(cells, static_cast<std::uint8_t>(grid.cell)));
    xml_ += "</Cells>\n</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_";
    return xml_ + data_ + "\n</AppendedData>\n</VTKFile>\n";
  }

 private:
  void array(const VtuArray& a) {
    std::visit([&](const auto& values) { array(a.name, a.components, values); }, a.values);
  }
  template <class T>
  void array(const std::string& name, int components, const std::vector<T>& values) {
    xml_ += std::string("<DataArray type=\"") + typeName(values) + "\" Name=\"" + escaped(name) +
            "\" NumberOfComponents=\"" + std::to_string(components) + "\" format=\"appended\" offset=\"" +
            std::to_string(data_.size()) + "\"/>\n";
    const std::uint64_t bytes = values.size() * sizeof(T);
    data_.append(reinterpret_cast<const char*>(&bytes), sizeof bytes);
    data_.append(reinterpret_cast<const char*>(values.data()), bytes);
  }

  std::string xml_, data_;
};

}  // namespace

std::string vtuBytes(const VtuGrid& grid) { return VtuWriter().write(grid); }

std::string pvdText(const std::vector<PvdEntry>& entries) {
  std::string out =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" "
      "byte_order=\"LittleEndian\">\n<Collection>\n";
  for (const PvdEntry& e : entries) {
    out += "<DataSet timestep=\"" + numberText(e.time) + "\" part=\"" + std::to_string(e.part) + "\" name=\"" +
           escaped(e.name) + "\" file=\"" + escaped(e.file) + "\"/>\n";
  }
  return out + "</Collection>\n</VTKFile>\n";
}

}  // namespace palpate
