#include "palpate/scene/save.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <stdexcept>
#include <vector>

#include "palpate/common/error.h"
#include "palpate/scene/checks.h"
#include "palpate/scene/document.h"
#include "palpate/scene/reader.h"

namespace palpate {
namespace {

using Kind = DocumentNode::Kind;
using Pointer = DocumentNode::Pointer;
using Path = std::vector<std::string>;
using PlaceFile = std::function<std::string(const std::string& file)>;

constexpr int kDeepest = 64;  // an alias may lead deeper than a document goes

// Writing
// ------------------------------------------------------------------------------------------------------------

/// Without quotation marks where the text can be nothing else.
std::string scalarText(const std::string& text) {
  const auto plain = [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '_' || c == '.' || c == '+' || c == '-' || c == '/';
  };
  const bool word = std::any_of(text.begin(), text.end(), [](unsigned char c) { return std::isalnum(c) != 0; });
  const bool null = text == "null" || text == "Null" || text == "NULL";
  if (word && !null && std::all_of(text.begin(), text.end(), plain)) return text;
  std::string out = "\"";
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (c == '\n') {
      out += "\\n";
    } else if (byte < 0x20 || byte == 0x7f) {
      out += fmt::format("\\x{:02x}", byte);
    } else {
      out += c;
    }
  }
  return out + '"';
}

class Writer {
 public:
  explicit Writer(std::string name) : name_(std::move(name)) {}

  std::string document(const DocumentNode& root) const { return block(root, 0); }

 private:
  [[noreturn]] void fail() const { throw InputError(name_, "", "is too large or too deep to be saved"); }

  void check(const std::string& text, int depth) const {
    if (depth > kDeepest || text.size() > DocumentLimits{}.bytes) fail();
  }

  /// On one line; nothing where that would be longer than `longest`.
  bool flow(const DocumentNode& node, std::size_t longest, int depth, std::string& out) const {
    check(out, depth);
    if (node.kind == Kind::null) out += '~';
    if (node.kind == Kind::scalar) out += scalarText(node.scalar);
    if (node.kind == Kind::sequence || node.kind == Kind::map) {
      const bool list = node.kind == Kind::sequence;
      const std::size_t count = list ? node.items.size() : node.entries.size();
      out += list ? '[' : '{';
      for (std::size_t i = 0; i < count; ++i) {
        if (i > 0) out += ", ";
        if (!list) out += scalarText(node.entries[i].key) + ": ";
        if (!flow(list ? *node.items[i] : *node.entries[i].value, longest, depth + 1, out)) return false;
      }
      out += list ? ']' : '}';
    }
    return out.size() <= longest;
  }

  /// A value after its key or dash: on the same line where there is room, else below.
  std::string value(const DocumentNode& node, int depth) const {
    constexpr std::size_t kRoom = 96;
    std::string line;
    const bool leaf =
        node.kind == Kind::null || node.kind == Kind::scalar || node.items.size() + node.entries.size() == 0;
    if (flow(node, leaf ? DocumentLimits{}.bytes : kRoom, depth, line)) return " " + line + "\n";
    return "\n" + block(node, depth + 1);
  }

  std::string block(const DocumentNode& node, int depth) const {
    check({}, depth);
    const std::string indent(2 * static_cast<std::size_t>(depth), ' ');
    std::string out;
    for (const DocumentNode::Entry& entry : node.entries) {
      out += indent + scalarText(entry.key) + ":" + value(*entry.value, depth);
      check(out, depth);
    }
    for (const Pointer& item : node.items) {
      out += indent + "-" + value(*item, depth);
      check(out, depth);
    }
    return out;
  }

  std::string name_;
};

bool same(const DocumentNode& a, const DocumentNode& b) {
  const auto alike = [](const auto& x, const auto& y) { return same(*x, *y); };
  const auto entry = [](const auto& x, const auto& y) { return x.key == y.key && same(*x.value, *y.value); };
  return a.kind == b.kind && a.scalar == b.scalar &&
         std::equal(a.items.begin(), a.items.end(), b.items.begin(), b.items.end(), alike) &&
         std::equal(a.entries.begin(), a.entries.end(), b.entries.begin(), b.entries.end(), entry);
}

// Changing
// ------------------------------------------------------------------------------------------------------------

Pointer scalar(std::string text) {
  auto node = std::make_shared<DocumentNode>();
  node->kind = Kind::scalar;
  node->scalar = std::move(text);
  return node;
}
Pointer scalar(double value) { return scalar(fmt::format("{}", value)); }

/// A copy in which `value` stands at the path: keys of maps, indices of lists. What is missing is made; null removes
/// it.
Pointer with(const Pointer& node, const Path& path, std::size_t at, const Pointer& value) {
  if (at == path.size()) return value;
  auto copy = node ? std::make_shared<DocumentNode>(*node) : std::make_shared<DocumentNode>();
  if (copy->kind == Kind::sequence) {
    Pointer& item = copy->items.at(std::stoul(path[at]));
    item = with(item, path, at + 1, value);
    return copy;
  }
  copy->kind = Kind::map;
  const auto found = std::find_if(copy->entries.begin(), copy->entries.end(),
                                  [&](const DocumentNode::Entry& e) { return e.key == path[at]; });
  if (found == copy->entries.end()) {
    if (value) copy->entries.push_back({path[at], 0, with(nullptr, path, at + 1, value)});
  } else if (const Pointer changed = with(found->value, path, at + 1, value)) {
    found->value = changed;
  } else {
    copy->entries.erase(found);
  }
  return copy;
}

/// Every file's name, as `place` has it. A name with a package, or in a map of names, is none.
Pointer located(const Pointer& node, const PlaceFile& place, int depth) {
  if (depth > kDeepest || (node->items.empty() && node->entries.empty())) return node;
  auto copy = std::make_shared<DocumentNode>(*node);
  for (Pointer& item : copy->items) item = located(item, place, depth + 1);
  const bool packaged = std::any_of(copy->entries.begin(), copy->entries.end(),
                                    [](const DocumentNode::Entry& e) { return e.key == "package"; });
  for (DocumentNode::Entry& entry : copy->entries) {
    const bool names_file = (entry.key == "file" && !packaged) || entry.key == "tetrahedra_file";
    if (names_file && entry.value->kind == Kind::scalar) {
      entry.value = scalar(place(entry.value->scalar));
    } else {
      entry.value = located(entry.value, place, depth + 1);
    }
  }
  return copy;
}

class Editor {
 public:
  explicit Editor(Pointer root) : root_(std::move(root)) {}

  const Pointer& root() const { return root_; }
  void set(const Path& path, const Pointer& value) { root_ = with(root_, path, 0, value); }

  /// Where the scene differs from what was read.
  template <class T>
  void change(const Path& path, const T& now, const T& before, const std::string& text) {
    if (now != before) set(path, scalar(text));
  }

 private:
  Pointer root_;
};

void setRun(Editor& out, const SceneConfig& now, const SceneConfig& before) {
  out.change({"method"}, now.method, before.method, toString(now.method));
  out.change({"aim"}, now.aim, before.aim, toString(now.aim));
  out.change({"linearization", "derivative"}, now.derivative, before.derivative, toString(now.derivative));
  const bool exact = now.contact.settings.cone.exact;
  out.change({"contact", "cone"}, exact, before.contact.settings.cone.exact, coneNames()[exact ? 1 : 0]);
  out.change({"tool", "handle"}, now.tool.handle, before.tool.handle, now.tool.handle);
  out.change({"tool", "tetrahedra"}, now.tool.tetrahedra, before.tool.tetrahedra,
             fmt::format("{}", now.tool.tetrahedra));
  out.change({"duration"}, now.duration, before.duration, fmt::format("{}", now.duration));
  out.change({"visual", "step"}, now.visual_step, before.visual_step, fmt::format("{}", now.visual_step));
  out.change({"latency"}, now.latency, before.latency, fmt::format("{}", now.latency));
  out.change({"jitter"}, now.jitter, before.jitter, fmt::format("{}", now.jitter));
  out.change({"seed"}, now.seed, before.seed, fmt::format("{}", now.seed));
}

void setDevice(Editor& out, const DeviceConfig& now, const DeviceConfig& before) {
  out.change({"device", "type"}, now.kind, before.kind, toString(now.kind));
  if (!(now.options == before.options)) {
    if (!isHardware(now.kind)) out.set({"device", "options"}, Pointer());
    for (const auto& [key, value] : now.options.values()) out.set({"device", "options", key}, scalar(value));
  }
  const auto fileOf = [](const DeviceConfig& d) { return d.recording ? d.recording->file : std::string(); };
  if (fileOf(now) == fileOf(before)) return;
  // one of the command line is relative to where the program runs
  out.set({"device", "file"},
          now.recording ? scalar(std::filesystem::absolute(now.recording->path).string()) : Pointer());
}

void setStiffness(Editor& out, const SceneConfig& config, double factor) {
  const auto set = [&](Path path, const MaterialConfig& material) {
    path.insert(path.end(), {"material", "youngs_modulus"});
    out.set(path, scalar(material.youngs_modulus * factor));
    path.back() = "parts";
    for (std::size_t i = 0; i < material.parts.size(); ++i) {
      Path part = path;
      part.insert(part.end(), {std::to_string(i), "youngs_modulus"});
      out.set(part, scalar(material.parts[i].youngs_modulus * factor));
    }
  };
  if (!config.tool.rigid) set({"tool"}, config.tool.material);
  for (std::size_t i = 0; i < config.bodies.size(); ++i) {
    if (!config.bodies[i].rigid) set({"bodies", std::to_string(i)}, config.bodies[i].material);
  }
}

void setFriction(Editor& out, const SceneConfig& config, double factor) {
  const auto set = [&](const Path& path, const std::optional<double>& friction) {
    if (friction) out.set(path, scalar(*friction * factor));
  };
  set({"contact", "friction"}, config.contact.friction);
  for (std::size_t i = 0; i < config.contact.pairs.size(); ++i)
    set({"contact", "pairs", std::to_string(i), "friction"}, config.contact.pairs[i].value);
  set({"tool", "friction"}, config.tool.friction);
  for (std::size_t i = 0; i < config.bodies.size(); ++i)
    set({"bodies", std::to_string(i), "friction"}, config.bodies[i].friction);
  for (std::size_t i = 0; i < config.obstacles.size(); ++i)
    set({"obstacles", std::to_string(i), "friction"}, config.obstacles[i].friction);
}

}  // namespace

namespace {

std::string textOf(const SceneConfig& config, const SceneFactors& factors, const PlaceFile& place) {
  const std::string name = config.name + ".yaml";
  if (!config.source) throw InputError(name, "", "was made by a program and not read from a file: it cannot be saved");
  const Writer writer(name);
  const SceneConfig before = readSceneFromString(writer.document(*config.source), name);
  Editor out(config.source);
  setRun(out, config, before);
  setDevice(out, config.device, before.device);
  if (place) out.set({}, located(out.root(), place, 0));
  if (factors.stiffness != 1.0) setStiffness(out, config, factors.stiffness);
  if (factors.friction != 1.0) setFriction(out, config, factors.friction);
  std::string text = writer.document(*out.root());
  const SceneConfig again = readSceneFromString(text, name);
  if (!same(*again.source, *out.root())) throw InputError(name, "", "holds text that cannot be written as YAML");
  return text;
}

std::filesystem::path folderOf(const SceneConfig& config) {
  return (std::filesystem::current_path() / config.file).parent_path();
}

/// Of no line: it stands in no file.
Pointer placeless(const Pointer& node) {
  auto copy = std::make_shared<DocumentNode>(*node);
  copy->line = 0;
  for (Pointer& item : copy->items) item = placeless(item);
  for (DocumentNode::Entry& entry : copy->entries) entry = {entry.key, 0, placeless(entry.value)};
  return copy;
}

Path pathOf(const std::string& keys) {
  Path path{""};
  for (const char c : keys) {
    if (c == '.') {
      path.emplace_back();
    } else {
      path.back() += c;
    }
  }
  return path;
}

}  // namespace

std::string sceneText(const SceneConfig& config, const SceneFactors& factors, SavedFiles files) {
  if (files == SavedFiles::as_named) return textOf(config, factors, {});
  const std::filesystem::path folder = folderOf(config);
  return textOf(config, factors, [&](const std::string& file) { return (folder / file).lexically_normal().string(); });
}

std::string sceneTextWithFiles(const SceneConfig& config,
                               const std::function<std::string(const std::filesystem::path&)>& name) {
  const std::filesystem::path folder = folderOf(config);
  return textOf(config, {}, [&](const std::string& file) { return name((folder / file).lexically_normal()); });
}

Pointer scalarNode(const std::string& text) { return scalar(text); }

SceneConfig editedScene(const SceneConfig& config, const std::vector<SceneEdit>& edits) {
  const std::string file = config.file.string();
  Editor out(config.source);
  for (const SceneEdit& edit : edits) {
    try {
      out.set(pathOf(edit.key), placeless(edit.value));
    } catch (const std::logic_error&) {  // of std::stoul() and at()
      throw InputError(file, edit.key, "leads into a list, where it must have the number of an entry, from 0");
    }
  }
  SceneConfig edited = readSceneFromDocument(out.root(), file);
  edited.file = config.file;
  resolveFiles(edited);
  return edited;
}

}  // namespace palpate
