#include "palpate/library/scene.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <charconv>
#include <optional>
#include <utility>

#include "palpate/library/convert.h"
#include "palpate/scene/document.h"
#include "palpate/scene/reader.h"
#include "palpate/scene/save.h"

namespace palpate::v0 {

using library::guarded;

namespace {

namespace fs = std::filesystem;

SceneConfig read(std::string_view text, const std::string& name, const fs::path& file) {
  SceneConfig config = readSceneFromString(text, name);
  config.file = file;
  resolveFiles(config);
  return config;
}

/// A step on the way to a value: a key of a map, or a place in a list.
struct Part {
  std::string key;
  std::optional<std::size_t> place;
};

// "bodies[0].pose" -> bodies, 0, pose
std::vector<Part> partsOf(const std::string& key) {
  const auto fail = [&] { throw palpate::InputError("key", key, "is not of the form a.b[0].c"); };
  std::vector<Part> out;
  std::size_t at = 0;
  while (at < key.size()) {
    if (key[at] == '[') {
      const std::size_t end = key.find(']', at);
      std::size_t place = 0;
      if (end == std::string::npos) fail();
      const auto read = std::from_chars(key.data() + at + 1, key.data() + end, place);
      if (read.ec != std::errc{} || read.ptr != key.data() + end) fail();
      out.push_back({"", place});
      at = end + 1;
    } else {
      if (key[at] == '.' && !out.empty()) ++at;
      const std::size_t end = std::min(key.find_first_of(".[", at), key.size());
      if (end == at) fail();
      out.push_back({key.substr(at, end - at), std::nullopt});
      at = end;
    }
  }
  if (out.empty() || key.back() == '.') fail();
  return out;
}

// Node objects refer to what they are assigned from, so each step is a new one.
void assign(const YAML::Node& root, const std::vector<Part>& parts, const std::string& key, const YAML::Node& value) {
  YAML::Node node;
  node.reset(root);
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const Part& part = parts[i];
    const bool open = node.IsNull() || !node.IsDefined();
    if (part.place ? !node.IsSequence() && !open : !node.IsMap() && !open) {
      throw palpate::InputError(
          "key", key,
          fmt::format("what is to hold {} is no {}", part.place ? fmt::format("[{}]", *part.place) : part.key,
                      part.place ? "list" : "map"));
    }
    if (part.place && *part.place > node.size()) {
      throw palpate::InputError("key", key, fmt::format("the list has {} entries", node.size()));
    }
    if (part.place && *part.place == node.size()) node.push_back(YAML::Node());
    YAML::Node next = part.place ? node[*part.place] : node[part.key];
    if (i + 1 == parts.size()) {
      if (part.place) {
        node[*part.place] = value;
      } else {
        node[part.key] = value;
      }
      return;
    }
    if (!next.IsDefined() || next.IsNull())
      next = YAML::Node(parts[i + 1].place ? YAML::NodeType::Sequence : YAML::NodeType::Map);
    node.reset(next);
  }
}

}  // namespace

Scene::Scene(std::shared_ptr<const Impl> impl) : impl_(std::move(impl)) {}
Scene::Scene(const Scene&) = default;
Scene::Scene(Scene&&) noexcept = default;
Scene& Scene::operator=(const Scene&) = default;
Scene& Scene::operator=(Scene&&) noexcept = default;
Scene::~Scene() = default;

Scene Scene::load(const std::string& file) {
  return guarded([&] {
    const std::string text = readDocumentText(file);
    return Scene(std::make_shared<Impl>(Impl{file, text, read(text, file, file)}));
  });
}

Scene Scene::parse(std::string_view text, const std::string& name, const std::string& folder) {
  return guarded([&] {
    return Scene(std::make_shared<Impl>(Impl{name, std::string(text), read(text, name, fs::path(folder) / name)}));
  });
}

Scene& Scene::set(const std::string& key, const std::string& value) {
  return guarded([&]() -> Scene& {
    std::string text;
    try {
      const YAML::Node root = YAML::Load(impl_->text);
      assign(root, partsOf(key), key, YAML::Load(value));
      YAML::Emitter out;
      out << root;
      text = out.c_str();
    } catch (const YAML::Exception& e) {
      throw palpate::InputError("key", key, e.msg);
    }
    SceneConfig config = read(text, impl_->name, impl_->config.file);
    impl_ = std::make_shared<Impl>(Impl{impl_->name, std::move(text), std::move(config)});
    return *this;
  });
}

Scene& Scene::set(const std::string& key, double value) { return set(key, fmt::format("{}", value)); }

std::string Scene::text() const {
  return guarded([&] { return sceneText(impl_->config, {}, SavedFiles::as_named); });
}

const std::string& Scene::name() const noexcept { return impl_->config.name; }
std::string Scene::method() const { return palpate::toString(impl_->config.method); }
double Scene::duration() const noexcept { return impl_->config.duration; }
double Scene::visualStep() const noexcept { return impl_->config.visual_step; }
double Scene::hapticStep() const noexcept { return impl_->config.haptic_step; }
int Scene::latency() const noexcept { return impl_->config.latency; }

}  // namespace palpate::v0
