#include <zlib.h>

#include <charconv>
#include <cmath>
#include <optional>
#include <pugixml.hpp>

#include "palpate/common/error.h"
#include "palpate/mesh/base64.h"
#include "palpate/mesh/number_type.h"
#include "palpate/mesh/tetrahedral_formats.h"

namespace palpate {
namespace {

std::optional<NumberType> vtuTypeNamed(std::string_view name) {
  static const std::map<std::string_view, NumberType> types = {
      {"Int8", NumberType::i8},    {"UInt8", NumberType::u8},   {"Int16", NumberType::i16},
      {"UInt16", NumberType::u16}, {"Int32", NumberType::i32},  {"UInt32", NumberType::u32},
      {"Int64", NumberType::i64},  {"UInt64", NumberType::u64}, {"Float32", NumberType::f32},
      {"Float64", NumberType::f64}};
  const auto it = types.find(name);
  return it == types.end() ? std::nullopt : std::optional(it->second);
}

constexpr long long kMostNumbers = 1LL << 32;  // in an array

// Bytes of an array as they stand in the file: themselves, or as base64.
class StoredBytes {
 public:
  StoredBytes(std::string_view text, bool base64) : raw_(text), decoder_(text), base64_(base64) {}
  // false: there are fewer
  bool take(std::size_t count, std::string& out) {
    if (base64_) return count / 4 <= raw_.size() / 3 && decoder_.take(count, out);
    if (count > raw_.size()) return false;
    out.append(raw_.substr(0, count));
    raw_.remove_prefix(count);
    return true;
  }
  std::size_t most() const { return raw_.size(); }

 private:
  std::string_view raw_;
  Base64Reader decoder_;
  bool base64_;
};

class VtuReader {
 public:
  VtuReader(std::string_view data, const std::string& name, CellCollector& cells) : name_(name), cells_(cells) {
    cutAppended(data);
    const pugi::xml_parse_result parsed =
        document_.load_buffer(xml_.data(), xml_.size(), pugi::parse_minimal | pugi::parse_cdata);
    if (!parsed)
      throw InputError(name_, "byte " + std::to_string(parsed.offset), std::string("XML: ") + parsed.description());
  }

  void read() {
    const pugi::xml_node file = document_.child("VTKFile");
    if (!file) fail("VTKFile", "is missing: this is no VTK file");
    readSettings(file);
    const pugi::xml_node grid = file.child("UnstructuredGrid");
    if (!grid) fail("VTKFile", "tetrahedra are in an UnstructuredGrid only, not in " + quoted(file.attribute("type")));
    if (!grid.child("Piece")) fail("UnstructuredGrid", "has no Piece");
    for (const pugi::xml_node piece : grid.children("Piece")) readPiece(piece);
  }

 private:
  [[noreturn]] void fail(const std::string& place, const std::string& cause) const {
    throw InputError(name_, place, cause);
  }
  static std::string quoted(const pugi::xml_attribute& attribute) {
    std::string text = "'";
    for (const char c : std::string_view(attribute.value()).substr(0, 40)) text += c >= ' ' && c <= '~' ? c : '?';
    return text + "'";
  }

  // Raw appended data is no XML: it is cut off, and the file closed before it.
  void cutAppended(std::string_view data) {
    const std::size_t begin = data.find("<AppendedData");
    const std::size_t tag_end = begin == std::string_view::npos ? begin : data.find('>', begin);
    if (tag_end == std::string_view::npos) {
      xml_ = data;
      return;
    }
    xml_ = std::string(data.substr(0, begin)) + "</VTKFile>";
    const std::string_view tag = data.substr(begin, tag_end - begin);
    appended_base64_ = tag.find("base64") != std::string_view::npos;
    const std::size_t mark = data.find('_', tag_end);
    if (mark == std::string_view::npos) return;
    appended_ = data.substr(mark + 1);
    // raw data may hold anything, but the end of the file is the element's
    const std::size_t end = appended_.rfind("</AppendedData");
    if (end != std::string_view::npos) appended_ = appended_.substr(0, end);
  }

  void readSettings(const pugi::xml_node& file) {
    const std::string_view order = file.attribute("byte_order").as_string("LittleEndian");
    if (order != "LittleEndian" && order != "BigEndian")
      fail("VTKFile", "byte_order must be LittleEndian or BigEndian, not " + quoted(file.attribute("byte_order")));
    big_endian_ = order == "BigEndian";
    const std::string_view header = file.attribute("header_type").as_string("UInt32");
    if (header != "UInt32" && header != "UInt64")
      fail("VTKFile", "header_type must be UInt32 or UInt64, not " + quoted(file.attribute("header_type")));
    header_ = header == "UInt64" ? NumberType::u64 : NumberType::u32;
    const std::string_view compressor = file.attribute("compressor").as_string();
    compressed_ = !compressor.empty();
    if (compressed_ && compressor != "vtkZLibDataCompressor")
      fail("VTKFile", "data compressed by " + quoted(file.attribute("compressor")) +
                          " are not read: save with zlib, or without compression");
  }

  long long countOf(const pugi::xml_node& piece, const char* attribute) const {
    const std::string_view text = piece.attribute(attribute).as_string();
    long long count = -1;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), count);
    if (error != std::errc() || end != text.data() + text.size() || count < 0 || count > kMostNumbers)
      fail("Piece", std::string(attribute) + " must be a number of them, not " + quoted(piece.attribute(attribute)));
    return count;
  }

  void readPiece(const pugi::xml_node& piece) {
    const long long points = countOf(piece, "NumberOfPoints");
    const long long cells = countOf(piece, "NumberOfCells");
    readPoints(piece.child("Points").child("DataArray"), points);
    const std::vector<long long> ends = wholeNumbers(arrayOf(piece, "offsets"), cells, "offsets");
    const std::vector<long long> types = wholeNumbers(arrayOf(piece, "types"), cells, "types");
    long long before = 0;
    for (const long long end : ends) {
      if (end < before || end > kMostNumbers) fail("offsets", "do not increase, or are out of range");
      before = end;
    }
    const std::vector<long long> corners = wholeNumbers(arrayOf(piece, "connectivity"), before, "connectivity");
    std::vector<long long> nodes;
    for (std::size_t i = 0; i < ends.size(); ++i) {
      nodes.assign(corners.begin() + (i > 0 ? ends[i - 1] : 0), corners.begin() + ends[i]);
      for (long long& node : nodes) {
        if (node < 0 || node >= points)
          fail("cell " + std::to_string(i),
               "there is no point " + std::to_string(node) + " among " + std::to_string(points));
        node += first_point_;
      }
      cells_.cell(vtkFamily(types[i]), nodes);
    }
    first_point_ += points;
  }

  void readPoints(const pugi::xml_node& array, long long points) {
    if (points == 0) return;
    if (!array) fail("Points", "is missing");
    if (array.attribute("NumberOfComponents").as_string("3") != std::string_view("3"))
      fail("Points", "must have three components, not " + quoted(array.attribute("NumberOfComponents")));
    const std::vector<double> x = numbers<double>(array, 3 * points, "Points");
    for (long long i = 0; i < points; ++i) {
      const Vec3 p = Eigen::Map<const Vec3>(x.data() + 3 * i);
      if (!p.allFinite()) fail("point " + std::to_string(i), "a coordinate is not finite");
      cells_.node(first_point_ + i, p);
    }
  }

  pugi::xml_node arrayOf(const pugi::xml_node& piece, const char* name) const {
    return piece.child("Cells").find_child_by_attribute("DataArray", "Name", name);
  }
  std::vector<long long> wholeNumbers(const pugi::xml_node& array, long long count, const char* place) {
    if (count == 0) return {};
    if (!array) fail("Cells", std::string("the array ") + place + " is missing");
    return numbers<long long>(array, count, place);
  }

  template <class Number>
  std::vector<Number> numbers(const pugi::xml_node& array, long long count, const char* place) {
    const std::optional<NumberType> type = vtuTypeNamed(array.attribute("type").as_string());
    if (!type) fail(place, "unknown type " + quoted(array.attribute("type")));
    if (std::is_same_v<Number, long long> && !isWhole(*type)) fail(place, "must be of a type of whole numbers");
    const std::string_view format = array.attribute("format").as_string("ascii");
    if (format == "ascii") return fromText<Number>(array.child_value(), count, place);
    std::string bytes;
    if (format == "binary") {
      bytes = decoded({array.child_value(), true}, static_cast<std::size_t>(count) * bytesOf(*type), place);
    } else if (format == "appended") {
      const long long offset = countOf(array, "offset");
      if (static_cast<unsigned long long>(offset) > appended_.size()) fail(place, "the file is truncated before it");
      bytes = decoded({appended_.substr(static_cast<std::size_t>(offset)), appended_base64_},
                      static_cast<std::size_t>(count) * bytesOf(*type), place);
    } else {
      fail(place, "unknown format " + quoted(array.attribute("format")));
    }
    std::vector<Number> out(static_cast<std::size_t>(count));
    ByteReader reader(bytes, big_endian_);
    for (Number& value : out) takeNumber(reader, *type, value);
    return out;
  }

  template <class Number>
  std::vector<Number> fromText(std::string_view text, long long count, const char* place) {
    std::vector<Number> out;
    const char* at = text.data();
    const char* const end = text.data() + text.size();
    const auto space = [](char c) { return c == ' ' || c == '\n' || c == '\t' || c == '\r'; };
    while (static_cast<long long>(out.size()) < count) {
      while (at < end && space(*at)) ++at;
      if (at == end)
        fail(place, "ends after " + std::to_string(out.size()) + " of " + std::to_string(count) + " numbers");
      Number value{};
      const auto [after, error] = std::from_chars(at, end, value);
      const bool tiny = error == std::errc::result_out_of_range && std::is_same_v<Number, double> &&
                        std::string_view(at, static_cast<std::size_t>(after - at)).find("e-") != std::string_view::npos;
      if ((error != std::errc() && !tiny) || (after < end && !space(*after)))
        fail(place, "number " + std::to_string(out.size() + 1) + " cannot be read");
      out.push_back(value);
      at = after;
    }
    return out;
  }

  // What was stored, of which the size is known.
  std::string decoded(StoredBytes stored, std::size_t wanted, const char* place) {
    return compressed_ ? inflated(stored, wanted, place) : plain(stored, wanted, place);
  }

  std::uint64_t headerNumber(StoredBytes& stored, const char* place) {
    std::string bytes;
    if (!stored.take(bytesOf(header_), bytes)) fail(place, "the file is truncated in it, or it is damaged");
    return headerNumber(bytes, 0);
  }
  std::uint64_t headerNumber(const std::string& bytes, std::size_t index) const {
    ByteReader reader(std::string_view(bytes).substr(index * bytesOf(header_)), big_endian_);
    long long value = 0;
    takeNumber(reader, header_, value);
    return static_cast<std::uint64_t>(value);
  }

  std::string plain(StoredBytes& stored, std::size_t wanted, const char* place) {
    const std::uint64_t size = headerNumber(stored, place);
    if (size != wanted) failSize(place, size, wanted);
    std::string out;
    if (!stored.take(wanted, out)) fail(place, "the file is truncated in it, or it is damaged");
    return out;
  }
  [[noreturn]] void failSize(const char* place, std::uint64_t size, std::size_t wanted) const {
    fail(place, "holds " + std::to_string(size) + " bytes, and should hold " + std::to_string(wanted));
  }

  // Header: number of blocks, size of each, of the last if it is smaller, sizes compressed. Then the blocks.
  std::string inflated(StoredBytes& stored, std::size_t wanted, const char* place) {
    constexpr std::uint64_t kMostRatio = 1100;  // of zlib
    constexpr std::uint64_t kMostBytes = 1ULL << 32U;
    std::string header;
    if (!stored.take(3 * bytesOf(header_), header)) fail(place, "the file is truncated in it, or it is damaged");
    const std::uint64_t blocks = headerNumber(header, 0);
    const std::uint64_t size = headerNumber(header, 1);
    const std::uint64_t last = headerNumber(header, 2);
    const std::uint64_t most = static_cast<std::uint64_t>(stored.most()) * kMostRatio;
    if (blocks > stored.most() || size > most || last > size || (blocks > 0 && size > most / blocks))
      fail(place, "its header is damaged");
    const std::uint64_t total = blocks == 0 ? 0 : last > 0 ? (blocks - 1) * size + last : blocks * size;
    if (total != wanted) failSize(place, total, wanted);
    if (total > kMostBytes) fail(place, "is larger than the limit of 4 GB");
    std::string sizes;
    if (!stored.take(blocks * bytesOf(header_), sizes)) fail(place, "the file is truncated in it, or it is damaged");
    std::string out(wanted, '\0'), block;
    std::size_t at = 0;
    for (std::size_t b = 0; b < blocks; ++b) {
      block.clear();
      if (!stored.take(headerNumber(sizes, b), block)) fail(place, "the file is truncated in it, or it is damaged");
      const std::size_t here = b + 1 == blocks && last > 0 ? last : size;
      uLongf length = here;
      const int result = uncompress(reinterpret_cast<Bytef*>(out.data() + at), &length,
                                    reinterpret_cast<const Bytef*>(block.data()), block.size());
      if (result != Z_OK || length != here) fail(place, "its compressed data are damaged");
      at += here;
    }
    return out;
  }

  std::string name_;
  CellCollector& cells_;
  std::string xml_;
  std::string_view appended_;
  bool appended_base64_ = false, big_endian_ = false, compressed_ = false;
  NumberType header_ = NumberType::u32;
  pugi::xml_document document_;
  long long first_point_ = 0;  // of the present piece, among all
};

}  // namespace

void readVtuCells(std::string_view data, const std::string& name, CellCollector& cells) {
  VtuReader(data, name, cells).read();
}

}  // namespace palpate
