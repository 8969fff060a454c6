#include <cmath>
#include <optional>

#include "palpate/common/error.h"
#include "palpate/mesh/number_type.h"
#include "palpate/mesh/surface_formats.h"
#include "palpate/mesh/text_scanner.h"

namespace palpate {
namespace {

struct Property {
  std::string name;
  NumberType type = NumberType::f32;
  std::optional<NumberType> count_type;  ///< for lists
};

struct Element {
  std::string name;
  long long count = 0;
  std::vector<Property> properties;
};

std::optional<NumberType> typeNamed(std::string_view name) {
  if (name == "char" || name == "int8") return NumberType::i8;
  if (name == "uchar" || name == "uint8") return NumberType::u8;
  if (name == "short" || name == "int16") return NumberType::i16;
  if (name == "ushort" || name == "uint16") return NumberType::u16;
  if (name == "int" || name == "int32") return NumberType::i32;
  if (name == "uint" || name == "uint32") return NumberType::u32;
  if (name == "float" || name == "float32") return NumberType::f32;
  if (name == "double" || name == "float64") return NumberType::f64;
  return std::nullopt;
}

class PlyReader {
 public:
  PlyReader(std::string_view data, SurfaceBuilder& builder)
      : data_(data), builder_(builder), scan_(data, builder.name()), bytes_({}, false) {
    scan_.setComment(0);
  }

  void read() {
    readHeader();
    bytes_ = ByteReader(data_.substr(scan_.offset()), big_endian_);
    for (const Element& element : elements_) readElement(element);
  }

 private:
  void readHeader() {
    if (!scan_.nextLine() || scan_.word() != "ply") scan_.fail("a PLY file begins with the line 'ply'");
    bool format = false;
    while (scan_.nextLine()) {
      const std::string_view keyword = scan_.word();
      if (keyword == "end_header") {
        if (!format) scan_.fail("the header has no format line");
        return;
      }
      if (keyword == "format") {
        const std::string_view kind = scan_.word();
        if (kind != "ascii" && kind != "binary_little_endian" && kind != "binary_big_endian")
          scan_.fail("unknown format");
        text_ = kind == "ascii";
        big_endian_ = kind == "binary_big_endian";
        format = true;
      } else if (keyword == "element") {
        elements_.emplace_back();
        elements_.back().name = scan_.word();
        elements_.back().count = scan_.integer("the number of elements");
        if (elements_.back().count < 0) scan_.fail("the number of elements must not be negative");
      } else if (keyword == "property") {
        readProperty();
      }
    }
    scan_.fail("the header has no end");
  }

  NumberType readType() {
    const std::optional<NumberType> type = typeNamed(scan_.word());
    if (!type) scan_.fail("unknown type of property");
    return *type;
  }

  void readProperty() {
    if (elements_.empty()) scan_.fail("a property without an element");
    if (elements_.back().properties.size() >= 256) scan_.fail("an element has more than 256 properties");
    Property property;
    std::string_view first = scan_.word();
    if (first == "list") {
      property.count_type = readType();
      property.type = readType();
    } else {
      const std::optional<NumberType> type = typeNamed(first);
      if (!type) scan_.fail("unknown type of property");
      property.type = *type;
    }
    property.name = scan_.word();
    elements_.back().properties.push_back(std::move(property));
  }

  [[noreturn]] void truncated(const Element& element, long long i) const {
    throw InputError(builder_.name(), element.name + " " + std::to_string(i + 1), "the file is truncated here");
  }

  double next(NumberType type, const Element& element, long long i) {
    if (text_) return scan_.anyNumber(element.name.c_str());
    double value = 0;
    if (!takeNumber(bytes_, type, value)) truncated(element, i);
    return value;
  }

  void readElement(const Element& element) {
    if (element.properties.empty()) return;
    for (long long i = 0; i < element.count; ++i) {
      Vec3 x = Vec3::Zero();
      for (const Property& property : element.properties) {
        if (property.count_type) {
          readList(property, element, i);
          continue;
        }
        const double value = next(property.type, element, i);
        if (property.name == "x") x[0] = value;
        if (property.name == "y") x[1] = value;
        if (property.name == "z") x[2] = value;
      }
      if (element.name != "vertex") continue;
      if (!x.allFinite())
        throw InputError(builder_.name(), "vertex " + std::to_string(i + 1), "a coordinate is not finite");
      builder_.addVertex(x);
    }
  }

  void readList(const Property& property, const Element& element, long long i) {
    const double length = next(*property.count_type, element, i);
    if (!(length >= 0 && length <= 4294967295.0 && length == std::floor(length)))
      throw InputError(builder_.name(), element.name + " " + std::to_string(i + 1), "the length of a list is bad");
    const bool polygon =
        element.name == "face" && (property.name == "vertex_indices" || property.name == "vertex_index");
    if (polygon) builder_.beginPolygon(i + 1);
    for (long long c = 0; c < static_cast<long long>(length); ++c) {
      const double value = next(property.type, element, i);
      if (!polygon) continue;
      if (!(std::abs(value) <= 4294967295.0 && value == std::floor(value)))
        throw InputError(builder_.name(), "face " + std::to_string(i + 1), "a vertex index is not a whole number");
      builder_.corner(static_cast<long long>(value));
    }
    if (polygon) builder_.endPolygon();
  }

  std::string_view data_;
  SurfaceBuilder& builder_;
  TextScanner scan_;
  ByteReader bytes_;
  std::vector<Element> elements_;
  bool text_ = true;
  bool big_endian_ = false;
};

}  // namespace

void readPly(std::string_view data, SurfaceBuilder& builder) { PlyReader(data, builder).read(); }

}  // namespace palpate
