#include <algorithm>
#include <optional>

#include "palpate/common/error.h"
#include "palpate/mesh/number_type.h"
#include "palpate/mesh/tetrahedral_formats.h"
#include "palpate/mesh/text_scanner.h"

namespace palpate {
namespace {

std::optional<NumberType> vtkTypeNamed(std::string_view name) {
  static const std::map<std::string_view, NumberType> types = {
      {"char", NumberType::i8},          {"unsigned_char", NumberType::u8},
      {"short", NumberType::i16},        {"unsigned_short", NumberType::u16},
      {"int", NumberType::i32},          {"unsigned_int", NumberType::u32},
      {"long", NumberType::i64},         {"unsigned_long", NumberType::u64},
      {"vtktypeint64", NumberType::i64}, {"vtktypeuint64", NumberType::u64},
      {"vtktypeint32", NumberType::i32}, {"vtkIdType", NumberType::i32},
      {"float", NumberType::f32},        {"double", NumberType::f64}};
  const auto it = types.find(name);
  return it == types.end() ? std::nullopt : std::optional(it->second);
}

// Points, cells and their types of an unstructured grid; what comes with them is passed over.
class VtkReader {
 public:
  VtkReader(std::string_view data, const std::string& name, CellCollector& cells)
      : name_(name), data_(data), scan_(data, name), cells_(cells) {
    scan_.setComment(0);
  }

  void read() {
    readHead();
    while (!(points_ && have_cells_ && have_types_) && scan_.nextLine()) readPart(scan_.word());
    if (!grid_) throw InputError(name_, "DATASET", "is missing");
    requireAll();
    addCells();
  }

 private:
  // Three lines, the second of which says anything, or nothing.
  void readHead() {
    if (!scan_.nextLine() || scan_.word() != "#" || scan_.word() != "vtk")
      scan_.fail("a legacy VTK file begins with '# vtk DataFile'");
    const std::size_t title_end = data_.find('\n', scan_.offset());
    if (title_end != std::string_view::npos) scan_.skipTo(title_end + 1);
    if (!scan_.nextLine()) scan_.fail("the file ends where ASCII or BINARY should follow");
    const std::string_view kind = scan_.word();
    if (kind != "ASCII" && kind != "BINARY") scan_.fail("this line must be ASCII or BINARY");
    binary_ = kind == "BINARY";
  }

  void readPart(std::string_view keyword) {
    if (keyword == "DATASET") {
      const std::string kind(scan_.word());
      if (kind != "UNSTRUCTURED_GRID")
        scan_.fail("the file holds " + kind.substr(0, 40) + "; tetrahedra are in an UNSTRUCTURED_GRID only");
      grid_ = true;
    } else if (keyword == "POINTS") {
      readPoints();
    } else if (keyword == "CELLS") {
      readCells();
    } else if (keyword == "CELL_TYPES") {
      const long long count = this->count("the number of cells");
      types_ = wholeNumbers(count, NumberType::i32, "a cell type");
      have_types_ = true;
    } else if (keyword == "FIELD") {
      skipFields();
    } else if (keyword == "POINT_DATA" || keyword == "CELL_DATA") {
      requireAll();
    } else if (binary_ && keyword == "METADATA") {
      scan_.skipPast("\n\n");  // an empty line ends it
    } else if (binary_) {
      scan_.fail("here should be POINTS, CELLS or CELL_TYPES");
    }
  }

  void requireAll() const {
    if (!points_) throw InputError(name_, "POINTS", "is missing");
    if (!have_cells_) throw InputError(name_, "CELLS", "is missing");
    if (!have_types_) throw InputError(name_, "CELL_TYPES", "is missing");
  }

  long long count(const char* wanted) {
    const long long n = scan_.integer(wanted);
    if (n < 0) scan_.fail(std::string(wanted) + " must not be negative");
    return n;
  }

  NumberType type() {
    const std::string_view name = scan_.word();
    const std::optional<NumberType> known = vtkTypeNamed(name);
    if (!known) scan_.fail("unknown type of numbers '" + std::string(name.substr(0, 40)) + "'");
    return *known;
  }

  // The bytes of so many numbers, which begin with the next line.
  ByteReader numbers(long long count, NumberType type) {
    const std::size_t size = bytesOf(type);
    if (static_cast<unsigned long long>(count) > data_.size() / size) scan_.fail("the file is truncated here");
    return {scan_.bytes(static_cast<std::size_t>(count) * size), true};
  }

  std::vector<long long> wholeNumbers(long long count, NumberType type, const char* wanted) {
    std::vector<long long> out;
    if (!binary_) {
      scan_.skipRestOfLine();
      for (long long i = 0; i < count; ++i) out.push_back(scan_.anyInteger(wanted));
      return out;
    }
    if (!isWhole(type)) scan_.fail(std::string(wanted) + " is of a type that is not whole");
    ByteReader bytes = numbers(count, type);
    out.resize(static_cast<std::size_t>(count));
    for (long long& value : out) takeNumber(bytes, type, value);
    return out;
  }

  void readPoints() {
    const long long count = this->count("the number of points");
    const NumberType kind = type();
    if (points_) scan_.fail("POINTS comes twice");
    points_ = true;
    if (!binary_) {
      scan_.skipRestOfLine();
      for (long long i = 0; i < count; ++i) {
        const double x = scan_.anyNumber("x");
        const double y = scan_.anyNumber("y");
        const double z = scan_.anyNumber("z");
        cells_.node(i, {x, y, z});
      }
      return;
    }
    if (count > (1LL << 40)) scan_.fail("the file is truncated here");
    ByteReader bytes = numbers(3 * count, kind);
    for (long long i = 0; i < count; ++i) {
      Vec3 x;
      for (int d = 0; d < 3; ++d) takeNumber(bytes, kind, x[d]);
      cells_.node(i, x);
    }
  }

  // Up to version 4: each cell as the number of its corners and the corners. From 5 on: where the cells begin, then all
  // corners.
  void readCells() {
    const long long first = count("the number of cells");
    const long long second = count("the size of the cells");
    have_cells_ = true;
    const std::size_t cells_begin = scan_.offset();
    if (scan_.nextLine() && scan_.word() == "OFFSETS") {
      starts_ = wholeNumbers(first, type(), "an offset");
      if (!scan_.nextLine() || scan_.word() != "CONNECTIVITY") scan_.fail("here should be CONNECTIVITY");
      corners_ = wholeNumbers(second, type(), "a point");
      return;
    }
    scan_.skipTo(cells_begin);
    const std::vector<long long> flat = wholeNumbers(second, NumberType::i32, "a point, or the number of corners");
    starts_.push_back(0);
    for (std::size_t at = 0; at < flat.size();) {
      const long long n = flat[at++];
      if (n < 0 || static_cast<unsigned long long>(n) > flat.size() - at)
        throw InputError(name_, "cell " + std::to_string(starts_.size()), "has a bad number of corners");
      corners_.insert(corners_.end(), flat.begin() + static_cast<std::ptrdiff_t>(at),
                      flat.begin() + static_cast<std::ptrdiff_t>(at) + static_cast<std::ptrdiff_t>(n));
      at += static_cast<std::size_t>(n);
      starts_.push_back(static_cast<long long>(corners_.size()));
    }
    if (starts_.size() != static_cast<std::size_t>(first) + 1)
      throw InputError(name_, "CELLS",
                       "promises " + std::to_string(first) + " cells and holds " + std::to_string(starts_.size() - 1));
  }

  // FIELD name arrays, then each: name components tuples type, and the numbers.
  void skipFields() {
    scan_.word();
    const long long arrays = count("the number of arrays");
    for (long long a = 0; a < arrays; ++a) {
      std::string_view name = scan_.anyWord("an array");
      while (name == "METADATA") {  // belongs to the array before; an empty line ends it
        scan_.skipPast("\n\n");
        name = scan_.anyWord("an array");
      }
      const long long components = count("the number of components");
      const long long tuples = count("the number of tuples");
      if (components > 0 && tuples > (1LL << 40) / components) scan_.fail("the array is too large");
      const std::string kind(scan_.word());
      if (!binary_) {
        skipTextArray(components * tuples, kind);
      } else if (kind == "bit") {
        scan_.bytes(static_cast<std::size_t>((components * tuples + 7) / 8));
      } else {
        const std::optional<NumberType> known = vtkTypeNamed(kind);
        if (!known) scan_.fail("an array of type '" + kind.substr(0, 40) + "' cannot be passed over: save without it");
        numbers(components * tuples, *known);
      }
    }
  }
  void skipTextArray(long long length, const std::string& kind) {
    for (long long i = 0; i < length; ++i) {
      if (kind != "string") {
        scan_.anyWord("a number");
      } else if (!scan_.nextLine()) {
        scan_.fail("the file ends where a text should follow");
      }
    }
    scan_.skipRestOfLine();
  }

  void addCells() {
    const std::size_t count = starts_.empty() ? 0 : starts_.size() - 1;
    if (types_.size() != count)
      throw InputError(name_, "CELL_TYPES",
                       "must be as many as CELLS: " + std::to_string(types_.size()) + " and " + std::to_string(count));
    std::vector<long long> corners;
    for (std::size_t i = 0; i < count; ++i) {
      if (starts_[i] < 0 || starts_[i + 1] < starts_[i] || static_cast<std::size_t>(starts_[i + 1]) > corners_.size())
        throw InputError(name_, "cell " + std::to_string(i + 1), "its offset is out of range");
      corners.assign(corners_.begin() + starts_[i], corners_.begin() + starts_[i + 1]);
      cells_.cell(vtkFamily(types_[i]), corners);
    }
  }

  std::string name_;
  std::string_view data_;
  TextScanner scan_;
  CellCollector& cells_;
  bool binary_ = false, grid_ = false, points_ = false, have_cells_ = false, have_types_ = false;
  std::vector<long long> starts_, corners_, types_;
};

}  // namespace

CellFamily vtkFamily(long long type) {
  using enum CellFamily;
  static const std::map<long long, CellFamily> solids = {
      {10, tetrahedron}, {24, tetrahedron}, {71, tetrahedron}, {78, tetrahedron},  // straight, quadratic, of any order
      {11, hexahedron},  {12, hexahedron},  {25, hexahedron},  {29, hexahedron},  {33, hexahedron}, {72, hexahedron},
      {79, hexahedron},  {13, prism},       {26, prism},       {31, prism},       {32, prism},      {73, prism},
      {80, prism},       {14, pyramid},     {27, pyramid},     {37, pyramid},     {74, pyramid},    {81, pyramid},
      {15, polyhedron},  {16, polyhedron},  {41, polyhedron},  {42, polyhedron}};
  const auto it = solids.find(type);
  if (it != solids.end()) return it->second;
  const bool flat_type = (type >= 1 && type <= 9) || (type >= 21 && type <= 23) || type == 28 || type == 30 ||
                         (type >= 34 && type <= 36) || (type >= 68 && type <= 70) || (type >= 75 && type <= 77);
  return flat_type ? flat : unknown;
}

void readVtkCells(std::string_view data, const std::string& name, CellCollector& cells) {
  VtkReader(data, name, cells).read();
}

}  // namespace palpate
