#include <zip.h>

#include <Eigen/Geometry>
#include <charconv>
#include <map>
#include <memory>
#include <pugixml.hpp>

#include "palpate/common/error.h"
#include "palpate/mesh/surface_formats.h"

namespace palpate {
namespace {

// The files of a ZIP archive in memory.
class Archive {
 public:
  Archive(std::string_view data, const std::string& name) : name_(name) {
    zip_error_t error;
    zip_error_init(&error);
    zip_source_t* source = zip_source_buffer_create(data.data(), data.size(), 0, &error);
    zip_t* opened = source != nullptr ? zip_open_from_source(source, ZIP_RDONLY, &error) : nullptr;
    zip_error_fini(&error);
    if (opened == nullptr) {
      if (source != nullptr) zip_source_free(source);
      throw InputError(name_, "", "is no 3MF file, or is truncated: it is no ZIP archive");
    }
    zip_.reset(opened);
  }

  bool has(const std::string& file) const { return zip_name_locate(zip_.get(), file.c_str(), 0) >= 0; }

  std::string read(const std::string& file) const {
    constexpr zip_uint64_t kMost = 1ULL << 30U;
    constexpr zip_uint64_t kMostRatio = 1100;  // of deflate
    zip_stat_t about;
    zip_stat_init(&about);
    if (zip_stat(zip_.get(), file.c_str(), 0, &about) != 0) throw InputError(name_, file, "is missing in it");
    constexpr zip_uint64_t kNeeded = ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD;
    if ((about.valid & kNeeded) != kNeeded || about.size > kMost || about.size / kMostRatio > about.comp_size + 1)
      throw InputError(name_, file, "is larger than the limit of 1 GB, or damaged");
    if (about.comp_method != ZIP_CM_STORE && about.comp_method != ZIP_CM_DEFLATE)
      throw InputError(name_, file, "is compressed in a way that 3MF does not have");
    const std::unique_ptr<zip_file_t, int (*)(zip_file_t*)> opened(zip_fopen(zip_.get(), file.c_str(), 0), zip_fclose);
    std::string out(about.size, '\0');
    const zip_int64_t got = opened ? zip_fread(opened.get(), out.data(), out.size()) : -1;
    char beyond = 0;
    if (got != static_cast<zip_int64_t>(out.size()) || zip_fread(opened.get(), &beyond, 1) != 0)
      throw InputError(name_, file, "is damaged");
    return out;
  }

 private:
  std::string name_;
  std::unique_ptr<zip_t, void (*)(zip_t*)> zip_{nullptr, zip_discard};
};

// Names without what stands before a colon.
std::string_view localName(const char* name) {
  const std::string_view text(name);
  return text.substr(text.find(':') + 1);  // npos + 1: all of it
}
pugi::xml_node childNamed(const pugi::xml_node& node, std::string_view name) {
  return node.find_child([&](const pugi::xml_node& child) { return localName(child.name()) == name; });
}
std::string_view attributeNamed(const pugi::xml_node& node, std::string_view name) {
  for (const pugi::xml_attribute a : node.attributes()) {
    if (localName(a.name()) == name) return a.value();
  }
  return {};
}

// 3MF: the objects that are to be built, in meters.
class ThreeMfReader {
 public:
  ThreeMfReader(std::string_view data, SurfaceBuilder& builder) : builder_(builder), archive_(data, builder.name()) {}

  void read() {
    const std::string root = rootModel();
    Model& model = modelOf(root);
    unit_ = unitOf(root, attributeNamed(model.xml, "unit"));
    const pugi::xml_node build = childNamed(model.xml, "build");
    for (const pugi::xml_node item : build.children()) {
      if (localName(item.name()) != "item") continue;
      addObject(partOf(item, root), std::string(attributeNamed(item, "objectid")), frameOf(item), 0);
    }
  }

 private:
  struct Model {
    pugi::xml_document document;
    pugi::xml_node xml;
    std::map<std::string, pugi::xml_node> objects;
  };

  [[noreturn]] void fail(const std::string& place, const std::string& cause) const {
    throw InputError(builder_.name(), place, cause);
  }

  // The file that the package's relations name, usually 3D/3dmodel.model.
  std::string rootModel() {
    if (archive_.has("_rels/.rels")) {
      pugi::xml_document relations;
      const std::string text = archive_.read("_rels/.rels");
      relations.load_buffer(text.data(), text.size());
      for (const pugi::xml_node r : childNamed(relations, "Relationships").children()) {
        if (std::string_view(r.attribute("Type").value()).ends_with("/3dmodel"))
          return inArchive(r.attribute("Target").value());
      }
    }
    return "3D/3dmodel.model";
  }
  static std::string inArchive(std::string_view path) {
    return std::string(path.starts_with('/') ? path.substr(1) : path);
  }
  // Parts of a package may refer to objects of others.
  static std::string partOf(const pugi::xml_node& node, const std::string& otherwise) {
    const std::string_view path = attributeNamed(node, "path");
    return path.empty() ? otherwise : inArchive(path);
  }

  Model& modelOf(const std::string& part) {
    const auto it = models_.find(part);
    if (it != models_.end()) return it->second;
    Model& model = models_[part];
    const std::string text = archive_.read(part);
    const pugi::xml_parse_result parsed = model.document.load_buffer(text.data(), text.size(), pugi::parse_minimal);
    if (!parsed) fail(part, "XML, byte " + std::to_string(parsed.offset) + ": " + parsed.description());
    model.xml = childNamed(model.document, "model");
    if (!model.xml) fail(part, "holds no model");
    for (const pugi::xml_node object : childNamed(model.xml, "resources").children()) {
      if (localName(object.name()) == "object") model.objects[std::string(attributeNamed(object, "id"))] = object;
    }
    return model;
  }
  double unitOf(const std::string& part, std::string_view name) const {
    static const std::map<std::string_view, double> units = {
        {"", 1e-3},       {"micron", 1e-6}, {"millimeter", 1e-3}, {"centimeter", 1e-2},
        {"inch", 0.0254}, {"foot", 0.3048}, {"meter", 1.0}};
    const auto it = units.find(name);
    if (it == units.end()) fail(part, "has an unknown unit");
    return it->second;
  }

  double number(const pugi::xml_node& node, const char* attribute) const {
    const std::string_view text = node.attribute(attribute).value();
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size())
      fail(std::string(localName(node.name())), std::string(attribute) + " must be a number");
    return value;
  }
  long long index(const pugi::xml_node& node, const char* attribute, long long count) const {
    const std::string_view text = node.attribute(attribute).value();
    long long value = -1;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || value < 0 || value >= count)
      fail("triangle", std::string(attribute) + " must be the number of a vertex, below " + std::to_string(count));
    return value;
  }

  // Twelve numbers: where x, y and z go, and the shift.
  Eigen::Affine3d frameOf(const pugi::xml_node& node) const {
    Eigen::Affine3d frame = Eigen::Affine3d::Identity();
    const std::string_view text = attributeNamed(node, "transform");
    if (text.empty()) return frame;
    const char* at = text.data();
    const char* const end = at + text.size();
    for (int k = 0; k < 12; ++k) {
      while (at < end && (*at == ' ' || *at == '\t' || *at == '\n' || *at == '\r')) ++at;
      double value = 0;
      const auto [after, error] = std::from_chars(at, end, value);
      if (error != std::errc()) fail("transform", "must be twelve numbers");
      frame(k % 3, k / 3) = value;
      at = after;
    }
    return frame;
  }

  void addObject(const std::string& part, const std::string& id, const Eigen::Affine3d& frame, int depth) {
    constexpr int kDeepest = 50, kMostParts = 100'000;
    if (depth > kDeepest || ++parts_ > kMostParts) fail("components", "are nested too deeply, or in a circle");
    Model& model = modelOf(part);
    const auto it = model.objects.find(id);
    if (it == model.objects.end()) fail(part, "there is no object with the id of an item or component");
    const pugi::xml_node object = it->second;
    const std::string_view type = attributeNamed(object, "type");
    if (type == "support" || type == "solidsupport" || type == "other") return;
    for (const pugi::xml_node child : object.children()) {
      if (localName(child.name()) == "mesh") addMesh(child, frame);
      if (localName(child.name()) != "components") continue;
      for (const pugi::xml_node component : child.children()) {
        if (localName(component.name()) != "component") continue;
        addObject(partOf(component, part), std::string(attributeNamed(component, "objectid")),
                  frame * frameOf(component), depth + 1);
      }
    }
  }

  void addMesh(const pugi::xml_node& mesh, const Eigen::Affine3d& frame) {
    const auto first = static_cast<long long>(builder_.vertices());
    const pugi::xml_node triangles = childNamed(mesh, "triangles");
    if (!triangles.first_child()) return;
    for (const pugi::xml_node v : childNamed(mesh, "vertices").children()) {
      if (builder_.vertices() > 3 * static_cast<std::size_t>(kLargestSurface)) fail("vertices", "are too many");
      const Vec3 x(number(v, "x"), number(v, "y"), number(v, "z"));
      builder_.addVertex(unit_ * (frame * x));
    }
    const long long count = static_cast<long long>(builder_.vertices()) - first;
    const bool mirrored = frame.linear().determinant() < 0;
    long long place = 0;
    for (const pugi::xml_node t : triangles.children()) {
      builder_.beginPolygon(++place);
      builder_.corner(first + index(t, "v1", count));
      builder_.corner(first + index(t, mirrored ? "v3" : "v2", count));
      builder_.corner(first + index(t, mirrored ? "v2" : "v3", count));
      builder_.endPolygon();
    }
  }

  SurfaceBuilder& builder_;
  Archive archive_;
  std::map<std::string, Model> models_;
  double unit_ = 1e-3;  // [m]
  int parts_ = 0;
};

}  // namespace

void readThreeMf(std::string_view data, SurfaceBuilder& builder) { ThreeMfReader(data, builder).read(); }

}  // namespace palpate
