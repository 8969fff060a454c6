#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <unordered_map>

#include "palpate/common/error.h"
#include "palpate/mesh/base64.h"
#include "palpate/mesh/number_type.h"
#include "palpate/mesh/surface_formats.h"
#include "palpate/mesh/text_scanner.h"

namespace palpate {
namespace {

using GltfJson = nlohmann::json;

// Numbers of an accessor, as they stand in a buffer.
struct GltfView {
  std::string_view bytes;
  std::size_t stride = 0, count = 0;
  NumberType type = NumberType::f32;
  bool normalized = false;
  std::string_view at(std::size_t i) const { return bytes.substr(i * stride); }
};

// glTF 2.0: the triangles of the default scene, in its own meters, z up.
class GltfReader {
 public:
  GltfReader(std::string_view data, SurfaceBuilder& builder, const std::string& folder)
      : builder_(builder), folder_(folder) {
    std::string_view text = data;
    if (data.starts_with("glTF")) text = splitBinary(data);
    root_ = GltfJson::parse(text, nullptr, false);
    if (!root_.is_object())
      fail("", data.starts_with("glTF") ? "its JSON is damaged" : "is no glTF file: it is no JSON");
  }

  void read() {
    const std::string version = textOf(member(root_, "asset"), "version");
    if (!version.starts_with("2"))
      fail("asset.version", "version 2 of the format is read, not '" + shown(version) + "'");
    requireExtensions();
    Eigen::Affine3d upright = Eigen::Affine3d::Identity();  // y is up in the file
    upright.linear() << 1, 0, 0, 0, 0, -1, 0, 1, 0;
    for (const std::size_t node : topNodes()) waiting_.push_back({node, upright});
    visited_.assign(listOf("nodes").size(), 0);
    while (!waiting_.empty()) {
      const auto [node, frame] = waiting_.back();
      waiting_.pop_back();
      readNode(node, frame);
    }
  }

 private:
  [[noreturn]] void fail(const std::string& place, const std::string& cause) const {
    throw InputError(builder_.name(), place, cause);
  }
  static std::string shown(const std::string& text) {
    std::string out;
    for (const char c : text.substr(0, 60)) out += c >= ' ' && c <= '~' ? c : '?';
    return out;
  }

  // --- JSON; what is missing or of another kind is as if it were not there, unless it is needed

  static const GltfJson& member(const GltfJson& object, const char* key) {
    static const GltfJson none;
    if (!object.is_object()) return none;
    const auto it = object.find(key);
    return it == object.end() ? none : *it;
  }
  static std::string textOf(const GltfJson& object, const char* key) {
    const GltfJson& value = member(object, key);
    return value.is_string() ? value.get<std::string>() : std::string();
  }
  const GltfJson& listOf(const char* key) const {
    static const GltfJson empty = GltfJson::array();
    const GltfJson& value = member(root_, key);
    return value.is_array() ? value : empty;
  }
  std::optional<std::size_t> wholeOf(const GltfJson& object, const char* key) const {
    const GltfJson& value = member(object, key);
    if (value.is_null()) return std::nullopt;
    if (!value.is_number_integer() || (!value.is_number_unsigned() && value.get<std::int64_t>() < 0))
      fail(key, "must be a whole number, not negative");
    return value.get<std::size_t>();
  }
  std::size_t wholeOf(const GltfJson& object, const char* key, std::size_t otherwise) const {
    return wholeOf(object, key).value_or(otherwise);
  }
  const GltfJson& item(const char* list, std::size_t index) const {
    const GltfJson& items = listOf(list);
    if (index >= items.size()) fail(list, "there is no number " + std::to_string(index));
    return items[index];
  }
  std::vector<double> numbersOf(const GltfJson& object, const char* key, std::size_t count) const {
    const GltfJson& value = member(object, key);
    if (value.is_null()) return {};
    std::vector<double> out;
    if (value.is_array()) {
      for (const GltfJson& v : value) out.push_back(v.is_number() ? v.get<double>() : std::nan(""));
    }
    bool good = out.size() == count;
    for (const double v : out) good = good && std::isfinite(v);
    if (!good) fail(key, "must be " + std::to_string(count) + " numbers");
    return out;
  }

  // --- parts of the file

  // GLB: a header of 12 bytes, then chunks {bytes, kind, content}: JSON first, then the first buffer.
  std::string_view splitBinary(std::string_view data) {
    ByteReader reader(data.substr(4), false);
    std::uint32_t version = 0, length = 0;
    if (!reader.take(version) || !reader.take(length)) fail("", "is truncated");
    if (version != 2) fail("", "version 2 of the format is read, not " + std::to_string(version));
    if (length > data.size())
      fail("", "is truncated: its header promises " + std::to_string(length) + " bytes, and there are " +
                   std::to_string(data.size()));
    std::string_view text;
    std::string_view rest = data.substr(12);
    for (int chunk = 0; chunk < 2 && rest.size() >= 8; ++chunk) {
      ByteReader head(rest, false);
      std::uint32_t bytes = 0, kind = 0;
      head.take(bytes);
      head.take(kind);
      if (bytes > rest.size() - 8) fail("", "is truncated in a chunk");
      (chunk == 0 ? text : binary_) = rest.substr(8, bytes);
      rest.remove_prefix(8 + bytes);
    }
    return text;
  }

  void requireExtensions() const {
    for (const GltfJson& name : listOf("extensionsRequired")) {
      const std::string text = name.is_string() ? name.get<std::string>() : "";
      const bool harmless = text.starts_with("KHR_materials_") || text.starts_with("KHR_texture_") ||
                            text.starts_with("KHR_lights") || text == "KHR_mesh_quantization" ||
                            text.starts_with("EXT_texture_");
      if (!harmless) fail("extensionsRequired", "the extension '" + shown(text) + "' is not read: save without it");
    }
  }

  // Of the default scene; without scenes those that are nobody's children.
  std::vector<std::size_t> topNodes() const {
    const GltfJson& scenes = listOf("scenes");
    if (!scenes.empty()) return indices(item("scenes", wholeOf(root_, "scene", 0)), "nodes");
    const GltfJson& nodes = listOf("nodes");
    std::vector<char> child(nodes.size(), 0);
    for (const GltfJson& node : nodes) {
      for (const std::size_t c : indices(node, "children")) {
        if (c < child.size()) child[c] = 1;
      }
    }
    std::vector<std::size_t> out;
    for (std::size_t i = 0; i < child.size(); ++i) {
      if (child[i] == 0) out.push_back(i);
    }
    return out;
  }
  std::vector<std::size_t> indices(const GltfJson& object, const char* key) const {
    std::vector<std::size_t> out;
    const GltfJson& value = member(object, key);
    if (!value.is_array()) return out;
    for (const GltfJson& v : value) {
      if (!v.is_number_unsigned()) fail(key, "must be whole numbers, not negative");
      out.push_back(v.get<std::size_t>());
    }
    return out;
  }

  void readNode(std::size_t index, const Eigen::Affine3d& parent) {
    const GltfJson& node = item("nodes", index);
    if (visited_[index] != 0) fail("nodes", "number " + std::to_string(index) + " has two parents, or is its own");
    visited_[index] = 1;
    const Eigen::Affine3d frame = parent * placeOf(node);
    if (const auto mesh = wholeOf(node, "mesh")) readMesh(*mesh, frame);
    for (const std::size_t child : indices(node, "children")) waiting_.push_back({child, frame});
  }

  Eigen::Affine3d placeOf(const GltfJson& node) const {
    Eigen::Affine3d place = Eigen::Affine3d::Identity();
    if (const auto m = numbersOf(node, "matrix", 16); !m.empty()) {
      for (int column = 0; column < 4; ++column) {
        for (int row = 0; row < 3; ++row) place(row, column) = m[static_cast<std::size_t>(4 * column + row)];
      }
      return place;
    }
    if (const auto t = numbersOf(node, "translation", 3); !t.empty()) place.translate(Vec3(t[0], t[1], t[2]));
    if (const auto q = numbersOf(node, "rotation", 4); !q.empty()) {
      const Quat turn(q[3], q[0], q[1], q[2]);
      if (!(turn.norm() > 1e-6)) fail("rotation", "must be a unit quaternion");
      place.rotate(turn.normalized());
    }
    if (const auto s = numbersOf(node, "scale", 3); !s.empty()) place.scale(Vec3(s[0], s[1], s[2]));
    return place;
  }

  void readMesh(std::size_t index, const Eigen::Affine3d& frame) {
    const GltfJson& primitives = member(item("meshes", index), "primitives");
    if (!primitives.is_array()) return;
    for (const GltfJson& primitive : primitives) {
      const std::size_t mode = wholeOf(primitive, "mode", 4);
      const auto positions = wholeOf(member(primitive, "attributes"), "POSITION");
      if (mode < 4 || mode > 6 || !positions) continue;  // points and lines
      readTriangles(primitive, view(*positions, 3), static_cast<int>(mode), frame);
    }
  }

  // Modes 4, 5, 6: triangles, strip, fan. Only vertices that a triangle has are taken.
  void readTriangles(const GltfJson& primitive, const GltfView& positions, int mode, const Eigen::Affine3d& frame) {
    const auto indices_at = wholeOf(primitive, "indices");
    const std::optional<GltfView> indices = indices_at ? std::optional(view(*indices_at, 1)) : std::nullopt;
    if (indices && !isWhole(indices->type)) fail("indices", "must be whole numbers");
    const std::size_t corners = indices ? indices->count : positions.count;
    std::unordered_map<std::size_t, long long> taken;
    const bool mirrored = frame.linear().determinant() < 0;
    const auto corner = [&](std::size_t i) {
      const std::size_t vertex = indices ? wholeAt(*indices, i) : i;
      if (vertex >= positions.count) fail("indices", "there is no vertex " + std::to_string(vertex));
      const auto [it, fresh] = taken.try_emplace(vertex, static_cast<long long>(builder_.vertices()));
      if (fresh) builder_.addVertex(frame * pointAt(positions, vertex));
      return it->second;
    };
    for (std::size_t i = 2; i < corners; i += mode == 4 ? 3 : 1) {
      const bool swapped = (mode == 5 && i % 2 == 1) != mirrored;
      const std::size_t first = mode == 6 ? 0 : i - 2;
      builder_.beginPolygon(static_cast<long long>(i) / (mode == 4 ? 3 : 1));
      builder_.corner(corner(first));
      builder_.corner(corner(swapped ? i : i - 1));
      builder_.corner(corner(swapped ? i - 1 : i));
      builder_.endPolygon();
    }
  }

  static std::size_t wholeAt(const GltfView& view, std::size_t i) {
    ByteReader reader(view.at(i), false);
    long long value = 0;
    takeNumber(reader, view.type, value);
    return static_cast<std::size_t>(value);
  }
  static Vec3 pointAt(const GltfView& view, std::size_t i) {
    ByteReader reader(view.at(i), false);
    Vec3 x;
    for (int d = 0; d < 3; ++d) takeNumber(reader, view.type, x[d]);
    if (!view.normalized || !isWhole(view.type)) return x;
    const double largest = withNumber(
        view.type, [](auto zero) { return static_cast<double>(std::numeric_limits<decltype(zero)>::max()); });
    return (x / largest).cwiseMax(-1.0);
  }

  static std::optional<NumberType> componentType(std::size_t number) {
    switch (number) {
      case 5120:
        return NumberType::i8;
      case 5121:
        return NumberType::u8;
      case 5122:
        return NumberType::i16;
      case 5123:
        return NumberType::u16;
      case 5125:
        return NumberType::u32;
      case 5126:
        return NumberType::f32;
      default:
        return std::nullopt;
    }
  }

  GltfView view(std::size_t index, std::size_t components) {
    const GltfJson& accessor = item("accessors", index);
    if (textOf(accessor, "type") != (components == 3 ? "VEC3" : "SCALAR"))
      fail("accessors",
           "number " + std::to_string(index) + " must be of type " + (components == 3 ? "VEC3" : "SCALAR"));
    if (!member(accessor, "sparse").is_null()) fail("accessors", "sparse ones are not read");
    const auto type = componentType(wholeOf(accessor, "componentType", 0));
    if (!type) fail("accessors", "number " + std::to_string(index) + " has an unknown componentType");
    const auto view_index = wholeOf(accessor, "bufferView");
    if (!view_index) fail("accessors", "number " + std::to_string(index) + " has no data");
    const GltfJson& buffer_view = item("bufferViews", *view_index);
    const std::string_view buffer = bufferBytes(wholeOf(buffer_view, "buffer", 0));
    const std::string_view part =
        cut(buffer, wholeOf(buffer_view, "byteOffset", 0), wholeOf(buffer_view, "byteLength", 0), *view_index);
    GltfView out;
    out.type = *type;
    out.normalized = member(accessor, "normalized") == true;
    out.count = wholeOf(accessor, "count", 0);
    const std::size_t size = components * bytesOf(*type);
    out.stride = wholeOf(buffer_view, "byteStride", size);
    const std::size_t offset = wholeOf(accessor, "byteOffset", 0);
    const bool fits = out.stride >= size && offset <= part.size() &&
                      (out.count == 0 ||
                       (part.size() - offset >= size && (part.size() - offset - size) / out.stride >= out.count - 1));
    if (!fits) fail("accessors", "number " + std::to_string(index) + " goes beyond its data");
    out.bytes = part.substr(offset);
    return out;
  }
  std::string_view cut(std::string_view buffer, std::size_t offset, std::size_t length, std::size_t index) const {
    if (offset > buffer.size() || length > buffer.size() - offset)
      fail("bufferViews", "number " + std::to_string(index) + " goes beyond its buffer: the file may be truncated");
    return buffer.substr(offset, length);
  }

  std::string_view bufferBytes(std::size_t index) {
    if (const auto it = buffers_.find(index); it != buffers_.end()) return it->second;
    const GltfJson& buffer = item("buffers", index);
    if (member(buffer, "uri").is_null()) {
      if (index != 0 || binary_.empty()) fail("buffers", "number " + std::to_string(index) + " has no data");
      return binary_;
    }
    return buffers_[index] = fetched(textOf(buffer, "uri"));
  }
  std::string fetched(const std::string& uri) const {
    if (uri.starts_with("data:")) {
      const std::size_t comma = uri.find(";base64,");
      std::string out;
      if (comma == std::string::npos || !Base64Reader(std::string_view(uri).substr(comma + 8)).takeAll(out))
        fail("buffers", "its data are no base64");
      return out;
    }
    const std::filesystem::path file(uri);
    bool inside = !uri.empty() && file.is_relative() && uri.find(':') == std::string::npos;
    for (const auto& part : file) inside = inside && part != "..";
    if (!inside) fail("buffers", "'" + shown(uri) + "' is no file beside it");
    if (folder_.empty()) fail("buffers", "its data are in another file, '" + shown(uri) + "': save as .glb");
    return readFile((std::filesystem::path(folder_) / file).string());
  }

  SurfaceBuilder& builder_;
  std::string folder_;  // of other files; empty: there are none
  GltfJson root_;
  std::string_view binary_;
  std::map<std::size_t, std::string> buffers_;
  struct Waiting {
    std::size_t node;
    Eigen::Affine3d frame;
  };
  std::vector<Waiting> waiting_;
  std::vector<char> visited_;
};

}  // namespace

void readGltf(std::string_view data, SurfaceBuilder& builder, const std::string& folder) {
  GltfReader(data, builder, folder).read();
}

}  // namespace palpate
