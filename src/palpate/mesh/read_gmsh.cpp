#include <optional>

#include "palpate/common/error.h"
#include "palpate/mesh/number_type.h"
#include "palpate/mesh/tetrahedral_formats.h"
#include "palpate/mesh/text_scanner.h"

namespace palpate {
namespace {

struct GmshType {
  CellFamily family;
  int nodes;
};

// By the manual's list of element types; none: there is no such type.
std::optional<GmshType> gmshType(long long type) {
  using enum CellFamily;
  static const std::map<long long, GmshType> types = {
      {1, {flat, 2}},          {2, {flat, 3}},          {3, {flat, 4}},          {4, {tetrahedron, 4}},
      {5, {hexahedron, 8}},    {6, {prism, 6}},         {7, {pyramid, 5}},       {8, {flat, 3}},
      {9, {flat, 6}},          {10, {flat, 9}},         {11, {tetrahedron, 10}}, {12, {hexahedron, 27}},
      {13, {prism, 18}},       {14, {pyramid, 14}},     {15, {flat, 1}},         {16, {flat, 8}},
      {17, {hexahedron, 20}},  {18, {prism, 15}},       {19, {pyramid, 13}},     {20, {flat, 9}},
      {21, {flat, 10}},        {22, {flat, 12}},        {23, {flat, 15}},        {24, {flat, 15}},
      {25, {flat, 21}},        {26, {flat, 4}},         {27, {flat, 5}},         {28, {flat, 6}},
      {29, {tetrahedron, 20}}, {30, {tetrahedron, 35}}, {31, {tetrahedron, 56}}, {92, {hexahedron, 64}},
      {93, {hexahedron, 125}}};
  const auto it = types.find(type);
  return it == types.end() ? std::nullopt : std::optional(it->second);
}

constexpr std::size_t kInt = 4;  // bytes of an int in a binary file

class GmshReader {
 public:
  GmshReader(std::string_view data, const std::string& name, CellCollector& cells)
      : name_(name), scan_(data, name), cells_(cells) {
    scan_.setComment(0);
  }

  void read() {
    while (scan_.nextLine()) {
      const std::string section(scan_.word());
      if (section == "$MeshFormat") {
        readFormat();
      } else if (section == "$NOD" || section == "$ELM") {
        version_ = 1;
        section == "$NOD" ? nodesInLines() : elementsOfVersion1();
      } else if (section == "$Nodes" || section == "$ParametricNodes") {
        requireFormat();
        version_ < 3 ? nodesInLines() : nodesInBlocks();
      } else if (section == "$Elements") {
        requireFormat();
        version_ >= 3 ? elementsInBlocks() : binary_ ? elementsOfVersion2Binary() : elementsOfVersion2();
      } else if (binary_ && section.starts_with('$') && !section.starts_with("$End")) {
        scan_.skipPast("$End" + section.substr(1));
      }
    }
    if (version_ == 0)
      throw InputError(name_, "", "is no Gmsh mesh: it has neither a section $MeshFormat nor $NOD and $ELM");
  }

 private:
  void requireFormat() const {
    if (version_ == 0) scan_.fail("the section $MeshFormat is missing");
  }

  void readFormat() {
    version_ = scan_.anyNumber("the version");
    const long long kind = scan_.integer("the file type");
    const long long size = scan_.integer("the data size");
    if (!(version_ >= 2 && version_ < 3) && version_ != 4.0 && version_ != 4.1)
      scan_.fail("versions 1, 2, 4.0 and 4.1 of the format are read, not this one");
    if (kind != 0 && kind != 1) scan_.fail("the file type must be 0 (text) or 1 (binary)");
    binary_ = kind == 1;
    if (!binary_) return;
    if (size != 8 && !(size == 4 && version_ == 4.1)) scan_.fail("the data size must be 8");
    if (version_ == 4.1) number_bytes_ = count_bytes_ = static_cast<std::size_t>(size);
    ByteReader one(scan_.bytes(kInt), false);
    std::uint32_t number = 0;
    one.take(number);
    if (number != 1 && number != 0x01000000U) scan_.fail("the 1 that tells the order of bytes is missing");
    big_endian_ = number != 1;
  }

  // A whole number of that many bytes, or in text.
  long long whole(std::size_t bytes, const char* wanted) {
    if (!binary_) return scan_.anyInteger(wanted);
    ByteReader reader(scan_.bytes(bytes), big_endian_);
    long long value = 0;
    takeNumber(reader, bytes == kInt ? NumberType::i32 : NumberType::i64, value);
    return value;
  }
  double real(const char* wanted) {
    if (!binary_) return scan_.anyNumber(wanted);
    ByteReader reader(scan_.bytes(sizeof(double)), big_endian_);
    double value = 0;
    reader.take(value);
    return value;
  }
  Vec3 point() {
    const double x = real("x");
    const double y = real("y");
    const double z = real("z");
    return {x, y, z};
  }

  // Versions 1 and 2: the number of nodes, then one after the other.
  void nodesInLines() {
    const long long count = scan_.anyInteger("the number of nodes");
    for (long long i = 0; i < count; ++i) {
      const long long number = whole(number_bytes_, "a node's number");
      cells_.node(number, point());
      if (!binary_) scan_.skipRestOfLine();
    }
  }

  void elementsOfVersion1() {
    const long long count = scan_.anyInteger("the number of elements");
    for (long long i = 0; i < count; ++i) {
      scan_.anyInteger("an element's number");
      const long long type = scan_.integer("an element's type");
      scan_.integer("a physical entity");
      scan_.integer("an elementary entity");
      scan_.integer("the number of nodes");
      element(type);
    }
  }

  void elementsOfVersion2() {
    const long long count = scan_.anyInteger("the number of elements");
    for (long long i = 0; i < count; ++i) {
      scan_.anyInteger("an element's number");
      const long long type = scan_.integer("an element's type");
      const long long tags = scan_.integer("the number of tags");
      for (long long k = 0; k < tags; ++k) scan_.integer("a tag");
      element(type);
    }
  }

  void elementsOfVersion2Binary() {
    const long long count = scan_.anyInteger("the number of elements");
    for (long long i = 0; i < count;) {
      const long long type = whole(kInt, "");
      const long long here = whole(kInt, "");
      const long long tags = whole(kInt, "");
      if (here < 1) scan_.fail("a group of elements is empty");
      for (long long k = 0; k < here; ++k) {
        for (long long t = 0; t <= tags; ++t) whole(kInt, "");  // its number first
        element(type);
      }
      i += here;
    }
  }

  // Version 4: entities, each with its nodes.
  void nodesInBlocks() {
    const bool newer = version_ == 4.1;
    const long long blocks = whole(count_bytes_, "the number of blocks");
    whole(count_bytes_, "the number of nodes");
    if (newer) skipExtremes();
    for (long long b = 0; b < blocks; ++b) {
      const long long first = whole(kInt, "an entity");
      const long long second = whole(kInt, "an entity");
      const long long parametric = whole(kInt, "whether nodes are parametric");
      const long long count = whole(count_bytes_, "the number of nodes");
      const long long parameters = parametric != 0 ? (newer ? first : second) : 0;
      newer ? nodesByNumbers(count, parameters) : nodesOneByOne(count, parameters);
    }
  }
  void nodesByNumbers(long long count, long long parameters) {
    std::vector<long long> numbers;
    for (long long i = 0; i < count; ++i) numbers.push_back(whole(number_bytes_, "a node's number"));
    for (const long long number : numbers) nodeWith(number, parameters);
  }
  void nodesOneByOne(long long count, long long parameters) {
    for (long long i = 0; i < count; ++i) nodeWith(whole(number_bytes_, "a node's number"), parameters);
  }
  void nodeWith(long long number, long long parameters) {
    cells_.node(number, point());
    for (long long k = 0; k < parameters; ++k) real("a parameter");
  }
  void skipExtremes() {
    whole(number_bytes_, "the least number");
    whole(number_bytes_, "the largest number");
  }

  void elementsInBlocks() {
    const long long blocks = whole(count_bytes_, "the number of blocks");
    whole(count_bytes_, "the number of elements");
    if (version_ == 4.1) skipExtremes();
    for (long long b = 0; b < blocks; ++b) {
      whole(kInt, "an entity");
      whole(kInt, "an entity");
      const long long type = whole(kInt, "an element's type");
      const long long count = whole(count_bytes_, "the number of elements");
      for (long long i = 0; i < count; ++i) {
        whole(number_bytes_, "an element's number");
        element(type);
      }
    }
  }

  // The nodes of an element, which its type counts; in text the line ends with them.
  void element(long long type) {
    const std::optional<GmshType> known = gmshType(type);
    if (!known && binary_) scan_.fail("there is no element type " + std::to_string(type));
    numbers_.clear();
    if (known && (binary_ || known->family == CellFamily::tetrahedron)) {
      for (int k = 0; k < known->nodes; ++k) numbers_.push_back(whole(number_bytes_, "a node"));
    }
    cells_.cell(known ? known->family : CellFamily::unknown, numbers_);
    if (!binary_) scan_.skipRestOfLine();
  }

  std::string name_;
  TextScanner scan_;
  CellCollector& cells_;
  double version_ = 0;  // 0: not known yet
  bool binary_ = false, big_endian_ = false;
  std::size_t number_bytes_ = kInt;  // of the number of a node or element, in a binary file
  std::size_t count_bytes_ = 8;      // of how many there are, from version 4 on
  std::vector<long long> numbers_;
};

}  // namespace

void readGmshCells(std::string_view data, const std::string& name, CellCollector& cells) {
  GmshReader(data, name, cells).read();
}

}  // namespace palpate
